"""The README, the tutorial and three how-to pages work as they are typed, and show what the program prints."""

from __future__ import annotations

import gzip
import json
import re
import runpy
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from matplotlib.image import imread

from furrowmap.core.values.rotation import mounting_rotation
from tests.one_pass import make_one_pass
from tests.typed_pages import type_page

CHECKOUT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def typed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The folder in which the tutorial was followed, and what its commands printed."""
    folder = tmp_path_factory.mktemp("tutorial")
    return folder, type_page("tutorial/first-map.md", folder)


@pytest.fixture(scope="module")
def tutorial(typed: tuple[Path, dict[str, str]]) -> Path:
    """The folder in which the tutorial was followed."""
    folder, outputs = typed
    assert set(outputs) == {"simulate", "inspect", "init", "run"}
    return folder


@pytest.fixture(scope="module")
def own_recording(typed: tuple[Path, dict[str, str]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the page about recordings of one's own was followed, with the tutorial's recording.

    Its session is that of the tutorial (see the test below), and so is its result.
    """
    tutorial, outputs = typed
    folder = tmp_path_factory.mktemp("own")
    (folder / "recording.pcap").write_bytes(gzip.decompress((tutorial / "first" / "recording.pcap.gz").read_bytes()))
    shutil.copyfile(tutorial / "first" / "gnss.nmea", folder / "gnss.nmea")
    shutil.copytree(tutorial / "first" / "result", folder / "result")
    known = {"furrowmap run session.toml -o result": outputs["run"].replace("first/", "")}
    assert set(type_page("how-to/run-your-own-recording.md", folder, known)) == {"inspect", "init", "run"}
    return folder


def test_readme__is_typed_with_a_recording(
    made_once: Callable[[str, Callable[[Path], object]], Path], tmp_path: Path
) -> None:
    """Nothing is entered in the session, as by somebody in a hurry: a result all the same."""
    for name in ("recording.pcap", "gnss.nmea"):
        shutil.copyfile(made_once("one_pass", make_one_pass) / "drive" / name, tmp_path / name)
    assert set(type_page("../README.md", tmp_path)) == {"inspect", "init", "run"}
    page = (CHECKOUT / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"result/([\w.]+)", page))
    files = {path.name for path in (tmp_path / "result").iterdir()}
    assert {"report.html", "cloud.copc.laz", "dsm.tif", "field.gpkg"} == named
    assert named <= files


def test_own_recording__comes_to_the_session_of_the_tutorial(tutorial: Path, own_recording: Path) -> None:
    """But for its name and for the boundary, which no figure on the page depends on."""
    one, other = (
        tomllib.loads(path.read_text(encoding="utf-8"))
        for path in (tutorial / "first" / "mine.toml", own_recording / "session.toml")
    )
    assert one.pop("field") == {"boundary": "boundary.geojson"}
    for session in (one, other):
        del session["name"]
        session["recording"]["lidar"] = [name.removesuffix(".gz") for name in session["recording"]["lidar"]]
    assert one == other


def test_python__page_does_what_it_shows(own_recording: Path) -> None:
    assert "no-result" in type_page("how-to/use-from-python.md", own_recording)["python"]


def test_flight__after_filling_in_what_init_lists_finds_its_mounting(tmp_path: Path) -> None:
    shown = type_page("how-to/process-a-flight.md", tmp_path)
    assert {"simulate", "inspect", "init", "run"} <= set(shown)
    proposed = (tmp_path / "flight" / "mine.toml").read_text(encoding="utf-8")
    assert "FILL-IN" not in proposed
    report = json.loads((tmp_path / "flight" / "result" / "report.json").read_text(encoding="utf-8"))
    scenario = tomllib.loads((tmp_path / "flight" / "scenario.toml").read_text(encoding="utf-8"))
    found, true = (
        mounting_rotation(*rpy)
        for rpy in (report["calibration"]["lidar"]["rpy_deg"], scenario["lidar"]["true_rpy_deg"])
    )
    off_deg = np.degrees(np.arccos(min((np.trace(found @ true.T) - 1.0) / 2.0, 1.0)))
    assert off_deg < 0.03


def test_tutorial__mounting_is_the_simulated_one(tutorial: Path) -> None:
    mine, simulated = (tomllib.loads((tutorial / "first" / name).read_text()) for name in ("mine.toml", "session.toml"))
    places = ("antenna", "lidar", "implement", "field")
    assert [mine[table] for table in places] == [simulated[table] for table in places]


def test_demo__draws_such_a_result(tutorial: Path, tmp_path: Path) -> None:
    demo = runpy.run_path(str(CHECKOUT / "scripts" / "demo.py"))
    demo["draw_map"](tutorial / "first" / "result", tmp_path / "map.png", "The tutorial's map")
    assert imread(tmp_path / "map.png").shape[1] == 1500


def test_tutorial__ends_with_files_that_open_in_qgis(tutorial: Path, qgis) -> None:
    result = tutorial / "first" / "result"
    layers = qgis.open_layers(result / "cloud.copc.laz", result / "field.gpkg")
    assert [layer["provider"] for layer in layers] == ["copc", *["ogr"] * (len(layers) - 1)]
    assert {(layer["crs"], layer["valid"]) for layer in layers} == {("EPSG:6677", True)}
    with laspy.open(result / "cloud.copc.laz") as cloud:
        assert layers[0]["count"] == cloud.header.point_count > 1_000_000
    counts = {layer["name"]: layer["count"] for layer in layers}
    assert counts["trajectory"] > 100
    assert counts["passes"] == 3
