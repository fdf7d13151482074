"""QGIS's user profiles on this machine, and how a plugin gets into one."""

from __future__ import annotations

import configparser
import json
import os
import shutil
import sys
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

from furrowmap.core.values.errors import InputError, RefusedError
from furrowmap.exporters.files.atomic import atomic_output

PLUGIN: Final = "furrowmap"
INSTALLED_BY: Final = "installed_by.json"
"""In the plugin's folder: the Python interpreter that furrowmap runs in, which the plugin lets do the work."""
_RELEASES: Final = ("QGIS3", "QGIS4")
_SWITCH: Final = ("PythonPlugins", PLUGIN, "true")


@dataclass(frozen=True)
class Profile:
    """A profile of a user of QGIS.

    Attributes:
        folder: of the profile.
        settings: the file of its settings, which may not be there yet.
    """

    folder: Path
    settings: Path

    @property
    def plugins(self) -> Path:
        """Where its plugins lie."""
        return self.folder / "python" / "plugins"


def find_profiles(name: str | None, data: Path | None = None) -> list[Profile]:
    """The profiles of that name, or each release's default one; of QGIS 3 and of QGIS 4, where both were used.

    Args:
        name: None for the default.
        data: where this user's programs keep their data, by default as the system has it.

    Raises:
        InputError: if there is none.
    """
    found, others = [], []
    for release in _RELEASES:
        root = (data or _user_data()) / "QGIS" / release / "profiles"
        here = sorted(path for path in root.iterdir() if path.is_dir()) if root.is_dir() else []
        wanted = name if name is not None else _default_profile(root)
        others += [path.name for path in here]
        found += [Profile(path, path / "QGIS" / f"{release}.ini") for path in here if path.name == wanted]
    if not found:
        there = f"There are: {', '.join(dict.fromkeys(others))}." if others else "QGIS has made none for this user yet."
        raise InputError(
            f"There is no QGIS profile {name or 'default'!r}. {there}",
            "The plugin was not installed.",
            "Start QGIS once, name another one with --profile, or the folder for plugins with --plugins-folder.",
            code="no-qgis-profile",
        )
    return found


def install_plugin(plugins: Path) -> Path:
    """Put the plugin that came with this furrowmap into a folder for plugins; an earlier version of it is replaced.

    Returns:
        The plugin's folder.

    Raises:
        RefusedError: if something else has its name.
        OSError: if the folder cannot be written to.
    """
    target = plugins / PLUGIN
    if target.is_symlink() or (target.exists() and not _is_plugin(target)):
        raise RefusedError(
            f"{target} is there, but was not installed as the furrowmap plugin.",
            "It would be replaced, so nothing was done.",
            "Move it away, or name another folder with --plugins-folder.",
            code="exists",
        )
    unfinished, old = (plugins / f".{PLUGIN}.{suffix}" for suffix in ("new", "old"))
    plugins.mkdir(parents=True, exist_ok=True)
    try:
        for folder in (unfinished, old):
            shutil.rmtree(folder, ignore_errors=True)
        with as_file(files("furrowmap.plugin")) as source:
            shutil.copytree(source, unfinished, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
        told = {"python": sys.executable, "version": version("furrowmap")}
        (unfinished / INSTALLED_BY).write_text(json.dumps(told), encoding="utf-8")
        if target.exists():
            target.rename(old)
        unfinished.rename(target)
    finally:
        if old.exists() and not target.exists():
            old.rename(target)
        for folder in (unfinished, old):
            shutil.rmtree(folder, ignore_errors=True)
    return target


def enable_plugin(settings: Path) -> None:
    """Switch the plugin on in a profile's settings, whose other lines stay as they are."""
    text = settings.read_text(encoding="utf-8", errors="surrogateescape") if settings.is_file() else ""
    settings.parent.mkdir(parents=True, exist_ok=True)
    with atomic_output(settings) as unfinished:
        unfinished.write_text(with_setting(text, *_SWITCH), encoding="utf-8", errors="surrogateescape")


def with_setting(text: str, section: str, key: str, value: str) -> str:
    """Qt's settings (INI) with one value set."""
    lines = text.splitlines()
    head, line = f"[{section}]", f"{key}={value}"
    if head not in lines:
        return "\n".join([*lines, *([""] if lines else []), head, line, ""])
    begin = lines.index(head) + 1
    end = next((k for k in range(begin, len(lines)) if lines[k].startswith("[")), len(lines))
    kept = [old for old in lines[begin:end] if old.split("=")[0].strip() != key]
    return "\n".join([*lines[:begin], line, *kept, *lines[end:], ""])


def _is_plugin(folder: Path) -> bool:
    metadata = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        metadata.read(folder / "metadata.txt", encoding="utf-8")
    except (configparser.Error, UnicodeDecodeError):
        return False
    return metadata.get("general", "name", fallback="") == PLUGIN


def _default_profile(root: Path) -> str:
    settings = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        settings.read(root / "profiles.ini", encoding="utf-8")
    except (configparser.Error, UnicodeDecodeError):
        return "default"
    return settings.get("core", "defaultProfile", fallback="default")


def _user_data() -> Path:
    """Where this user's programs keep their data."""
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
