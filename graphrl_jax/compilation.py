"""How programs are compiled and how the process keeps its memory: the settings every entry point shares."""

import ctypes
import os
from functools import partial
from pathlib import Path

import jax
import jax.monitoring

# On CPU, jaxlib's batched Cholesky hands its work to the thread pool it runs on and waits for it. Where two run at
# once, as MJX's implicit integrator lets them, all threads wait and the program hangs: seen with jaxlib 0.10.2 on two
# cores and 64 environments of Shoes in Box. One thread per program is no slower here (7,160 steps/s of PPO against
# 6,600).
_OPTIONS = {"xla_cpu_multi_thread_eigen": False}
if jax.__version_info__ < (0, 11):
    # Its fusion emitters recompute a kinematic chain once per use, which made vmapped MJX kinematics over 200 times
    # slower and its compilation minutes long. Later ones do not, and no longer know the option.
    _OPTIONS["xla_cpu_use_fusion_emitters"] = False
# These options are ignored on other devices.
jit_physics = partial(jax.jit, compiler_options=_OPTIONS)
"""`jax.jit` for programs that contain MJX physics."""

_KEEP_BYTES = 1 << 34
_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_THRESHOLD = -1, -2, -3


class CompileLog:
    """Counts backend compilations, their seconds, and the programs that came out of the persistent cache.

    Attributes:
      seconds: float, time spent compiling (or loading from the cache) so far.
      cache_hits: int, programs found in the persistent cache.
      cache_misses: int, programs compiled anew and written to the cache.
    """

    def __init__(self) -> None:
        self.seconds, self.cache_hits, self.cache_misses = 0.0, 0, 0
        jax.monitoring.register_event_duration_secs_listener(self._on_duration)
        jax.monitoring.register_event_listener(self._on_event)

    def _on_duration(self, event: str, duration: float, **_: str | int) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            self.seconds += duration

    def _on_event(self, event: str, **_: str | int) -> None:
        self.cache_hits += event == "/jax/compilation_cache/cache_hits"
        self.cache_misses += event == "/jax/compilation_cache/cache_misses"

    @property
    def cache(self) -> str:
        """ "warm" if every cached program was found, "cold" if none was, else "mixed"."""
        if not self.cache_misses:
            return "warm" if self.cache_hits else "cold"
        return "mixed" if self.cache_hits else "cold"


def configure() -> CompileLog:
    """Turns the persistent compilation cache on and lets the process keep freed memory. Call once, before computing.

    The cache lives in `$JAX_COMPILATION_CACHE_DIR`, else in `$XDG_CACHE_HOME` (or `~/.cache`) `/graphrl_jax/jax`.
    """
    if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "graphrl_jax" / "jax"
        jax.config.update("jax_compilation_cache_dir", str(cache))
    _keep_freed_memory()
    return CompileLog()


def _keep_freed_memory() -> None:
    """glibc gives large buffers back after each step; on virtual machines taking them again costs more than that."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # not glibc
        return
    for parameter in (_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD):
        mallopt(parameter, ctypes.c_int(min(_KEEP_BYTES, 2**31 - 1)))
    mallopt(_M_TOP_PAD, ctypes.c_int(1 << 28))
