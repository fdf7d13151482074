"""Set-up of the process: the cache of compiled kernels, BLAS threads, freed memory."""

import ctypes
import gc
import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Final

CACHE_VARIABLE: Final = "NUMBA_CACHE_DIR"
_LOCATORS_VARIABLE: Final = "NUMBA_CACHE_LOCATOR_CLASSES"
_LOCATORS: Final = "furrowmap.kernel_cache.KernelCacheLocator,UserProvidedCacheLocator,IPythonCacheLocator"
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_M_ARENA_MAX: Final = -8
"""Parameters of mallopt(3)."""
_NOT_FOR_US: Final = {
    "laspy.copc": ("requests",),
    "numba.core.config": ("yaml",),
    "numba.core.typing.cffi_utils": ("cffi",),
    "numba.misc.coverage_support": ("coverage",),
    "pyogrio": ("geopandas", "pandas", "pyarrow"),
    "rasterio": ("boto3",),
}
"""What libraries import wherever it is installed, for functions of theirs that furrowmap does not call."""


@cache
def prepare_process() -> None:
    """Set up this process for furrowmap's work, once; after numpy and numba are imported it has less effect."""
    keep_kernels()
    keep_blas_single()
    keep_freed_memory()
    keep_collections_rare()


def keep_out_current_folder() -> None:
    """Let the programs that this one starts import nothing from the current folder, which may be a stranger's.

    Python's own worker processes would: one that is started with ``-c`` looks there first, also for
    ``multiprocessing``. On Windows, programs themselves are looked for there.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    os.environ["NODEFAULTCURRENTDIRECTORYINEXEPATH"] = "1"


def keep_kernels() -> None:
    """Set numba's cache of compiled kernels to a folder of this user; call it before numba is imported.

    numba unpickles what is there, so nobody else may write to it. A folder already set is respected. Where the user has
    no folder of their own, a temporary one serves this process, because numba does not load kernels that it cannot
    cache.
    """
    os.environ.setdefault(_LOCATORS_VARIABLE, _LOCATORS)
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")  # of calls tried: 4 % of a compilation
    os.environ.setdefault("NUMBA_OPT", "2")  # with the next, 5 % of a compilation; a run takes as long
    os.environ.setdefault("NUMBA_LOOP_VECTORIZE", "0")
    if CACHE_VARIABLE in os.environ:
        return
    folder = _caches() / "furrowmap" / "kernels"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _expect_private(folder.parent)
        _expect_private(folder)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix="furrowmap-kernels-"))
    os.environ[CACHE_VARIABLE] = str(folder)


def _expect_private(folder: Path) -> None:
    """Take a folder of ours from all others; PermissionError if it is not this user's (on Windows, profiles are)."""
    if sys.platform != "win32":
        found = folder.stat()
        if found.st_uid != os.geteuid():
            raise PermissionError(f"{folder} belongs to another user")
        if found.st_mode & 0o077:
            folder.chmod(0o700)


def keep_blas_single() -> None:
    """Limit BLAS to one thread; call it before numpy is imported.

    furrowmap's own threads use the cores already: matching 64 million points took 30 s of processor time with threads
    of BLAS and 18 s without. A number that the user has set is respected.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def keep_freed_memory() -> None:
    """Let glibc reuse the memory of freed arrays of up to 32 MB.

    Otherwise the arrays of every scan are new pages, which the kernel fills with zeros first: a fifth of a run's system
    time. Two heaps serve all threads: with one heap a thread, 77 million points took 180 MB more. The user's own
    settings in glibc's variables are respected.
    """
    if sys.platform == "linux" and not any(name.startswith("MALLOC_") for name in os.environ):
        with suppress(OSError, AttributeError):
            mallopt = ctypes.CDLL("libc.so.6").mallopt
            mallopt(_M_MMAP_THRESHOLD, 32 << 20)
            mallopt(_M_TRIM_THRESHOLD, 256 << 20)
            mallopt(_M_ARENA_MAX, 2)


def keep_collections_rare() -> None:
    """Let Python look for cycles once 5,000 objects were made, not 700: a tenth of a second of each start."""
    gc.set_threshold(max(5_000, gc.get_threshold()[0]))


def leave_out_unused() -> None:
    """Let libraries be imported without what furrowmap does not ask of them: 0.6 s of each start.

    For processes that run furrowmap alone. A program that uses it may ask pyogrio for tables of geopandas.
    """
    if not any(isinstance(finder, _FinderWithout) for finder in sys.meta_path):
        sys.meta_path.insert(0, _FinderWithout())


class _FinderWithout(MetaPathFinder):
    """Finds libraries as the others do, and has them loaded as if what they do not need were not installed."""

    def __init__(self) -> None:
        self._finding = set[str]()

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002 (the protocol's arguments)
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> ModuleSpec | None:
        """The module's specification; None for others than these libraries."""
        if fullname not in _NOT_FOR_US or fullname in self._finding:
            return None
        self._finding.add(fullname)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            spec.loader = _LoaderWithout(spec.loader, _NOT_FOR_US[fullname])
        return spec


class _LoaderWithout(Loader):
    """Loads a module while some others seem not to be installed."""

    def __init__(self, loader: Loader, names: tuple[str, ...]) -> None:
        self._loader = loader
        self._names = names

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """As the loader itself does."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Load it, and let the others be imported afterwards."""
        hidden = [name for name in self._names if name not in sys.modules]
        for name in hidden:
            sys.modules[name] = None  # type: ignore[assignment]  # to Python, it is not installed
        try:
            self._loader.exec_module(module)
        finally:
            for name in hidden:
                del sys.modules[name]


def _caches() -> Path:
    """This user's cache folder."""
    if sys.platform == "win32":
        usual = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        usual = Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    return Path(os.environ.get("XDG_CACHE_HOME") or usual)
