"""Imports mujoco-mjx without its announcement on standard output that Warp, which nothing here uses, is missing.

Commands print one JSON line there and nothing else.
"""

import contextlib
import io

with contextlib.redirect_stdout(io.StringIO()):
    import mujoco.mjx  # noqa: F401
