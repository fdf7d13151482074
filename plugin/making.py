# SPDX-License-Identifier: GPL-2.0-or-later
"""Makes the environment in which the worker runs: a virtual environment in the user's own folder.

It is built aside, verified and then renamed, so that there is a whole one or none; QGIS's own Python is only asked to
make it, and nothing is ever installed into that. The calls block, so they belong into the thread of a task.
"""

import configparser
import json
import shutil
import sys
from pathlib import Path

from qgis.PyQt.QtCore import QCoreApplication

from .interpreter import command_of, environment_folder, python_in
from .program import ProgramError, run_program
from .worker import WorkerError, greet

OLDEST_PYTHON = (3, 11)
_ASKED = "import ensurepip, sys, venv; print(sys.version_info >= ({}, {}))".format(*OLDEST_PYTHON)


class MakingError(Exception):
    """No environment was made: three lines for the user; whatever was there before is as it was."""

    def __init__(self, *lines):
        super().__init__("\n".join(lines))
        self.lines = lines


def make_environment(wheels, on_line, is_cancelled, folder=None):
    """Make the environment; one that was there is replaced once the new one works.

    Args:
        wheels: folder with furrowmap and all that it needs, for machines without a network; None for the package index.
        on_line: is called with each line of the log.
        is_cancelled: is asked ten times a second.
        folder: of the environment, by default the plugin's own.

    Returns:
        The versions in it, as ``furrowmap --version --json`` tells them.

    Raises:
        MakingError: if it could not be made.
        ProgramError: if the user stopped it.
    """
    folder = folder or environment_folder()
    building = folder.with_name(f"{folder.name}.building")
    source = ["--no-index", "--find-links", str(wheels)] if wheels else ["--prefer-binary"]
    try:
        _delete(building)
        building.parent.mkdir(parents=True, exist_ok=True)
        python = base_python(is_cancelled)
        run_program([python, "-I", "-m", "venv", str(building)], on_line, is_cancelled)
        pip = [str(python_in(building)), "-I", "-m", "pip", "install", "--no-input", "--disable-pip-version-check"]
        run_program([*pip, *source, f"furrowmap=={own_version()}"], on_line, is_cancelled)
        versions = check(command_of(building), on_line, is_cancelled)
        _replace(folder, building)
    except (ProgramError, WorkerError, OSError) as error:
        if getattr(error, "cancelled", False):
            raise
        raise MakingError(
            tr("The environment could not be made: {reason}").format(reason=str(error).splitlines()[0]),
            tr("Nothing half-made is left; an environment that was there is as it was."),
            tr("The folder of wheels has to hold furrowmap {version} and all that it needs.").format(
                version=own_version()
            )
            if wheels
            else tr("Check the network, or install from a folder of wheels. The log above tells more."),
        ) from error
    finally:
        _delete(building)
    return versions


def remove_environment(folder=None):
    """Remove the environment that the plugin made."""
    folder = folder or environment_folder()
    if folder.exists():
        leaving = folder.with_name(f"{folder.name}.removed")
        _delete(leaving)
        folder.rename(leaving)
        _delete(leaving)


def check(program, on_line, is_cancelled):
    """Start furrowmap twice: for its versions, and for the worker's hello.

    Returns:
        The versions.

    Raises:
        ProgramError: if it does not answer.
        WorkerError: if its worker does not, or speaks another protocol.
    """
    text = run_program([*program, "--version", "--json"], on_line, is_cancelled)
    try:
        versions = json.loads(text)
        versions["furrowmap"]
    except (ValueError, KeyError, TypeError):
        raise ProgramError(tr("{program} is not furrowmap.").format(program=program[0])) from None
    greet(program, is_cancelled)
    return versions


def base_python(is_cancelled):
    """A Python that can make environments: QGIS's own, else one on the search path.

    Raises:
        MakingError: if there is none.
    """
    prefix = Path(sys.base_prefix)
    running = Path(sys.executable or "")  # in the desktop on Windows that is QGIS
    candidates = [str(running)] if running.stem.lower().startswith("python") else []
    candidates += [str(prefix / name) for name in ("python.exe", "bin/python3") if (prefix / name).is_file()]
    candidates += [found for found in map(shutil.which, ("python3", "python")) if found]
    for candidate in dict.fromkeys(candidates):
        try:
            if run_program([candidate, "-I", "-c", _ASKED], _ignore, is_cancelled).strip() == "True":
                return candidate
        except ProgramError as error:
            if error.cancelled:
                raise
    raise MakingError(
        tr("There is no Python {version} or newer that can make environments.").format(
            version=".".join(map(str, OLDEST_PYTHON))
        ),
        tr("furrowmap's worker needs one of its own, beside QGIS."),
        tr("Install Python from python.org; on Debian and Ubuntu the package python3-venv. Then try again."),
    )


def own_version():
    """The plugin's version, which is furrowmap's."""
    metadata = configparser.ConfigParser(interpolation=None)
    metadata.read(Path(__file__).with_name("metadata.txt"), encoding="utf-8")
    return metadata["general"]["version"]


def _replace(folder, building):
    """Put the new environment in its place; the old one comes back if that fails."""
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


def _delete(folder):
    if folder.exists():
        shutil.rmtree(folder, ignore_errors=True)


def _ignore(line):
    """For who wants no log."""


def tr(text):
    """`text` in the user's language."""
    return QCoreApplication.translate("Making", text)
