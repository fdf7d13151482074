"""QGIS user profiles on this machine, installation of the plugin in one, the plugin as a zip, the example notebooks."""

import configparser
import json
import os
import shutil
import sys
import zipfile
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.runtime.write_errors import writing
from furrowmap.exporters.files.atomic import atomic_output, made_folder, refuse_existing
from furrowmap.exporters.files.staging import staged_folder


def write_notebooks(folder: Path) -> list[Path]:
    """Write the notebooks into a folder; their paths. RefusedError if one of them is there."""
    bundled = files("furrowmap").joinpath("notebooks")
    sources = {folder / source.name: source for source in bundled.iterdir() if source.name.endswith(".ipynb")}
    for path in sources:
        refuse_existing(path, overwrite=False)
    with staged_folder(folder) as staging:
        for path, source in sources.items():
            (staging / path.name).write_bytes(source.read_bytes())
    return sorted(sources)


PLUGIN: Final = "furrowmap"
INSTALLED_BY: Final = "installed_by.json"
"""File in the plugin's folder that names the Python interpreter in which the plugin runs furrowmap."""
_RELEASES: Final = ("QGIS3", "QGIS4")
_SWITCH: Final = ("PythonPlugins", PLUGIN, "true")


@dataclass(frozen=True)
class Profile:
    """A QGIS user profile; its settings file may not exist yet."""

    folder: Path
    settings: Path

    @property
    def plugins(self) -> Path:
        """The folder of its plugins."""
        return self.folder / "python" / "plugins"


def find_profiles(name: str | None, data: Path | None = None) -> list[Profile]:
    """The profiles of this name, or the default ones, of QGIS 3 and QGIS 4; `data` is the data folder of the user."""
    found = []
    others = []
    for release in _RELEASES:
        root = (data or user_data()) / "QGIS" / release / "profiles"
        here = sorted(path for path in root.iterdir() if path.is_dir()) if root.is_dir() else []
        wanted = name if name is not None else _ini_value(root / "profiles.ini", "core", "defaultProfile") or "default"
        others += [path.name for path in here]
        found += [Profile(path, path / "QGIS" / f"{release}.ini") for path in here if path.name == wanted]
    if not found:
        raise InputError(
            "no-qgis-profile", name=name or "default", others_list=", ".join(dict.fromkeys(others)) if others else None
        )
    return found


def install_plugin(plugins: Path) -> Path:
    """Install the bundled plugin in a plugins folder, replacing an earlier version; the folder of the plugin."""
    target = plugins / PLUGIN
    if target.is_symlink() or (target.exists() and _ini_value(target / "metadata.txt", "general", "name") != PLUGIN):
        raise RefusedError("exists.foreign-plugin", target=target)
    unfinished, old = (plugins / f".{PLUGIN}.{suffix}" for suffix in ("new", "old"))
    with made_folder(plugins), writing(target):
        try:
            for folder in (unfinished, old):
                shutil.rmtree(folder, ignore_errors=True)
            with as_file(files("furrowmap.plugin")) as source:
                _copy_tree(source, unfinished)
            record = {"python": sys.executable, "version": version("furrowmap")}
            (unfinished / INSTALLED_BY).write_text(json.dumps(record), encoding="utf-8")
            if target.exists():
                target.rename(old)
            unfinished.rename(target)
        finally:
            if old.exists() and not target.exists():
                old.rename(target)
            for folder in (unfinished, old):
                shutil.rmtree(folder, ignore_errors=True)
    return target


def _copy_tree(source: Path, target: Path) -> None:
    """Copy a folder; the first error ends it, while shutil.copytree tries all others and keeps their texts alone."""
    target.mkdir()
    for path in sorted(source.iterdir()):
        if path.is_dir() and path.name != "__pycache__":
            _copy_tree(path, target / path.name)
        elif path.is_file() and path.suffix != ".pyc":
            shutil.copyfile(path, target / path.name)


def write_plugin_zip(out: Path) -> None:
    """Write the bundled plugin as a zip for QGIS, always the same bytes; raises RefusedError if the file exists."""
    refuse_existing(out, overwrite=False)
    out.parent.mkdir(parents=True, exist_ok=True)
    with (
        as_file(files("furrowmap.plugin")) as source,
        atomic_output(out) as unfinished,
        zipfile.ZipFile(unfinished, "w") as archive,
    ):
        for path in sorted(source.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                entry = zipfile.ZipInfo(f"{PLUGIN}/{path.relative_to(source).as_posix()}")
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)


def enable_plugin(settings: Path) -> None:
    """Enable the plugin in the settings of a profile; other lines are kept."""
    text = settings.read_text(encoding="utf-8", errors="surrogateescape") if settings.is_file() else ""
    settings.parent.mkdir(parents=True, exist_ok=True)
    with atomic_output(settings) as unfinished:
        unfinished.write_text(with_setting(text, *_SWITCH), encoding="utf-8", errors="surrogateescape")


def with_setting(text: str, section: str, key: str, value: str) -> str:
    """Qt settings (INI) with one value set."""
    lines = text.splitlines()
    head = f"[{section}]"
    line = f"{key}={value}"
    if head not in lines:
        return "\n".join([*lines, *([""] if lines else []), head, line, ""])
    begin = lines.index(head) + 1
    end = next((k for k in range(begin, len(lines)) if lines[k].startswith("[")), len(lines))
    kept = [old for old in lines[begin:end] if old.split("=")[0].strip() != key]
    return "\n".join([*lines[:begin], line, *kept, *lines[end:], ""])


def _ini_value(path: Path, section: str, key: str) -> str | None:
    """A value of a settings file; None without one, or in a damaged file."""
    settings = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        settings.read(path, encoding="utf-8")
    except (configparser.Error, UnicodeDecodeError):
        return None
    return settings.get(section, key, fallback=None)


def user_data() -> Path:
    """The data folder of this user."""
    if sys.platform == "win32":
        data = Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")
    elif sys.platform == "darwin":
        data = Path.home() / "Library" / "Application Support"
    else:
        data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    return data
