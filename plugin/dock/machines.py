# SPDX-License-Identifier: GPL-2.0-or-later
"""Saved machines: files with the places of sensors and tool, in the same folder as those of the command line."""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any

from ..platforms import user_data
from .session_lines import SessionLines

MACHINE_SUFFIX = ".toml"
Places = dict[tuple[str, str], Any]
"""Values of :data:`PLACES` and :data:`LEARNED_FILE`, None where there is none."""
PLACES = (
    ("antenna", "xyz_m"),
    ("lidar", "xyz_m"),
    ("lidar", "rpy_deg"),
    ("imu", "xyz_m"),
    ("imu", "rpy_deg"),
    ("imu", "class"),
    ("camera", "xyz_m"),
    ("camera", "rpy_deg"),
    ("implement", "kind"),
    ("implement", "width_m"),
    ("implement", "xy_m"),
    ("implement", "working_depth_m"),
)
"""What the form of a session has of a machine: table and key."""
LEARNED_FILE = ("implement", "learned")
_SCHEMA = re.compile(r"^furrowmap_machine\s*=", re.MULTILINE)
_LEARNED = re.compile(r'^learned = "([^"/\\]+\.npz)"', re.MULTILINE)


def machines_folder() -> Path:
    """The folder of the saved machines, the same as that of the command line; it need not exist."""
    stated = os.environ.get("FURROWMAP_MACHINES")
    return Path(stated) if stated else user_data(sys.platform, os.environ, Path.home()) / "furrowmap" / "machines"


def machine_names() -> list[str]:
    """Names of the saved machines."""
    return sorted(path.stem for path in machines_folder().glob(f"*{MACHINE_SUFFIX}"))


def machine_path(name: str) -> Path:
    """The file of a saved machine."""
    return machines_folder() / f"{name}{MACHINE_SUFFIX}"


def is_machine(path: Path) -> bool:
    """Whether a file is the profile of a machine."""
    try:
        return path.suffix.lower() == MACHINE_SUFFIX and _SCHEMA.search(path.read_text(encoding="utf-8")) is not None
    except (OSError, UnicodeDecodeError):
        return False


def read_places(path: Path) -> Places:
    """The places in a profile, and the file in which its implement is as a run learned it; None without one.

    Raises OSError, UnicodeDecodeError or, if not as furrowmap writes it, NotSimpleError.
    """
    lines = SessionLines(path.read_text(encoding="utf-8"))
    learned = path.with_name(Path(str(lines.get(*LEARNED_FILE))).name)
    is_there = learned.suffix == ".npz" and learned.is_file()
    return {LEARNED_FILE: learned if is_there else None, **{place: lines.get(*place) for place in PLACES}}


def add_machine(path: Path) -> str:
    """Copy a profile, with what was learned of its implements, among the saved machines; returns its name.

    A machine of this name is not replaced. Raises OSError if it cannot be written, or there is another machine of this
    name.
    """
    target = machine_path(path.stem)
    if target.exists() and target.read_bytes() != path.read_bytes():
        raise FileExistsError(17, "there is another machine of this name", str(target))
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.exists():
        shutil.copyfile(path, target)
        for name in _LEARNED.findall(path.read_text(encoding="utf-8")):
            if path.with_name(name).is_file():
                shutil.copyfile(path.with_name(name), target.with_name(name))
    return path.stem
