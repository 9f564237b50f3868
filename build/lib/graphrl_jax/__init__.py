"""Dense rewards from action-free demonstrations through graphs of objects, and policies trained on them, in JAX.

The public names follow the pipeline: demonstrations -> encoder -> reward -> environment -> policy. All other code is in
the folder named after its topic. A name is imported on first use, so that `import graphrl_jax` costs nothing.
"""

import ctypes
import os

import lazy_loader

# The public names and their types are in __init__.pyi.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _render_without_display() -> None:
    """Selects EGL for MuJoCo, if it is installed; MuJoCo chooses its renderer on import."""
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return
    os.environ.setdefault("MUJOCO_GL", "egl")


if not os.environ.get("DISPLAY"):
    _render_without_display()
