"""The runtime of programs: compilation and its cache, memory, optional packages, and versions that results record."""

import contextlib
import ctypes
import importlib
import importlib.metadata
import importlib.util
import os
import platform
import subprocess
import time
import warnings
from functools import cache, partial
from pathlib import Path
from types import ModuleType

import jax
import jax.monitoring

# LLVM's second level makes programs that are as fast as those of its third, and takes a quarter to a half less time for
# it: 7.5 s instead of 11.5 s for PPO's update on Match Regions. The compilers of other devices would read this, too.
_LEVEL = "--xla_backend_optimization_level"
if importlib.util.find_spec("jax_plugins") is None and _LEVEL not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_LEVEL}=2".strip()

# On CPU, jaxlib's batched Cholesky submits its work to the thread pool it runs on and waits for it. If two run at once,
# as with MJX's implicit integrator, all threads wait and the program hangs (seen with jaxlib 0.10.2 on two cores and 64
# environments of Shoes in Box). One thread per program is not slower here (7,160 steps/s of PPO against 6,600).
_OPTIONS = {"xla_cpu_multi_thread_eigen": False}
if jax.__version_info__ < (0, 11):
    # Fusion emitters of these versions recompute a kinematic chain once per use. They made vmapped MJX kinematics over
    # 200 times slower, with minutes of compilation. Later versions do not recompute it and have no such option.
    _OPTIONS["xla_cpu_use_fusion_emitters"] = False
# Other devices ignore these options.
jit_physics = partial(jax.jit, compiler_options=_OPTIONS)
"""`jax.jit` for programs that contain MJX physics."""

# With asynchronous dispatch, a callback from a program on CPU can wait for ever for the copy of its own inputs, queued
# behind the program (seen with arrays above some 50 kB). JAX reads this when its backend starts.
jax.config.update("jax_cpu_enable_async_dispatch", False)

_PACKAGES = ("jax", "jaxlib", "brax", "mujoco", "mujoco-mjx", "numpy", "graphrl_jax")
# mallopt takes an int, so this is the largest threshold.
_KEEP_BYTES, _TOP_PAD_BYTES = 2**31 - 1, 1 << 28
_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_THRESHOLD = -1, -2, -3


class ProcessLog:
    """Records the seconds of the process and of its compilations, and hits and misses of the persistent cache.

    Attributes:
      started: float, `time.perf_counter()` at the beginning.
      seconds: float, time spent compiling (or loading from the cache) so far.
      cache_hits: int, programs found in the persistent cache.
      cache_misses: int, programs compiled anew and written to the cache.
    """

    def __init__(self) -> None:
        self.started = time.perf_counter()
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
        """ "warm" if every program was found in the cache, "cold" if none was, else "mixed"."""
        if not self.cache_misses:
            return "warm" if self.cache_hits else "cold"
        return "mixed" if self.cache_hits else "cold"

    def times(self) -> dict[str, float | str]:
        """Seconds since the beginning (`wall_s`), those of compilations (`compile_s`), and `compilation_cache`."""
        wall = time.perf_counter() - self.started
        return {"wall_s": wall, "compile_s": self.seconds, "compilation_cache": self.cache}


def configure() -> ProcessLog:
    """Sets up the persistent compilation cache, warnings and memory of the process. Call it once, before computing.

    The cache is in `$JAX_COMPILATION_CACHE_DIR`, else in `$XDG_CACHE_HOME` (or `~/.cache`) `/graphrl_jax/jax`. A user
    without a home folder, as in some containers, has none.
    """
    if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        with contextlib.suppress(RuntimeError):  # of a missing home folder
            cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "graphrl_jax" / "jax"
            jax.config.update("jax_compilation_cache_dir", str(cache))
    # JAX warns of every fork; the only ones here start ffmpeg, which takes the place of the copied process at once.
    warnings.filterwarnings("ignore", r"os\.fork\(\) was called", RuntimeWarning)
    _keep_freed_memory()
    return ProcessLog()


def _keep_freed_memory() -> None:
    """Stops glibc from returning large buffers after each step; on virtual machines, allocating them again is slow."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # not glibc
        return
    for parameter in (_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD):
        mallopt(parameter, ctypes.c_int(_KEEP_BYTES))
    mallopt(_M_TOP_PAD, ctypes.c_int(_TOP_PAD_BYTES))


def optional_package(name: str, extra: str, why: str, failure: type[ValueError] = ValueError) -> ModuleType:
    """A package that an extra of graphrl_jax installs.

    Args:
      name: of the package.
      extra: of graphrl_jax.
      why: begins the message, such as `trained detectors need`.
      failure: kind of the error.

    Raises:
      ValueError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise failure(f'{why} the package {name}: pip install "graphrl_jax[{extra}]"') from None


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that affect results."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def device() -> str:
    """Name of the device in use, and the number of CPU cores."""
    return f"{jax.devices()[0].device_kind} ({jax.default_backend()}), {os.cpu_count()} CPU cores"


def default_preset() -> str:
    """Name of the preset for the device in use."""
    return "cpu" if jax.default_backend() == "cpu" else "gpu"


@cache
def commit() -> str | None:
    """The commit of this package's sources, None if they are not in a repository.

    It ends in "-dirty" if tracked files other than benchmark results have changed since.
    """
    revision = _git("rev-parse", "HEAD")
    # An installed package may be inside another project's repository.
    if not revision or not _git("ls-files", Path(__file__).name):
        return None
    results = ":(exclude,top)benchmarks/results"
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", ":/", results)
    return f"{revision}-dirty" if changed else revision


def _git(*arguments: str) -> str:
    """Output of a git command in this package's folder; empty if git cannot run."""
    try:
        answer = subprocess.run(
            ["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True, check=False
        )
    except OSError:
        return ""
    return answer.stdout.strip()
