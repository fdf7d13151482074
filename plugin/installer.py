# SPDX-License-Identifier: GPL-2.0-or-later
"""Creates the virtual environment in which the worker runs, in the user's own data folder.

Dependencies are installed from `locked_packages.txt`, which has their versions and checksums. furrowmap itself is on no
package index: it comes from a wheel, a source checkout or a folder of wheels that the user chooses. The environment is
built in another folder, tested and renamed, so a failure changes nothing. QGIS's Python only creates it; nothing is
installed into that. The functions block: call them in a task's thread.
"""

from __future__ import annotations

import configparser
import json
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from qgis.PyQt.QtCore import QCoreApplication

from .interpreter import command_of, environment_folder
from .platforms import listed_pythons, program_on_path, python_candidates, python_in
from .program import ProgramError, run_program
from .worker import WorkerError, greet

tr = partial(QCoreApplication.translate, "Installer")

OLDEST_PYTHON = (3, 11)
NEWEST_PYTHON = (3, 14)
"""Those for which :data:`LOCKED` has wheels."""
LOCKED = Path(__file__).with_name("locked_packages.txt")
"""Not named requirements.txt: there are plugins that install such a file into QGIS's Python."""
_ASKED = (
    "import ctypes, ensurepip, sqlite3, ssl, sys, venv; "  # without QGIS's PATH, libraries of some of these are missing
    f"print({OLDEST_PYTHON} <= sys.version_info[:2] <= {NEWEST_PYTHON})"
)
_OFFLINE = re.compile("NewConnectionError|NameResolutionError|ConnectTimeout|ProxyError|SSLError|Retrying")
_REQUIREMENTS = """
import importlib.metadata, sys
for line in importlib.metadata.requires("furrowmap") or ():
    name, _, condition = line.partition(";")
    if f"extra == '{sys.argv[1]}'" in condition.replace('"', "'"):
        print(name.strip())
"""
COPY = "source"
"""Folder in the environment for the copy of a checkout, while it is installed."""
NOT_COPIED = (".*", "__pycache__", "*.egg-info", "build", "dist", "node_modules", "site")
"""Of a checkout from which furrowmap is installed."""
OnLine = Callable[[str], None]
IsCancelled = Callable[[], bool]


class InstallError(Exception):
    """No environment was created; one that existed is unchanged. Three lines for the user."""

    def __init__(self, what: str, remedy: str) -> None:
        self.lines = (what, tr("The environment was not created; an existing one is unchanged."), remedy)
        super().__init__("\n".join(self.lines))


def create_environment(source: str, on_line: OnLine, is_cancelled: IsCancelled) -> dict[str, Any]:
    """Create the environment; an existing one is replaced after the new one has been tested.

    Args:
        source: a wheel of furrowmap or a source checkout, for which dependencies come from the package index; or a
            folder with the wheels of furrowmap and of all dependencies, for which the network is not used.

    Returns:
        The versions in it, as `furrowmap --version --json` has them.

    Raises:
        InstallError: if it could not be created.
        ProgramError: if the user cancelled it.
    """
    package, wheels = package_in(Path(source))
    folder = environment_folder()
    building = folder.with_name(f"{folder.name}.building")
    try:
        _delete(building)
        building.parent.mkdir(parents=True, exist_ok=True)
        run_program([base_python(is_cancelled), "-I", "-m", "venv", str(building)], on_line, is_cancelled)
        pip = [str(python_in(building)), "-I", "-m", "pip"]
        install = [*pip, "install", "--no-input", "--disable-pip-version-check"]
        offline = ["--no-index", "--find-links", str(wheels)] if wheels else []
        locked = ["--require-hashes", "--only-binary=:all:", "--requirement", str(LOCKED)]
        run_program([*install, *offline, *locked], on_line, is_cancelled)
        copy = _without_traces(package, building)
        run_program([*install, "--no-index", "--no-deps", "--no-build-isolation", str(copy)], on_line, is_cancelled)
        shutil.rmtree(building / COPY, ignore_errors=True)
        run_program([*pip, "check"], on_line, is_cancelled)
        versions = check(command_of(building), on_line, is_cancelled)
        _replace(folder, building)
        on_line(tr("Compiling: this takes some minutes, once."))
        with suppress(ProgramError):  # what is missing is compiled when it is first needed
            run_program([*command_of(folder), "warm-up"], on_line, is_cancelled)
    except (ProgramError, WorkerError, OSError) as error:
        if getattr(error, "cancelled", False):
            raise
        raise InstallError(*_reason(error, wheels)) from error
    finally:
        _delete(building)
    return versions


def package_in(source: Path) -> tuple[Path, Path | None]:
    """What to install furrowmap from, and the folder of wheels if that has the dependencies as well."""
    if source.suffix == ".whl" and source.name.startswith("furrowmap-") and source.is_file():
        return source, None
    checkout = source.parent if source.name == "pyproject.toml" else source
    try:
        text = (checkout / "pyproject.toml").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        text = ""
    if re.search(r'^name = "furrowmap"$', text, re.MULTILINE):
        return checkout, None
    wheel = min(source.glob(f"furrowmap-{own_version()}-*.whl"), default=None)
    if wheel is None:
        raise InstallError(
            tr("{source} has no furrowmap {version}.").format(source=source, version=own_version()),
            tr("Choose a wheel of furrowmap, its source checkout, or a folder of wheels with the plugin's version."),
        )
    return wheel, source


