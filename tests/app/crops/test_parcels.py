"""`furrowmap parcels`: from a LAS and parcels to a layer, a table and a raster."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
import openpyxl
import pyproj
import pytest
import rasterio
import shapely

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import FurrowmapError, UsageError
from furrowmap.core.runtime.progress import silent
from furrowmap.core.session.opened import open_session
from furrowmap.core.values.parcel import SOIL_METHODS, SoilMethod
from furrowmap.workflows.crops.parcels import soil_source
from furrowmap.workflows.run.parcel_tool import parcel_settings
from tests.app.told_progress import Told

CRS = "EPSG:25832"
EAST, NORTH = 651_500.0, 6_133_880.0
HEIGHTS = {"7": 0.45, "8": 0.60, "far": 0.0}
"""Of the crop on each parcel; no point lies in the third."""


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trial")
    rng = np.random.default_rng(8)
    gross = {
        "7": shapely.box(0, 0, 4, 1.5), "8": shapely.box(0, 2.5, 4, 4), "far": shapely.box(30, 0, 34, 1.5)
    }  # fmt: skip
    xy = rng.uniform((-1.5, -1.5), (5.5, 5.5), (160_000, 2))
    height = 70.0 + 0.01 * xy[:, 0] + 0.01 * rng.standard_normal(len(xy))
    for name in ("7", "8"):
        inside = shapely.contains_xy(gross[name], *xy.T)
        height[inside] += np.maximum(HEIGHTS[name] - 0.07 * rng.weibull(1.3, int(inside.sum())), 0.0)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([EAST, NORTH, 0.0])
    header.add_crs(pyproj.CRS(CRS))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xy[:, 0] + EAST, xy[:, 1] + NORTH, height
    las.return_number[:] = las.number_of_returns[:] = 1
    las.write(folder / "flight.laz")
    parcels = gpd.GeoDataFrame(
        {"id": list(gross), "block": [1, 1, 2], "variety": ["Benchmark", "Benchmark", "=Sheriff"]},
        geometry=[shapely.transform(shape, lambda en: en + np.array([EAST, NORTH])) for shape in gross.values()],
        crs=CRS,
    )
    parcels.to_file(folder / "parcels.gpkg")
    return folder


@pytest.fixture(scope="module")
def crops(trial: Path) -> tuple[Path, dict[str, object]]:
    settings = furrowmap.ParcelSettings(net_inset_m=(0.5, 0.1), compare=True)
    clouds, out = [trial / "flight.laz"], trial / "crops"
    return out, furrowmap.parcels(clouds, trial / "parcels.gpkg", out, settings, progress=Told())


def test_parcels__areas_and_volumes_are_of_the_ground(crops: tuple[Path, dict[str, object]]) -> None:
    """One metre on the ellipsoid is 0.99988 m of the map here; the area on the ellipsoid is geodesic."""
    layer = gpd.read_file(crops[0] / "parcels.gpkg", layer="parcels").set_index("id")
    inset = 3.0 * 1.3  # of metres on the ground; the gross parcel is 4 m by 1.5 m of the map
    turned = layer.loc[["7"]].to_crs("EPSG:4258").geometry.iloc[0]
    geodesic = abs(pyproj.Geod(ellps="GRS80").geometry_area_perimeter(turned)[0])
    found = layer.loc["7"]
    assert layer.loc[["7"]].geometry.iloc[0].area / geodesic == pytest.approx(0.99988165**2, rel=1e-5)
    assert found.area_m2 == pytest.approx(inset, rel=4e-4)
    assert found.area_m2 != pytest.approx(inset, rel=2e-4)
    ground = (4.0 / 0.99988165 - 1.0) * (1.5 / 0.99988165 - 0.2)
    assert found.area_m2 == pytest.approx(ground, rel=2e-5)
    assert found.volume_m3 == pytest.approx(found.mean_height_m * found.area_m2, rel=1e-4)


def test_parcels__layer_and_table_hold_the_same_heights(crops: tuple[Path, dict[str, object]]) -> None:
    folder, account = crops
    layer = gpd.read_file(folder / "parcels.gpkg", layer="parcels").set_index("id")
    with (folder / "parcels.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    for name in ("7", "8"):
        found = layer.loc[name]
        assert found.mean_height_m == pytest.approx(HEIGHTS[name], abs=0.006)
        assert abs(found.mean_height_m - HEIGHTS[name]) < 2.5 * found.height_sigma_m
        assert found.volume_m3 == pytest.approx(HEIGHTS[name] * 3.0 * 1.3, rel=0.02)
        assert found.published_height_m == pytest.approx(HEIGHTS[name], abs=0.04)
        assert float(rows[name]["mean_height_m"]) == pytest.approx(found.mean_height_m, abs=1e-4)
        assert rows[name]["lodging"] == "no"
        assert rows[name]["block"] == "1"
    assert np.isnan(layer.loc["far"].mean_height_m)
    assert rows["far"]["mean_height_m"] == ""
    assert rows["far"]["variety"] == "'=Sheriff"
    assert json.loads((folder / "parcels.json").read_text(encoding="utf-8")) == account
    assert [warning["code"] for warning in account["warnings"]] == ["parcels-unmeasured"]  # type: ignore[attr-defined]


def test_parcels__spreadsheet_holds_the_numbers_of_the_table(crops: tuple[Path, dict[str, object]]) -> None:
    folder, account = crops
    head, *rows = openpyxl.load_workbook(folder / "parcels.xlsx")["parcels"].iter_rows(values_only=True)
    with (folder / "parcels.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.reader(file))
    assert list(head) == table[0]
    for found, wanted in zip(rows, table[1:], strict=True):
        for name, value, text in zip(head, found, wanted, strict=True):
            number = name not in ("id", "block", "variety", "lodging") and text
            assert value == (float(text) if number else text or None), name
    assert "parcels.xlsx" in account["products"]  # type: ignore[operator]


def test_parcels__raster_has_the_mean_of_the_table(crops: tuple[Path, dict[str, object]]) -> None:
    folder, account = crops
    with rasterio.open(folder / "crop_height.tif") as raster:
        heights = raster.read(1)
        assert raster.crs.to_epsg() == 25832
        assert raster.res == pytest.approx((0.04, 0.04))
        values = [next(raster.sample([(EAST + x, NORTH + y)]))[0] for x, y in ((2.0, 0.75), (2.0, 3.25), (2.0, 2.0))]
    assert values[:2] == pytest.approx([0.45, 0.60], abs=0.08)
    assert np.isnan(values[2])
    known = [row for row in account["parcels"] if row["id"] != "far"]  # type: ignore[attr-defined]
    assert np.nansum(heights) * 0.0016 == pytest.approx(sum(row["volume_m3"] for row in known), rel=0.04)


def test_parcels__command_without_compare_gives_the_very_same_heights(
    trial: Path, crops: tuple[Path, dict[str, object]], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("parcels", trial / "flight.laz", trial / "parcels.gpkg", "-o", trial / "again", "--net-inset", "0.5,0.1")
    assert command_line([str(word) for word in words]) == 0
    out = capsys.readouterr().out
    assert "mean_height_m" in out
    assert "parcels.csv" in out
    with (
        rasterio.open(trial / "again" / "crop_height.tif") as again,
        rasterio.open(crops[0] / "crop_height.tif") as one,
    ):
        assert again.read().tobytes() == one.read().tobytes()
    tables = [(folder / "parcels.csv").read_text("utf-8").splitlines() for folder in (trial / "again", crops[0])]
    for row, compared in zip(*map(csv.DictReader, tables), strict=True):
        assert row == {name: value for name, value in compared.items() if not name.startswith("published")}
    assert command_line([str(word) for word in words]) == 4
    assert "--overwrite" in capsys.readouterr().err


@pytest.mark.parametrize("inset", ["0.5", "0.5,0.1,0.1", "a,b", "-0.5,0.1", "nan,0", "0.1,inf"])
def test_parcels__a_wrong_inset_is_refused(trial: Path, inset: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["parcels", trial / "flight.laz", trial / "parcels.gpkg", "-o", trial / "no", f"--net-inset={inset}"]
    assert command_line([str(word) for word in words]) == 2
    assert repr(inset) in capsys.readouterr().err
    assert not (trial / "no").exists()


def test_parcels__published_method_states_no_sigma(trial: Path) -> None:
    settings = furrowmap.ParcelSettings(net_inset_m=(0.5, 0.1), method="christiansen2017", soil="plane")
    account = furrowmap.parcels([trial / "flight.laz"], trial / "parcels.gpkg", trial / "published", settings)
    row = account["parcels"][0]
    assert row["mean_height_m"] == row["published_height_m"]
    assert row["height_sigma_m"] is None


def test_parcels__of_another_place_leave_nothing(trial: Path, tmp_path: Path) -> None:
    places = gpd.read_file(trial / "parcels.gpkg")
    places.geometry = places.geometry.translate(5000.0)
    places.to_file(tmp_path / "elsewhere.gpkg")
    with pytest.raises(FurrowmapError) as raised:
        furrowmap.parcels([trial / "flight.laz"], tmp_path / "elsewhere.gpkg", tmp_path / "out")
    assert raised.value.code == "parcels-elsewhere"
    assert not (tmp_path / "out").exists()


def test_parcel_settings__refuse_what_is_not_known(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        furrowmap.ParcelSettings(method="tallest")  # type: ignore[arg-type]
    for soil, words in (("guessed", "is not there"), (tmp_path, "has none of dtm.tif, dsm.tif, cloud.copc.laz")):
        with pytest.raises(FurrowmapError, match=words) as refused:
            furrowmap.ParcelSettings(soil=soil)
        assert refused.value.code == "soil-missing"


@pytest.mark.parametrize("method", SOIL_METHODS)
def test_soil__is_taken_by_the_method_that_is_named(method: SoilMethod, tmp_path: Path) -> None:
    with soil_source(method, pyproj.CRS(CRS), (0.0, 0.0, 1.0, 1.0), tmp_path, silent) as found:
        assert found == method


@pytest.mark.parametrize("kind", ["cloud", "folder"])
def test_parcels__soil_of_another_date_is_brought_to_the_height_of_the_points(
    trial: Path, tmp_path: Path, kind: str
) -> None:
    """Bare soil of another flight, 0.4 m higher; its surface in another CRS."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([EAST, NORTH, 0.0])
    header.add_crs(pyproj.CRS(CRS))
    soil = laspy.LasData(header)
    x, y = np.random.default_rng(3).uniform((-1.5, -1.5), (5.5, 5.5), (20_000, 2)).T
    soil.x, soil.y, soil.z = x + EAST, y + NORTH, 70.4 + 0.01 * x
    soil.return_number[:] = soil.number_of_returns[:] = 1
    soil.write(tmp_path / "bare.laz")
    if kind == "folder":
        there = furrowmap.SurfaceSettings(cell_m=0.1, ground="none", dst_crs="EPSG:25833")
        furrowmap.surface([tmp_path / "bare.laz"], tmp_path / "bare", there)
    source = tmp_path / ("bare" if kind == "folder" else "bare.laz")
    settings = furrowmap.ParcelSettings(net_inset_m=(0.5, 0.1), soil=source)
    account = furrowmap.parcels([trial / "flight.laz"], trial / "parcels.gpkg", tmp_path / "crops", settings)
    assert account["soil"]["from"] == ("dsm.tif" if kind == "folder" else "bare.laz")
    assert account["parameters"]["soil"] == source.name
    assert account["soil"]["offset_m"] == pytest.approx(-0.4, abs=2e-3)
    for row in account["parcels"][:2]:
        assert row["mean_height_m"] == pytest.approx(HEIGHTS[row["id"]], abs=0.006)
        assert 0.0 < row["soil_sigma_m"] < 0.003


