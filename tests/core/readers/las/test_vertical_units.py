"""Clouds whose unit of heights stands in GeoTIFF key 4099: beside a code of heights, a datum's, WKT, or alone."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from laspy.vlrs.vlr import VLR
from pyproj import CRS

from furrowmap.cli.main import command_line
from furrowmap.core.pointclouds.joined_clouds import open_clouds
from furrowmap.core.readers.las.cloud import open_cloud

FEET_US = 1200 / 3937
"""Metres in a US survey foot, by its definition."""
FEET = 0.3048
CODES_OF_UNITS = {9001: 1.0, 9002: FEET, 9003: FEET_US}
SAMPLES = {
    "k5703_9003.laz": FEET_US,
    "k5703_9002.laz": FEET,
    "k5103_9003.laz": FEET_US,
    "wkt_and_keys.laz": FEET_US,
    "k_units_only.laz": FEET_US,
}
MAP_KEYS = ((1024, 1), (3072, 26918), (3076, 9001))


def write_cloud(path: Path, keys: Sequence[tuple[int, int]], wkt: str | None = None) -> Path:
    """A square of points from 328.083 to 329.379 units, whose records are written without a library that knows CRSs."""
    header = laspy.LasHeader(point_format=6 if wkt else 0, version="1.4" if wkt else "1.2")
    header.scales = np.full(3, 0.001)
    header.offsets = np.array([580000.0, 4500000.0, 0.0])
    cloud = laspy.LasData(header)
    column, row = np.meshgrid(np.arange(0.0, 20.0, 0.5), np.arange(0.0, 20.0, 0.5))
    cloud.x = 580000.0 + column.ravel()
    cloud.y = 4500000.0 + row.ravel()
    cloud.z = np.linspace(328.083, 329.379, column.size)
    directory = struct.pack("<4H", 1, 1, 0, len(keys))
    directory += b"".join(struct.pack("<4H", key, 0, 1, value) for key, value in keys)
    cloud.header.vlrs.append(VLR("LASF_Projection", 34735, "", directory))
    if wkt:
        cloud.header.vlrs.append(VLR("LASF_Projection", 2112, "", wkt.encode() + b"\0"))
        cloud.header.global_encoding.wkt = True
    cloud.write(path)
    return path


def unit_and_codes(path: Path) -> tuple[float, set[str]]:
    clouds = open_clouds([path])
    (unit_m,) = clouds.units_m
    return unit_m, {notice.code for notice in clouds.notices}


@pytest.mark.parametrize("name", SAMPLES)
def test_samples__heights_in_the_unit_of_key_4099(shared_data: Path, name: str) -> None:
    unit_m, codes = unit_and_codes(shared_data / "foreign" / "09-las-vertical-unit" / name)
    assert unit_m == pytest.approx(SAMPLES[name], rel=1e-9)
    assert "heights-in-feet" in codes


@pytest.mark.parametrize("unit", CODES_OF_UNITS)
@pytest.mark.parametrize("vertical", [None, 5703, 6360, 8228, 5103, 32767])
@pytest.mark.parametrize("text", [None, 26918])
def test_key_4099__counts_beside_every_other_statement(
    tmp_path: Path, unit: int, vertical: int | None, text: int | None
) -> None:
    keys = (*MAP_KEYS, *([(4096, vertical)] if vertical else []), (4099, unit))
    wkt = CRS.from_epsg(text).to_wkt("WKT1_GDAL") if text else None
    unit_m, codes = unit_and_codes(write_cloud(tmp_path / "cloud.las", keys, wkt))
    assert unit_m == pytest.approx(CODES_OF_UNITS[unit], rel=1e-9)
    assert ("heights-in-feet" in codes) == (unit != 9001)
    own_m = {5703: 1.0, 6360: FEET_US, 8228: FEET}.get(vertical or 0)
    assert ("height-units-differ" in codes) == (own_m not in (None, CODES_OF_UNITS[unit]))


def test_wkt_with_heights_in_metres_beside_keys_in_feet__is_a_contradiction(tmp_path: Path) -> None:
    wkt = CRS.from_user_input("EPSG:26918+5703").to_wkt("WKT1_GDAL")
    path = write_cloud(tmp_path / "cloud.las", (*MAP_KEYS, (4096, 6360), (4099, 9003)), wkt)
    unit_m, codes = unit_and_codes(path)
    assert unit_m == 1.0
    assert "height-units-differ" in codes


def test_heights_of_keys_beside_wkt_of_the_map__are_those_of_the_cloud(tmp_path: Path) -> None:
    wkt = CRS.from_epsg(26918).to_wkt("WKT1_GDAL")
    for keys in ([(4096, 5703)], [(4096, 5703), (4099, 9001)]):
        crs = open_cloud(write_cloud(tmp_path / "cloud.las", (*MAP_KEYS, *keys), wkt)).crs
        assert crs is not None
        assert crs.sub_crs_list[1].to_epsg() == 5703


@pytest.mark.parametrize("name", SAMPLES)
def test_surface__has_heights_in_metres(
    shared_data: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    import rasterio

    path = shared_data / "foreign" / "09-las-vertical-unit" / name
    assert command_line(["surface", str(path), "-o", str(tmp_path / "out"), "--cell", "0.5", "--json"]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert "heights-in-feet" in {warning["code"] for warning in answer["warnings"]}
    with rasterio.open(tmp_path / "out" / "dsm.tif") as raster:
        heights = raster.read(1, masked=True)
    assert 100.0 < heights.min() < heights.max() < 100.4
