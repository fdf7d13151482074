"""Where numba keeps furrowmap's compiled kernels: in folders named by the content of their sources.

numba's own rule is the path of a kernel's file, and it looks at the content of that file alone. A kernel also contains
what it calls and the constants it uses from other modules, and copies of the same sources can share kernels: those of
another checkout, of an installation, of the last version.
"""

import hashlib
import os
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any, Final

from furrowmap.process import CACHE_VARIABLE

_PACKAGE: Final = __name__.partition(".")[0] + "."
_IMPORT: Final = re.compile(r"^from (furrowmap[\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)


class KernelCacheLocator:
    """The folder of a kernel, for numba (``NUMBA_CACHE_LOCATOR_CLASSES``)."""

    def __init__(self, function: Any, folder: Path) -> None:
        self._line = function.__code__.co_firstlineno
        self._folder = folder

    @classmethod
    def from_function(cls, function: Any, file: str) -> "KernelCacheLocator | None":
        """The locator of a kernel in a file; None if it is not of furrowmap, or where nothing can be written."""
        if not function.__module__.startswith(_PACKAGE):
            return None
        folder = _writable_folder(Path(file).stem, function.__module__)
        return cls(function, folder) if folder is not None else None

    def ensure_cache_path(self) -> None:
        """Make the folder if it has been removed."""
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """What tells versions of the sources apart within the folder: nothing has to."""
        return ""

    def get_disambiguator(self) -> str:
        """What tells kernels of one name apart."""
        return str(self._line)


@cache
def _writable_folder(name: str, module: str) -> Path | None:
    """The folder of a module's kernels, made where it is not there; None where nothing can be written."""
    folder = Path(os.environ[CACHE_VARIABLE], f"{name}-{sources_digest(module)[:16]}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


@cache
def sources_digest(module: str) -> str:
    """SHA-1 of the names and sources of an imported module and of all modules of furrowmap that it imports.

    The names, too: numba keeps that of the module in each kernel, and imports it when the kernel is loaded.
    """
    found = {module: source_text(module)}
    waiting = [module]
    while waiting:
        for name in _imported(waiting.pop()):
            if name not in found and getattr(sys.modules.get(name), "__file__", None):
                found[name] = source_text(name)
                waiting.append(name)
    texts = (part for name in sorted(found) for part in (name, found[name]))
    return hashlib.sha1("\0".join(texts).encode(), usedforsecurity=False).hexdigest()


@cache
def _imported(module: str) -> list[str]:
    """What an imported module imports of furrowmap: modules, and names in them, which may be modules."""
    return [
        name
        for package, names in _IMPORT.findall(source_text(module))
        for name in (package, *(f"{package}.{name}" for name in re.findall(r"\w+", names)))
    ]


@cache
def source_text(module: str) -> str:
    """The source of an imported module."""
    file = sys.modules[module].__file__
    assert file is not None
    return Path(file).read_text(encoding="utf-8")
