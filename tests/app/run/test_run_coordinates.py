"""What the products say of their coordinates: heights above a geoid, and a stated frame and epoch."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import japan_geoid
import laspy
import numpy as np
import pyogrio
import pytest
import rasterio
from pyproj import CRS, Transformer

import furrowmap

SCANS_S = 1_453_364_282.341
COLUMNS = "time_unix_s,lon_deg,lat_deg,h_m,roll_deg,pitch_deg,heading_deg\n"
SESSION = """furrowmap = 1
[recording]
lidar = ["recording.pcap"]
[crs]
map = "EPSG:6677"
{crs}
[trajectory]
files = ["drive.csv"]
"""


@pytest.fixture(scope="module")
def drive(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A VLP-16's 0.4 s on a drive at 1 m/s eastward, whose file states longitudes and latitudes."""
    folder = tmp_path_factory.mktemp("drive")
    shutil.copy(shared_data / "velodyne" / "vlp16_single_gps.pcap", folder / "recording.pcap")
    to_degrees = Transformer.from_crs("EPSG:6677", "EPSG:6668", always_xy=True)
    lon, lat = to_degrees.transform(16_650.0 + 0.1 * np.arange(31), np.full(31, 96_560.0))
    rows = [f"{SCANS_S - 1 + i * 0.1:.3f},{lon[i]:.10f},{lat[i]:.10f},271,0,0,90\n" for i in range(31)]
    (folder / "drive.csv").write_text(COLUMNS + "".join(rows))
    return folder


def products(drive: Path, name: str, crs: str) -> tuple[Path, dict[str, Any]]:
    session = drive / f"{name}.toml"
    session.write_text(SESSION.format(crs=crs))
    return drive / name, furrowmap.run(session, drive / name).report


@pytest.fixture(scope="module")
def ellipsoidal(drive: Path) -> tuple[Path, dict[str, Any]]:
    return products(drive, "ellipsoidal", "")


def heights(folder: Path) -> np.ndarray:
    with laspy.open(folder / "cloud.copc.laz") as file:
        return np.sort(file.read().z)


def test_products__heights_above_a_geoid_are_lower_by_it_and_say_so(
    drive: Path, ellipsoidal: tuple[Path, dict[str, Any]]
) -> None:
    folder, report = products(drive, "orthometric", 'heights = "GSIGEO2011"')
    (move,) = report["coordinates"]["moves"]
    lon, lat = Transformer.from_crs("EPSG:6677", "EPSG:6668", always_xy=True).transform(16_651.5, 96_560.0)
    assert abs(move["up_m"] + japan_geoid.load_embedded_gsigeo2011().get_height(lon, lat)) < 1e-3
    np.testing.assert_allclose(heights(folder), heights(ellipsoidal[0]) + move["up_m"], rtol=0, atol=2e-3)
    with laspy.open(folder / "cloud.copc.laz") as file:
        cloud = file.header.parse_crs()
        texts = [vlr.record_data_bytes() for vlr in file.header.vlrs if vlr.record_id == 3]
    assert cloud.sub_crs_list[1] == CRS("EPSG:6695")
    assert b"GSIGEO2011" in texts[0]
    with rasterio.open(folder / "dsm.tif") as raster:
        assert CRS.from_wkt(raster.crs.to_wkt()).sub_crs_list[1].name == "JGD2011 (vertical) height"
        assert "GSIGEO2011" in raster.tags()["GEOID"]
    assert "Heights are above GSIGEO2011" in (folder / "report.html").read_text(encoding="utf-8")
    layer = pyogrio.read_info(folder / "field.gpkg", layer="trajectory")
    assert CRS.from_user_input(layer["crs"]).sub_crs_list[1].name == "JGD2011 (vertical) height"
    with closing(sqlite3.connect(folder / "field.gpkg")) as database:
        said = database.execute("SELECT description FROM gpkg_contents WHERE table_name = 'trajectory'").fetchone()
    assert "GSIGEO2011" in said[0]


def test_products__a_stated_frame_and_epoch_are_in_every_file(
    drive: Path, ellipsoidal: tuple[Path, dict[str, Any]]
) -> None:
    folder, report = products(drive, "stated", 'coordinates = "itrf2020@2016.05"')
    name = "ITRF2020 @ 2016.05 / Japan Plane Rectangular CS zone IX"
    assert (report["coordinates"]["epoch"], report["figures"]["crs"]) == (2016.05, name)
    np.testing.assert_allclose(heights(folder), heights(ellipsoidal[0]), rtol=0, atol=2e-3)
    with laspy.open(folder / "cloud.copc.laz") as file:
        assert file.header.parse_crs().name == name
    with rasterio.open(folder / "dsm.tif") as raster:
        assert name in raster.crs.to_wkt()
        assert raster.tags()["COORDINATE_EPOCH"] == "2016.05"
    with closing(sqlite3.connect(folder / "field.gpkg")) as database:
        found = database.execute("SELECT srs_name, epoch FROM gpkg_spatial_ref_sys WHERE epoch IS NOT NULL").fetchall()
    assert found == [(name, 2016.05)]


def test_products__as_recorded_report_no_move(ellipsoidal: tuple[Path, dict[str, Any]]) -> None:
    coordinates = ellipsoidal[1]["coordinates"]
    assert (coordinates["moves"], coordinates["epoch"], coordinates["heights"]) == ([], None, "ellipsoidal")
    assert coordinates["frame"] == "JGD2011"
