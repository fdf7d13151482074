"""What the site of QGIS's plugins checks of an upload, as far as it can be checked here.

Its rules: bandit's critical tests, detect-secrets, some of flake8, names and sizes in the zip, the metadata. That enums
are named as Qt 6 has them is tested in QGIS itself, by test_algorithms.py.
"""

from __future__ import annotations

import configparser
import re
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from furrowmap.workflows.share.qgis_plugin import write_plugin_zip

CHECKOUT = Path(__file__).resolve().parents[2]
PLUGIN = CHECKOUT / "plugin"
SOURCES = sorted(PLUGIN.rglob("*.py"))
sys.path.insert(0, str(CHECKOUT / "scripts"))
import release_check  # noqa: E402

Check = Callable[[Path], Iterator[str]]


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site") / "furrowmap.zip"
    write_plugin_zip(out)
    return out


@pytest.fixture(scope="module")
def unpacked(archive: Path) -> Path:
    folder = archive.parent / "unpacked"
    with zipfile.ZipFile(archive) as file:
        file.extractall(folder)
    return folder / "furrowmap"


PLANTED = {
    release_check.bandit: ("exec('1')\n", "bandit: planted.py:1 B102"),
    release_check.secrets: ('AWS = "AKIA2E0A8F3B244C9986"\n', "detect-secrets: planted.py:1 AWS Access Key"),
    release_check.flake8: ("x = unknown\n", "flake8: ./planted.py:1:5: F821 undefined name 'unknown'"),
}


@pytest.mark.parametrize("check", PLANTED, ids=lambda check: check.__name__)
def test_checks_of_the_site__find_nothing_but_what_was_planted(check: Check, unpacked: Path, tmp_path: Path) -> None:
    assert list(check(unpacked)) == []
    text, found = PLANTED[check]
    (tmp_path / "planted.py").write_text(text)
    assert found in list(check(tmp_path))


def test_metadata__is_whole(unpacked: Path, tmp_path: Path) -> None:
    assert list(release_check.metadata_of(unpacked)) == []
    text = (unpacked / "metadata.txt").read_text(encoding="utf-8")
    for key in ("changelog", "homepage", "about"):
        (tmp_path / "metadata.txt").write_text(re.sub(f"{key}=.*", "", text), encoding="utf-8")
        assert f"metadata.txt has no {key}" in list(release_check.metadata_of(tmp_path))


def test_zip__has_no_name_that_is_refused(archive: Path, tmp_path: Path) -> None:
    assert list(release_check.in_zip(archive)) == []
    with zipfile.ZipFile(tmp_path / "wrong.zip", "w") as file:
        for name in ("furrowmap/__pycache__/a.pyc", "../b.py", "furrowmap/tool.exe"):
            file.writestr(name, "")
    found = "\n".join(release_check.in_zip(tmp_path / "wrong.zip"))
    assert all(name in found for name in ("a.pyc", "../b.py", "tool.exe", "no LICENSE", "no metadata.txt"))


def test_zip__holds_the_plugin_and_nothing_binary(archive: Path) -> None:
    assert archive.stat().st_size < 1_000_000
    with zipfile.ZipFile(archive) as file:
        names = file.namelist()
        for name in names:
            file.read(name).decode("utf-8")  # raises where it is no text
    for name in names:
        assert re.fullmatch(
            r"furrowmap/([a-z0-9_]+/)*([A-Za-z0-9_]+\.(py|json|ts|svg|txt|html|css|qml|qpt)|LICENSE)", name
        )
    folders = {Path(name).parent for name in names if name.endswith(".py")}
    assert {f"{folder.as_posix()}/__init__.py" for folder in folders} <= set(names)


def test_metadata__keeps_the_sites_rules(unpacked: Path) -> None:
    parser = configparser.ConfigParser(interpolation=None)
    parser.read(unpacked / "metadata.txt", encoding="utf-8")
    general = parser["general"]
    for key in ("homepage", "tracker", "repository"):
        assert re.fullmatch(r"https://\S+", general[key]), key
    assert re.fullmatch(r"[^@\s]+@[^@\s]+\.\w+", general["email"])
    assert (unpacked / general["icon"]).is_file()
    assert general["hasProcessingProvider"] == "yes"
    assert "supportsQt6" not in general
    assert "Python" in general["about"]  # what it needs beside QGIS is stated
