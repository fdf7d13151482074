"""`furrowmap qgis install`: the plugin's files, the profiles they get into, and the settings that switch them on."""

from __future__ import annotations

import json
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.workflows.share.qgis_plugin import find_profiles, install_plugin, with_setting

CHECKOUT = Path(__file__).resolve().parents[2]


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which this user's programs keep their data, with two profiles of QGIS 3."""
    for variable in ("XDG_DATA_HOME", "APPDATA", "HOME"):
        monkeypatch.setenv(variable, str(tmp_path))
    return tmp_path


def profile(data: Path, name: str, release: str = "QGIS3") -> Path:
    folder = data / "QGIS" / release / "profiles" / name
    folder.mkdir(parents=True)
    return folder


@pytest.mark.skipif(sys.platform == "darwin", reason="the data folder of macOS lies elsewhere")
def test_install__puts_the_plugin_into_the_default_profile_switched_on(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = profile(data, "default")
    profile(data, "fieldwork")
    settings = folder / "QGIS" / "QGIS3.ini"
    settings.parent.mkdir()
    settings.write_text("[PythonPlugins]\nfurrowmap=false\nother=true\n\n[locale]\nuserLocale=ja\n", encoding="utf-8")

    assert command_line(["qgis", "install", "--json"]) == 0

    answer = json.loads(capsys.readouterr().out)
    plugin = folder / "python" / "plugins" / "furrowmap"
    assert answer == {"installed": [str(plugin)], "enabled": True, "python": sys.executable}
    sources = {p.relative_to(CHECKOUT / "plugin") for p in (CHECKOUT / "plugin").rglob("*.py")}
    assert {p.relative_to(plugin) for p in plugin.rglob("*.py")} == sources
    assert (plugin / "metadata.txt").read_bytes() == (CHECKOUT / "metadata.txt").read_bytes()
    assert (plugin / "LICENSE").is_file()
    assert json.loads((plugin / "installed_by.json").read_text())["python"] == sys.executable
    assert settings.read_text() == "[PythonPlugins]\nfurrowmap=true\nother=true\n\n[locale]\nuserLocale=ja\n"


def test_find_profiles__takes_the_one_that_qgis_starts_with_in_each_release(tmp_path: Path) -> None:
    for release in ("QGIS3", "QGIS4"):
        profile(tmp_path, "圃場", release)
        profile(tmp_path, "default", release)
    (tmp_path / "QGIS" / "QGIS4" / "profiles" / "profiles.ini").write_text(
        "[core]\ndefaultProfile=圃場\n", encoding="utf-8"
    )
    found = find_profiles(None, tmp_path)
    assert [(p.folder.name, p.settings.name) for p in found] == [("default", "QGIS3.ini"), ("圃場", "QGIS4.ini")]
    assert [p.folder.name for p in find_profiles("圃場", tmp_path)] == ["圃場", "圃場"]


def test_find_profiles__names_the_existing_ones(tmp_path: Path) -> None:
    profile(tmp_path, "fieldwork")
    with pytest.raises(InputError, match="Profiles: fieldwork"):
        find_profiles("field", tmp_path)
    with pytest.raises(InputError, match="no QGIS profile yet") as caught:
        find_profiles(None, tmp_path / "nobody")
    assert caught.value.code == "no-qgis-profile"


def test_install_plugin__replaces_an_earlier_version_whole(tmp_path: Path) -> None:
    (tmp_path / "furrowmap").mkdir()
    (tmp_path / "furrowmap" / "metadata.txt").write_text("[general]\nname=furrowmap\nversion=0.0.1\n")
    (tmp_path / "furrowmap" / "gone_since.py").touch()
    install_plugin(tmp_path)
    assert not (tmp_path / "furrowmap" / "gone_since.py").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["furrowmap"]


def test_install_plugin__leaves_what_is_not_the_plugin(tmp_path: Path) -> None:
    (tmp_path / "furrowmap").mkdir()
    (tmp_path / "furrowmap" / "notes.txt").write_text("mine")
    with pytest.raises(RefusedError):
        install_plugin(tmp_path)
    assert (tmp_path / "furrowmap" / "notes.txt").read_text() == "mine"


def test_install__takes_a_folder_or_a_profile(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["qgis", "install", "--plugins-folder", str(tmp_path)]) == 0
    assert "Enable it" in capsys.readouterr().out
    assert command_line(["qgis", "install", "--plugins-folder", str(tmp_path), "--profile", "default"]) == 2


WORD = st.text("abcXYZ09", min_size=1)


@given(st.dictionaries(WORD, st.dictionaries(WORD, WORD), min_size=1), WORD, WORD, WORD)
def test_with_setting__sets_one_value_and_leaves_the_others(
    settings: dict[str, dict[str, str]], section: str, key: str, value: str
) -> None:
    text = "\n".join(
        line
        for name, values in settings.items()
        for line in (f"[{name}]", *(f"{k}={v}" for k, v in values.items()), "")
    )
    settings.setdefault(section, {})[key] = value
    assert read(with_setting(text, section, key, value)) == settings


def read(text: str) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    for line in filter(None, text.splitlines()):
        if line.startswith("["):
            values = found.setdefault(line[1:-1], {})
        else:
            values.update([line.split("=", 1)])
    return found


def test_zip__holds_the_plugin_and_replaces_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command_line(["qgis", "zip", "--json"]) == 0
    name = f"furrowmap-{version('furrowmap')}.zip"
    assert json.loads(capsys.readouterr().out) == {"zip": name}
    with zipfile.ZipFile(name) as archive:
        packed = set(archive.namelist())
    installed = install_plugin(tmp_path / "plugins")
    there = {f"furrowmap/{p.relative_to(installed).as_posix()}" for p in installed.rglob("*") if p.is_file()}
    assert packed == there - {"furrowmap/installed_by.json"}
    assert command_line(["qgis", "zip"]) == 4
    assert "exists already" in capsys.readouterr().err
