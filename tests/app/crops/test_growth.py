"""`furrowmap growth`: from clouds of several days to what each parcel grew."""

from __future__ import annotations

import csv
import datetime as dt
import json
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import openpyxl
import pyproj
import pytest
import shapely

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, UsageError
from tests.app.told_progress import Told

CRS = "EPSG:6677"
EAST, NORTH = -21_500.0, 16_880.0
DAYS = (dt.date(2026, 5, 13), dt.date(2026, 5, 23), dt.date(2026, 6, 2))
OFFSETS_M = (0.0, 0.064, -0.031)
"""Of all heights of each flight."""
TILTS = (0.0, 5e-4, 0.0)
HEIGHTS_M = {"a": (0.30, 0.42, 0.55), "b": (0.30, 0.36, 0.40), "far": (0.0, 0.0, 0.0)}
PLOTS = {"a": shapely.box(0, 0, 4, 1.5), "b": shapely.box(0, 2.5, 4, 4), "far": shapely.box(60, 0, 64, 1.5)}


def write_flight(path: Path, number: int, clock: bool = True, west: float = -1.5) -> Path:
    """A flight over two of the plots, at 8:40 in the morning in Japan: the day before in UTC."""
    rng = np.random.default_rng(number)
    xy = rng.uniform((west, -1.5), (5.5, 5.5), (60_000, 2))
    height = 70.0 + 0.03 * np.sin(xy[:, 0]) + OFFSETS_M[number] + TILTS[number] * (xy[:, 1] - 2.0)
    height += 0.01 * rng.standard_normal(len(xy))
    for name, shape in PLOTS.items():
        inside = shapely.contains_xy(shape, *xy.T)
        height[inside] += np.maximum(HEIGHTS_M[name][number] - 0.07 * rng.weibull(1.3, int(inside.sum())), 0.0)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([EAST, NORTH, 0.0])
    header.add_crs(pyproj.CRS(CRS))
    if clock:
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    las = laspy.LasData(header)
    las.x, las.y, las.z = xy[:, 0] + EAST, xy[:, 1] + NORTH, height
    las.return_number[:] = las.number_of_returns[:] = 1
    if clock:
        utc = dt.datetime.combine(DAYS[number], dt.time(8, 40), dt.timezone(dt.timedelta(hours=9))).timestamp()
        las.gps_time[:] = utc - 315_964_800 + 18 - 1e9 + np.arange(len(xy)) * 1e-4
    las.write(path)
    return path


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("growth")
    for number, day in enumerate(DAYS):
        write_flight(folder / f"{day}.laz", number)
    shapes = [shapely.transform(shape, lambda en: en + np.array([EAST, NORTH])) for shape in PLOTS.values()]
    gpd.GeoDataFrame(
        {"id": list(PLOTS), "block": [1, 1, 2], "rate_m_day": [1, 2, 3]}, geometry=shapes, crs=CRS
    ).to_file(folder / "parcels.gpkg")
    return folder