def test_treatments__are_in_the_table_with_doses_up_to_the_day(trial: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.csv"
    plan.write_text("id,2017-03-16,2017-04-20\n7,50,50\n8,50,100\n")
    settings = furrowmap.ParcelSettings(net_inset_m=(0.5, 0.1), treatments=plan, day="2017-04-01")
    account = furrowmap.parcels([trial / "flight.laz"], trial / "parcels.gpkg", tmp_path / "out", settings)
    rows = {row["id"]: row for row in csv.DictReader((tmp_path / "out" / "parcels.csv").open())}
    assert [rows[name]["dose"] for name in HEIGHTS] == ["50.0", "50.0", ""]
    assert "treatments-missing" in {notice["code"] for notice in account["warnings"]}
    plan.write_text("id,n_kg_ha\n9,50\n")
    with pytest.raises(FurrowmapError, match=r"1 parcel \(9\)") as refused:
        furrowmap.parcels([trial / "flight.laz"], trial / "parcels.gpkg", tmp_path / "none", settings)
    assert refused.value.code == "treatments-unknown"
    with pytest.raises(UsageError, match="is not a day"):
        furrowmap.ParcelSettings(day="1 April")


def test_session__names_the_soil_as_a_method_or_a_file(tmp_path: Path) -> None:
    for name in ("gnss.nmea", "imu.csv", "parcels.geojson", "bare.tif"):
        (tmp_path / name).touch()
    for soil, wanted in (("plane", "plane"), ("bare.tif", tmp_path.resolve() / "bare.tif")):
        (tmp_path / "session.toml").write_text(
            'furrowmap = 1\n[recording]\ngnss = ["gnss.nmea"]\n[crs]\nmap = "EPSG:25832"\n'
            f'[imu]\nfiles = ["imu.csv"]\n[parcels]\nfile = "parcels.geojson"\nsoil = "{soil}"\n'
        )
        opened = open_session(tmp_path / "session.toml")
        assert parcel_settings(opened).soil == wanted
        assert (tmp_path.resolve() / "bare.tif" in opened.inputs.all) == (soil == "bare.tif")


def test_a_parcel_without_crop__has_no_standard_deviation_and_is_named(tmp_path: Path) -> None:
    """Soil with 1 cm of noise under a parcel, beside one with crop."""
    rng = np.random.default_rng(5)
    gross = {"bare": shapely.box(0, 0, 4, 1.5), "crop": shapely.box(0, 2.5, 4, 4)}
    xy = rng.uniform((-1.5, -1.5), (5.5, 5.5), (160_000, 2))
    height = 70.0 + 0.01 * rng.standard_normal(len(xy))
    inside = shapely.contains_xy(gross["crop"], *xy.T)
    height[inside] += np.maximum(0.5 - 0.07 * rng.weibull(1.3, int(inside.sum())), 0.0)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    header.offsets = np.array([EAST, NORTH, 0.0])
    header.add_crs(pyproj.CRS(CRS))
    las = laspy.LasData(header)
    las.x = xy[:, 0] + EAST
    las.y = xy[:, 1] + NORTH
    las.z = height
    las.write(tmp_path / "flight.laz")
    shapes = [shapely.transform(shape, lambda en: en + np.array([EAST, NORTH])) for shape in gross.values()]
    gpd.GeoDataFrame({"id": list(gross)}, geometry=shapes, crs=CRS).to_file(tmp_path / "parcels.gpkg")
    account = furrowmap.parcels([tmp_path / "flight.laz"], tmp_path / "parcels.gpkg", tmp_path / "out")
    bare, crop = account["parcels"]
    assert bare["height_sigma_m"] is None
    assert bare["mean_height_m"] is not None
    assert crop["height_sigma_m"] > 0.0
    (warning,) = [each for each in account["warnings"] if each["code"] == "parcels-without-sigma"]
    assert "1 parcel (bare) of 2: the height has no standard deviation" in warning["text"]


def test_doses_as_texts_of_a_layer__are_read_and_those_without_a_number_named(trial: Path, tmp_path: Path) -> None:
    layer = gpd.read_file(trial / "parcels.gpkg")
    layer["n_kg_ha"] = ["80 kg", "120 kg", "n.a."]
    layer.to_file(tmp_path / "parcels.gpkg")
    account = furrowmap.parcels([trial / "flight.laz"], tmp_path / "parcels.gpkg", tmp_path / "out")
    texts = [each["text"] for each in account["warnings"] if each["code"] == "trial-cells-unread"]
    assert texts == ["n_kg_ha: 1 of 3 cells holds no number, the first 'n.a.' (parcel far). It is left out."]
    assert "2 parcels with 2 different doses" in account["response"]["words"]
