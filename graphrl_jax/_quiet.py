"""Imports mujoco-mjx without its announcement on standard output that Warp, which nothing here uses, is missing.

Commands print one JSON line there and nothing else. MuJoCo decides on import how it renders; without a display it can
do so by EGL, where there is one.
"""

import contextlib
import ctypes.util
import io
import os

if not os.environ.get("DISPLAY") and ctypes.util.find_library("EGL"):
    os.environ.setdefault("MUJOCO_GL", "egl")

with contextlib.redirect_stdout(io.StringIO()):
    import mujoco.mjx  # noqa: F401
