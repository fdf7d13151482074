# SPDX-License-Identifier: GPL-2.0-or-later
"""What differs between Windows, macOS and others: folders, interpreters, environment variables. Without QGIS.

Functions take the platform, as `sys.platform` names it, as an argument, so that each can be tested on any computer.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Mapping
from pathlib import Path, PurePath

# Each of these breaks another interpreter, GDAL or PROJ.
REMOVED_VARIABLES = (
    *("PYTHONHOME", "PYTHONPATH", "PYTHONEXECUTABLE", "PYTHONSTARTUP", "PYTHONNOUSERSITE"),
    "__PYVENV_LAUNCHER__",  # of macOS: environments would be made of the interpreter that it names
    *("GDAL_DATA", "GDAL_DRIVER_PATH", "PROJ_DATA", "PROJ_LIB", "QT_PLUGIN_PATH", "QT_QPA_PLATFORM_PLUGIN_PATH"),
)
SEARCH_PATHS = ("PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "DYLD_FRAMEWORK_PATH")
"""Variables from which QGIS's own folders are removed."""


def resolved(path: str | Path) -> Path:
    """A path without links, as far as they can be followed: `Path.resolve` raises RuntimeError for a circle of links.

    Short names of Windows become long ones, as C:/PROGRA~1, which QGIS's start files use.
    """
    return Path(os.path.realpath(path))


def worker_environment(
    variables: Mapping[str, str],
    prefix: PurePath | None,
    platform: str = sys.platform,
    resolved: Callable[[str], PurePath] = resolved,
) -> dict[str, str]:
    """The user's variables for the worker, without what QGIS sets; folders below `prefix` leave the search paths."""
    separator = ";" if platform == "win32" else ":"
    kept = {name: value for name, value in variables.items() if name.upper() not in REMOVED_VARIABLES}

    def is_own(folder: str) -> bool:
        try:
            return prefix is not None and resolved(folder).is_relative_to(resolved(str(prefix)))
        except OSError:
            return False

    for name, value in kept.items():
        if prefix is not None and name.upper() in SEARCH_PATHS:
            kept[name] = separator.join(part for part in value.split(separator) if part and not is_own(part))
    return {**kept, "PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1"}


def own_prefix(application: PurePath, platform: str = sys.platform) -> PurePath | None:
    """The folder that only QGIS at `QgsApplication.prefixPath()` uses; None where it is part of the system."""
    if platform == "win32":  # C:/Program Files/QGIS 3.40/apps/qgis: the libraries are in the folder above
        return application.parents[1] if application.parent.name.lower() == "apps" else application
    if platform == "darwin":
        return next((folder for folder in (application, *application.parents) if folder.suffix == ".app"), application)
    return None if application.as_posix() in ("/usr", "/usr/local") else application


def program_on_path(name: str) -> str | None:
    """The path of a program in one of the folders of PATH; None if it is in none of them.

    Never one of the current folder, where Windows looks first: QGIS may have been started in that of a project.
    """
    for folder in os.get_exec_path():
        found = shutil.which(name, path=folder) if Path(folder).is_absolute() else None
        if found is not None and Path(found).is_absolute():
            return found
    return None


def user_data(platform: str, variables: Mapping[str, str], home: Path) -> Path:
    """The data folder of this user, the same as that of the command line."""
    if platform == "win32":
        return Path(variables.get("APPDATA") or home / "AppData" / "Roaming")
    if platform == "darwin":
        return home / "Library" / "Application Support"
    return Path(variables.get("XDG_DATA_HOME") or home / ".local" / "share")


def python_in(folder: Path, platform: str = sys.platform) -> Path:
    """The interpreter of an environment. It works after the folder is renamed; the scripts beside it do not."""
    return folder / ("Scripts/python.exe" if platform == "win32" else "bin/python")


def python_candidates(platform: str, executable: PurePath, prefix: Path, root: Path = Path("/")) -> list[str]:
    """Interpreters that may create environments; `executable` and `prefix` are those of this process."""
    stem = executable.stem if platform == "win32" else executable.name
    found: list[PurePath] = [executable] if re.fullmatch(r"python[\d.]*", stem.lower()) else []
    found += [path for name in ("python.exe", "bin/python3") if (path := prefix / name).is_file()]
    found += [Path(path) for path in map(program_on_path, ("python3", "python")) if path]
    if platform == "darwin":  # programs of the desktop have a PATH without these
        versions = (root / "Library" / "Frameworks" / "Python.framework" / "Versions").glob("3.*/bin/python3")
        found += sorted(versions, key=lambda path: int(path.parents[1].name[2:]), reverse=True)
        found += [path for name in ("opt/homebrew", "usr/local") if (path := root / name / "bin" / "python3").is_file()]
    return [str(path) for path in found]


def listed_pythons(text: str) -> list[str]:
    """The interpreters that `py --list-paths` prints: the launcher of python.org's Python on Windows."""
    return re.findall(r"^ *-\S+ +(?:\* +)?(\S.*\.exe)\s*$", text, re.MULTILINE)
