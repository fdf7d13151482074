# SPDX-License-Identifier: GPL-2.0-or-later
"""Saved machines: files with the places of sensors and tool, in the same folder as those of the command line."""

import os
import re
import shutil
import sys
from pathlib import Path

from .session_lines import NotSimpleError, SessionLines

SUFFIX = ".toml"
PLACES = (
    ("antenna", "xyz_m"),
    ("lidar", "xyz_m"),
    ("lidar", "rpy_deg"),
    ("implement", "kind"),
    ("implement", "width_m"),
    ("implement", "xy_m"),
    ("implement", "working_depth_m"),
)
"""What the form of a session has of a machine: table and key."""
_SCHEMA = re.compile(r"^furrowmap_machine\s*=", re.MULTILINE)


def machines_folder():
    """The folder of the saved machines, which need not exist."""
    stated = os.environ.get("FURROWMAP_MACHINES")
    return Path(stated) if stated else _user_data() / "furrowmap" / "machines"


def machine_names():
    """Names of the saved machines."""
    return sorted(path.stem for path in machines_folder().glob(f"*{SUFFIX}"))


def machine_path(name):
    """The file of a saved machine."""
    return machines_folder() / f"{name}{SUFFIX}"


def is_machine(path):
    """Whether a file is the profile of a machine."""
    try:
        return path.suffix.lower() == SUFFIX and _SCHEMA.search(path.read_text(encoding="utf-8")) is not None
    except (OSError, UnicodeDecodeError):
        return False


def read_places(path):
    """The values of :data:`PLACES` in a profile, None where it has none.

    Raises:
        OSError, UnicodeDecodeError: if it cannot be read.
        NotSimpleError: if it is not written as `furrowmap machine save` does.
    """
    lines = SessionLines(Path(path).read_text(encoding="utf-8"))
    return {place: lines.get(*place) for place in PLACES}


def add_machine(path):
    """Copy a profile among the saved machines; returns its name. A machine of this name is not replaced.

    Raises:
        OSError: if it cannot be written, or there is another machine of this name.
    """
    path, folder = Path(path), machines_folder()
    target = machine_path(path.stem)
    if target.exists() and target.read_bytes() != path.read_bytes():
        raise FileExistsError(17, "there is another machine of this name", str(target))
    folder.mkdir(parents=True, exist_ok=True)
    if not target.exists():
        shutil.copyfile(path, target)
    return path.stem


def _user_data():
    """The data folder of this user, as the command line has it."""
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")


__all__ = ["NotSimpleError", "add_machine", "is_machine", "machine_names", "machine_path", "read_places"]