def _reason(error: Exception, wheels: Path | None) -> tuple[str, str]:
    """What went wrong and what to do about it, from the output of pip or of furrowmap."""
    lines = list(getattr(error, "output", ())) or str(error).splitlines()
    text = "\n".join(lines)
    log = tr("The log above has the details.")
    missing = re.search(r"No matching distribution found for (\S+)", text)
    if "DO NOT MATCH THE HASHES" in text:
        found = re.search(r"^\s+(\S+==\S+)", text[text.index("DO NOT MATCH") :], re.MULTILINE)
        package = found[1] if found else ""
        return (
            tr("The checksum of {package} differs from the plugin's list.").format(package=package),
            tr("The file is damaged or not the original. Download the wheels again, or use another source."),
        )
    if not wheels and _OFFLINE.search(text):
        return tr("The package index cannot be reached."), tr("Check the network, or install from a folder of wheels.")
    if missing and wheels:
        return (
            tr("{folder} has no wheel of {package} for this Python.").format(folder=wheels, package=missing[1]),
            tr("Download the wheels with the same version of Python on the same kind of computer."),
        )
    if missing:
        return tr("There is no wheel of {package} for this computer and this Python.").format(package=missing[1]), log
    errors = [line[len("ERROR:") :].strip() for line in lines if line.startswith("ERROR:")]
    return tr("Installing failed: {reason}").format(reason=(errors or lines[-1:] or [""])[0]), log


def _without_traces(package: Path, building: Path) -> Path:
    """A wheel, or a copy of a checkout: pip leaves files where it builds."""
    if package.is_file():
        return package
    shutil.copytree(package, building / COPY, ignore=shutil.ignore_patterns(*NOT_COPIED))
    return building / COPY


def install_extra(program: Sequence[str], extra: str, on_line: OnLine, is_cancelled: IsCancelled) -> list[str]:
    """Install the packages of an extra of furrowmap beside the furrowmap that a program starts; their requirements.

    Raises InstallError if that is not possible, ProgramError if the user cancelled it.
    """
    first = Path(program[0])
    python = first if first.stem.lower().startswith("python") else first.with_name("python" + first.suffix)
    if not python.is_file():
        raise InstallError(
            tr("{program} has no Python beside it.").format(program=program[0]),
            tr("Install the packages in the way in which furrowmap was installed."),
        )
    try:
        asked = run_program([str(python), "-I", "-c", _REQUIREMENTS, extra], lambda _line: None, is_cancelled)
        requirements = [line.strip() for line in asked.splitlines() if line.strip()]
        pip = [str(python), "-I", "-m", "pip", "install", "--no-input", "--disable-pip-version-check"]
        run_program([*pip, *requirements], on_line, is_cancelled)
    except ProgramError as error:
        if error.cancelled:
            raise
        raise InstallError(*_reason(error, None)) from error
    return requirements


def size_of(folder: Path) -> int:
    """Bytes of the files below a folder."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())


def remove_environment() -> None:
    """Remove the environment that the plugin created."""
    folder = environment_folder()
    if folder.exists():
        leaving = folder.with_name(f"{folder.name}.removed")
        _delete(leaving)
        folder.rename(leaving)
        _delete(leaving)


def check(program: Sequence[str], on_line: OnLine, is_cancelled: IsCancelled) -> dict[str, Any]:
    """Start furrowmap twice, for its versions, which are returned, and for the worker's hello.

    Raises ProgramError if it does not answer, WorkerError if its worker does not or has another protocol version.
    """
    text = run_program([*program, "--version", "--json"], on_line, is_cancelled)
    try:
        versions: dict[str, Any] = json.loads(text)
        versions["furrowmap"]
    except (ValueError, KeyError, TypeError):
        raise ProgramError(tr("{program} is not furrowmap.").format(program=program[0])) from None
    greet(program, is_cancelled)
    return versions


def base_python(is_cancelled: IsCancelled) -> str:
    """A Python that can create environments: QGIS's own, else one on the search path; else InstallError."""
    candidates = python_candidates(sys.platform, Path(sys.executable or ""), Path(sys.base_prefix))
    if sys.platform == "win32" and (launcher := program_on_path("py")):
        with suppress(ProgramError):
            candidates += listed_pythons(run_program([launcher, "--list-paths"], lambda _line: None, is_cancelled))
    for candidate in dict.fromkeys(candidates):
        try:
            if run_program([candidate, "-I", "-c", _ASKED], lambda _line: None, is_cancelled).strip() == "True":
                return candidate
        except ProgramError as error:
            if error.cancelled:
                raise
    oldest, newest = (".".join(map(str, version)) for version in (OLDEST_PYTHON, NEWEST_PYTHON))
    raise InstallError(
        tr("No Python {oldest} to {newest} with venv was found.").format(oldest=oldest, newest=newest),
        tr("Install Python from python.org; on Debian and Ubuntu the package python3-venv. Then try again."),
    )


def own_version() -> str:
    """The plugin's version, which is furrowmap's."""
    metadata = configparser.ConfigParser(interpolation=None)
    metadata.read(Path(__file__).with_name("metadata.txt"), encoding="utf-8")
    return metadata["general"]["version"]


def _replace(folder: Path, building: Path) -> None:
    """Rename the new environment to its final name; the old one comes back if that fails."""
    old = folder.with_name(f"{folder.name}.old")
    _delete(old)
    if folder.exists():
        folder.rename(old)
    try:
        building.rename(folder)
    except OSError:
        if old.exists():
            old.rename(folder)
        raise
    _delete(old)


def _delete(folder: Path) -> None:
    if folder.exists():
        shutil.rmtree(folder, ignore_errors=True)
