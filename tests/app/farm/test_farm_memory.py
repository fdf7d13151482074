"""What a farm map remembers: history as page and table, traffic, and task data beside runs."""

from __future__ import annotations

import csv
import datetime as dt
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import rasterio
from rio_cogeo.cogeo import cog_validate

import furrowmap
from furrowmap.core.runtime.errors import InputError, RefusedError, UsageError
from tests.app.told_progress import Told
from tests.exporters.exchange.test_task_data import products  # noqa: F401 (a fixture)
from tests.exporters.farm.result_folders import write_result

WHEELS = furrowmap.Wheels(1.4, 0.4)


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A farm map of three sessions on the same field, the third of them in the season after."""
    root = tmp_path_factory.mktemp("farm")
    folders = [
        write_result(root / f"{k}", name=name, recording=f"{k}" * 64, day=day)
        for k, (name, day) in enumerate([("圃場 <1>", 0), ("=second", 30), ("third", 360)])
    ]
    path = root / "farm.gpkg"
    furrowmap.add_to_farm_map(path, folders, season_start="06-05")
    return path


def test_tables__have_the_field_its_seasons_and_the_machine(farm: Path) -> None:
    memory = furrowmap.farm_memory(farm)
    assert [(row["name"], row["sessions"]) for row in memory.fields] == [("圃場 <1>", 3)]
    assert [(row["season"], row["times_worked"]) for row in memory.seasons] == [(2026, 2), (2027, 1)]
    assert memory.seasons[0]["worked_area_m2"] == pytest.approx(2 * 75.5)
    assert memory.seasons[0]["hours"] is None
    assert [(row["machine"], row["sessions"]) for row in memory.machines] == [("rotary tiller", 3)]


def test_history__is_a_page_in_japanese_and_a_table(farm: Path, tmp_path: Path) -> None:
    page, table = tmp_path / "history.html", tmp_path / "history.csv"
    found = furrowmap.field_history(farm, "圃場 <1>", page, language="ja")
    text = page.read_text("utf-8")
    assert '<html lang="ja">' in text
    for word in ("圃場の履歴", "作業回数", "シーズン", "圃場 &lt;1&gt;", "2027-06-07"):
        assert word in text
    assert "times worked" not in text.partition("</head>")[2]
    assert [row["date"] for row in found.visits] == ["2027-06-07", "2026-07-12", "2026-06-12"]
    furrowmap.field_history(farm, found.field["field"][:6], table)
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    assert [row["name"] for row in rows] == ["third", "'=second", "圃場 <1>"]
    assert float(rows[0]["worked_area_m2"]) == 75.5
    with pytest.raises(RefusedError):
        furrowmap.field_history(farm, "圃場 <1>", table)
    with pytest.raises(UsageError, match=r"does not end in \.html or \.csv"):
        furrowmap.field_history(farm, "圃場 <1>", tmp_path / "history.txt")
    with pytest.raises(InputError, match="no field 'fourth'") as caught:
        furrowmap.field_history(farm, "fourth")
    assert caught.value.code == "no-such-field"


def test_traffic__is_that_of_the_polygons_and_the_tracks(farm: Path, tmp_path: Path) -> None:
    made = furrowmap.farm_traffic(
        farm, tmp_path / "t.tif", furrowmap.TrafficSettings(season=2026, cell_m=0.05, wheels=WHEELS), progress=Told()
    )
    assert (made.sessions, made.passes) == (2, 6)
    assert cog_validate(made.path)[0]
    with rasterio.open(made.path) as raster:
        worked, last, driven = raster.read()
        assert raster.dtypes == ("uint16",) * 3
    passes, tracks = (gpd.read_file(farm, layer=name).iloc[:n] for name, n in (("passes", 6), ("tracks", 2)))
    assert worked.sum() * 0.0025 == pytest.approx(passes.area.sum(), rel=0.03)  # edges along rows of cells
    assert driven.sum() * 0.0025 == pytest.approx(tracks.length.sum() * 2 * 0.4, rel=0.005)
    assert set(np.unique(last)) == {0, (dt.date(2026, 7, 12) - dt.date(1970, 1, 1)).days}
    with pytest.raises(InputError, match="no sessions of that time") as caught:
        furrowmap.farm_traffic(farm, tmp_path / "none.tif", furrowmap.TrafficSettings(since=dt.date(2030, 1, 1)))
    assert caught.value.code == "no-traffic"


def test_day__that_is_none_is_refused(farm: Path) -> None:
    with pytest.raises(UsageError, match="'13-01' is not a month and a day"):
        furrowmap.add_to_farm_map(farm, [], season_start="13-01")


def test_task_data__are_sessions_too(products: Path, tmp_path: Path) -> None:  # noqa: F811
    furrowmap.export([products], "isoxml", tmp_path / "TASKDATA")
    worked, farm = tmp_path / "fields.gpkg", tmp_path / "farm.gpkg"
    figures = furrowmap.fields(tmp_path / "TASKDATA", worked, crs="EPSG:6677").rows[0]
    first = furrowmap.add_to_farm_map(farm, [worked])
    assert len(first.added) == 1
    assert furrowmap.add_to_farm_map(farm, [worked]).unchanged == first.added
    worked.unlink()
    furrowmap.fields(tmp_path / "TASKDATA", worked, crs="EPSG:6677", width_m=1.8)
    assert furrowmap.add_to_farm_map(farm, [worked]).replaced == first.added
    season = furrowmap.farm_memory(farm).seasons[0]
    assert season["worked_area_m2"] == pytest.approx(figures["worked_area_m2"] * 1.8 / 1.7, rel=0.03)
    assert season["times_worked"] == 1
    run = write_result(tmp_path / "run")
    furrowmap.add_to_farm_map(farm, [run])
    assert [row["sessions"] for row in furrowmap.farm_memory(farm).fields] == [2]
    folders = [session.folder for session in furrowmap.farm_map_sessions(farm)[2]]
    assert folders == [worked.as_posix(), run.as_posix()]
    for wrong in (tmp_path / "none.gpkg", run / "field.gpkg"):
        with pytest.raises(InputError) as caught:
            furrowmap.add_to_farm_map(farm, [wrong])
        assert caught.value.code == "no-task-result"