def test_growth__is_that_of_the_crop_not_of_the_flights_heights(trial: Path) -> None:
    clouds = [trial / f"{day}.laz" for day in reversed(DAYS)]
    settings = furrowmap.GrowthSettings(net_inset_m=(0.5, 0.1))
    account = furrowmap.growth(clouds, trial / "parcels.gpkg", trial / "three", settings, progress=Told())
    assert [flight["day"] for flight in account["flights"]] == [str(day) for day in DAYS]
    offsets = [flight["alignment"]["offset_m"] for flight in account["flights"][1:]]
    assert offsets == pytest.approx(OFFSETS_M[1:], abs=0.002)
    layer = gpd.read_file(trial / "three" / "growth.gpkg", layer="growth").set_index("id")
    off_m = []
    for name in ("a", "b"):
        row, true = layer.loc[name], HEIGHTS_M[name]
        for k, day in enumerate(DAYS):
            assert row[f"mean_height_m_{day}"] == pytest.approx(true[k], abs=0.008)
        for k in (0, 1):
            step = row[f"growth_m_{DAYS[k]}_{DAYS[k + 1]}"]
            off_m.append(step - true[k + 1] + true[k])
            assert abs(step - true[k + 1] + true[k]) < 2.5 * row[f"growth_sigma_m_{DAYS[k]}_{DAYS[k + 1]}"]
        rate = (true[2] - true[0]) / 20.0  # by least squares of equally spaced days
        assert row.rate_m_day == pytest.approx(rate, abs=0.0005)
        assert abs(row.rate_m_day - rate) < 2.5 * row.rate_sigma_m_day
        assert row.growth_m == pytest.approx(20.0 * row.rate_m_day)
        assert 0.0 < row.rate_sigma_m_day < 0.0006
        assert row.days == 3
    # Over eight seeds of the clouds the steps are off by 4.0 mm (RMS), by 4.2 mm with halves drawn by a generator.
    assert np.sqrt(np.mean(np.square(off_m))) < 0.004
    assert np.isnan(layer.loc["far"].rate_m_day)
    assert [warning["code"] for warning in account["warnings"]] == ["growth-unmeasured"]


def test_growth__products_hold_the_same(trial: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clouds = [str(trial / f"{day}.laz") for day in DAYS[:2]]
    words = ["growth", *clouds, str(trial / "parcels.gpkg"), "-o", str(trial / "two"), "--net-inset", "0.5,0.1"]
    assert command_line(words) == 0
    shown = capsys.readouterr().out
    assert "reference" in shown
    assert "tilt" in shown
    folder = trial / "two"
    account = json.loads((folder / "growth.json").read_text(encoding="utf-8"))
    assert sorted(path.name for path in folder.iterdir()) == account["products"]
    assert account["flights"][1]["alignment"]["tilt_north"] == pytest.approx(TILTS[1], abs=2e-4)
    with (folder / "growth.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["growth_m"]) == pytest.approx(0.12, abs=0.005)
    assert rows[2]["growth_m"] == ""
    sheet = openpyxl.load_workbook(folder / "growth.xlsx")["growth"]
    assert [cell.value for cell in sheet[1]] == list(rows[0])
    assert sheet["A2"].value == "a"
    answered = furrowmap.response(
        [folder / "growth.csv"], None, folder / "trial", furrowmap.ResponseSettings(measure="growth_m")
    )
    assert answered["flights"][0]["parcels"] == 3


def test_growth__wants_two_days_and_ground_in_common(trial: Path, tmp_path: Path) -> None:
    clouds, parcels = [trial / f"{day}.laz" for day in DAYS[:2]], trial / "parcels.gpkg"
    with pytest.raises(UsageError, match="two days or more"):
        furrowmap.growth(clouds, parcels, tmp_path / "x", furrowmap.GrowthSettings(days=("2026-05-13", "2026-05-13")))
    with pytest.raises(UsageError, match="1 day for 2 clouds"):
        furrowmap.growth(clouds, parcels, tmp_path / "x", furrowmap.GrowthSettings(days=("2026-05-13",)))
    timeless = write_flight(tmp_path / "timeless.laz", 0, clock=False)
    with pytest.raises(InputError) as refused:
        furrowmap.growth([timeless, clouds[1]], parcels, tmp_path / "x")
    assert refused.value.code == "cloud-day"
    east = furrowmap.GrowthSettings(days=("2026-05-13", "2026-05-23"))
    las = laspy.read(clouds[1])
    inside = shapely.contains_xy(PLOTS["a"], np.asarray(las.x) - EAST, np.asarray(las.y) - NORTH)
    las.points = las.points[inside]
    las.write(tmp_path / "crop.laz")
    with pytest.raises(InputError) as refused:
        furrowmap.growth([timeless, tmp_path / "crop.laz"], parcels, tmp_path / "x", east)
    assert refused.value.code == "growth-soil"
    assert not (tmp_path / "x").exists()
