"""What the site of QGIS's plugins checks of an upload, as far as it can be checked here.

Its rules: bandit's critical tests, detect-secrets, some of flake8, names and sizes in the zip, the metadata. That enums
are named as Qt 6 has them is tested in QGIS itself, by test_algorithms.py.
"""

from __future__ import annotations

import configparser
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from furrowmap.workflows.share.qgis_plugin import write_plugin_zip

CHECKOUT = Path(__file__).resolve().parents[2]
PLUGIN = CHECKOUT / "plugin"
SOURCES = sorted(PLUGIN.rglob("*.py"))
BANDIT = (
    "B102,B103,B105,B106,B107,B108,B202,B301,B302,B303,B304,B305,B306,B307,B310,B312,B313,B314,B315,B316,B317,B318,"
    "B319,B320,B321,B323,B324,B501,B502,B503,B505,B506,B507,B508,B509,B602,B604,B605,B609,B610,B611,B701,B702"
)


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


def test_bandit__finds_nothing_critical(unpacked: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "bandit",
        "--quiet",
        "--recursive",
        "--format",
        "json",
        "--tests",
        BANDIT,
        unpacked,
    ]
    answer = json.loads(subprocess.run(command, capture_output=True, text=True, check=False).stdout)
    assert answer["errors"] == []
    assert len(answer["metrics"]) > len(SOURCES)  # all of them, and the totals
    assert [f"{found['filename']}:{found['line_number']} {found['test_id']}" for found in answer["results"]] == []


def test_detect_secrets__finds_none(unpacked: Path) -> None:
    command = [sys.executable, "-m", "detect_secrets", "scan", "--all-files", "."]
    answer = json.loads(subprocess.run(command, cwd=unpacked, capture_output=True, text=True, check=True).stdout)
    assert len(answer["plugins_used"]) > 20
    assert answer["results"] == {}


def test_flake8__finds_no_error_that_counts(unpacked: Path) -> None:
    command = [sys.executable, "-m", "flake8", "--isolated", "--select", "E9,F821,F823,F831", unpacked]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


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
