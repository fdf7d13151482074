"""The project: layers of the user survive, titles and legends hold, results do not overlie, the dock follows."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import rasterio

import furrowmap
from tests.plugin.dock.test_ends import HERE, unpacked_plugin, worker_in
from tests.test_end_to_end import session_folder
from tests.test_flight_end_to_end import flight_session

if TYPE_CHECKING:
    from conftest import QgisRoot

LANGUAGES = ("en", "de", "ja")
CLEARING = (
    *("add to map", "rerun", "drop on the dock", "drop on the window", "preview dropped", "another session", "batch"),
    *("replay", "themes", "farm map", "base map", "cloud", "surfaces", "plugin reloaded"),
)
"""What removes or replaces layers of the plugin's."""
UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "": 1.0}
WITHOUT_SCALE = ("dsm", "dsm_before", "dtm", "orthophoto")
"""Reliefs and pictures, whose colours are no numbers."""


@pytest.fixture(scope="module")
def seen(
    qgis: QgisRoot,
    shared_data: Path,
    run_once: Callable[[str, Callable[[Path], Path]], furrowmap.Result],
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Any]:
    """What use_project.py has seen; the paths are those of its copies."""
    work = tmp_path_factory.mktemp("project")
    sessions = {
        "tractor_loop": partial(session_folder, shared_data, "tractor_loop", truth=False),
        "uav_wheat": partial(flight_session, shared_data),
    }
    folders = []
    for name, session in sessions.items():
        result = run_once(name, session)
        session(work / name)
        shutil.copytree(result.path, work / name / "session_result")
        folders.append(work / name / "session_result")
    worker = worker_in(work / "worker")
    plugins = unpacked_plugin(work / "plugins")
    cloud = folders[0] / "cloud.copc.laz"
    command = ("scripts/qgis_desktop.sh", plugins, HERE / "use_project.py", worker, *folders, cloud, work / "out")
    told = qgis.run(*command, timeout_s=500)
    found: dict[str, Any] = json.loads(next(line for line in told.splitlines() if line.startswith("{")))
    return found


@pytest.mark.parametrize("action", CLEARING)
def test_users_layers__survive_every_action_that_clears(seen: dict[str, Any], action: str) -> None:
    assert seen["placed"] == []
    assert seen["lost"][action] == []
    assert seen["unread"][action] == []


def test_actions_that_clear__are_all_there(seen: dict[str, Any]) -> None:
    assert tuple(seen["lost"]) == CLEARING


@pytest.mark.parametrize("language", LANGUAGES)
def test_legend__has_the_unit_and_the_ends_of_the_raster(seen: dict[str, Any], language: str) -> None:
    legends = seen["languages"][language]["legends"]
    assert len(legends) >= 9
    for name, legend in legends.items():
        key = name.partition(" ")[2]
        if key in WITHOUT_SCALE:
            continue
        with rasterio.open(legend["path"]) as raster:
            unit = raster.units[0] or ""
        stated = re.search(r"[(（]([^)）]*)[)）]", legend["title"])
        assert (stated is not None) == (unit == "m"), name
        for label, value in zip(legend["ends"], legend["values"], strict=True):
            number = re.match(r"(-?[\d.]+)\s*([^\W\d]*)", label.replace(",", "."))
            if number is None:  # words for the value zero
                assert value == 0.0, name
                continue
            assert float(number[1]) * UNITS.get(number[2], 1.0) == pytest.approx(value), name
            assert stated is None or number[2] == stated[1], name


@pytest.mark.parametrize("language", LANGUAGES)
def test_saved_project__has_titles_themes_and_the_page_of_its_result_again(seen: dict[str, Any], language: str) -> None:
    found = seen["languages"][language]
    assert found["titles again"] == found["titles"]
    assert all(title != key for key, title in found["titles"])
    assert len(found["themes"]) == 6
    assert found["themes again"] == found["themes"]
    assert found["page without project"] == "start"
    page, folder, theme = found["page again"]
    assert (page, Path(folder).parent.name, theme) == ("result", "uav_wheat", "crops")


def test_titles__are_in_the_language_of_qgis(seen: dict[str, Any]) -> None:
    titles = {language: dict(seen["languages"][language]["titles"]) for language in LANGUAGES}
    assert titles["en"]["coverage"] == "Worked ground"
    assert titles["de"]["coverage"] == "Bearbeiteter Boden"
    assert titles["ja"]["coverage"] == "作業した範囲"
    assert not {key for key, title in titles["ja"].items() if title.isascii()}


def test_second_result__hides_the_first_and_takes_its_crs(seen: dict[str, Any]) -> None:
    assert len(seen["seen together"]) == 1
    assert seen["crs"] == "EPSG:25832"
    assert seen["crs beside mine"] == "EPSG:6677"
    assert "outside of the area" in seen["offered crs"]
    assert seen["crs taken"] == "EPSG:25832"


def test_themes__are_map_themes_of_qgis(seen: dict[str, Any]) -> None:
    work, crops = seen["by QGIS's themes"].values()
    assert "coverage" in work
    assert "parcels" not in work
    assert "parcels" in crops
    assert "coverage" not in crops


def test_printed_page__explains_every_colour_on_the_map(seen: dict[str, Any]) -> None:
    assert len(seen["printed"]) == 6
    for page, (explained, shown) in seen["printed"].items():
        seen_as = {"passes" if key == "coverage" else key for key in shown if key not in WITHOUT_SCALE}
        assert set(explained) == seen_as, page


def test_replay__gives_the_temporal_controller_back(seen: dict[str, Any]) -> None:
    for ended in ("controller", "controller turned off"):
        before, after = seen[ended]
        assert after == before
        assert seen["replaying"] != before


def test_surfaces__come_as_one_group_of_which_one_is_seen(seen: dict[str, Any]) -> None:
    assert len(seen["surfaces"]["group"]) == 1
    layers = seen["surfaces"]["layers"]
    assert [key for key, _, visible in layers if visible] == ["dsm"]
    assert all(key != title for key, title, _ in layers)
