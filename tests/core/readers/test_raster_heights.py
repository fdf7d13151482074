"""GeoTIFFs of heights of other software: every property in every way that heights are taken."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from pyproj import CRS
from rasterio.enums import ColorInterp
from rasterio.transform import Affine

from furrowmap.cli.main import command_line
from furrowmap.core.accuracy.point_check import surface_at_points
from furrowmap.core.crops.site_soil import open_soil_raster
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.surface_file import height_surface, open_surface, unusable
from furrowmap.exporters.farm.surface_mosaic import write_mosaic
from furrowmap.exporters.rasters.tied_surfaces import resample_surface
from furrowmap.results import read_raster

MAP = CRS.from_epsg(26918)
EAST_M = 580000.0
NORTH_M = 4500000.0
CELL_M = 0.5
SIDE = 64
SOUND = Affine(CELL_M, 0.0, EAST_M, 0.0, -CELL_M, NORTH_M)
PLACES = np.array([[6.1, -8.3], [12.4, -11.7], [15.05, -13.1], [10.0, -12.0]]) + np.array([EAST_M, NORTH_M])
"""Within every raster below, whatever its transform; far from the cells without heights."""
FEET = 0.3048
FEET_US = 1200 / 3937


def plane_m(x: Any, y: Any) -> Any:
    return 100.0 + 0.02 * (x - EAST_M) + 0.01 * (y - NORTH_M)


def write(path: Path, transform: Affine = SOUND, **stated: Any) -> Path:
    """A raster on the plane: `scale`, `offset`, `unit` (text), `unit_m`, `crs`, `dtype`, `holes` (in corners)."""
    scale, offset, unit_m = stated.get("scale", 1.0), stated.get("offset", 0.0), stated.get("unit_m", 1.0)
    kind = np.dtype(stated.get("dtype", "float32"))
    column, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    a, b, c, d, e, f = transform[:6]
    heights = plane_m(a * column + b * row + c, d * column + e * row + f)
    numbers = (heights / unit_m - offset) / (scale or 1.0)
    numbers = np.rint(numbers) if kind.kind in "iu" else numbers
    for hole, corner in zip(stated.get("holes", ()), (np.s_[:4, :4], np.s_[-4:, -4:]), strict=False):
        numbers[corner] = hole
    profile = {"driver": "GTiff", "width": SIDE, "height": SIDE, "count": 1, "dtype": kind.name}
    profile |= {name: value for name, value in stated.items() if name.isupper()}
    crs = rasterio.CRS.from_user_input(stated.get("crs", "EPSG:26918"))
    with rasterio.open(path, "w", transform=transform, crs=crs, nodata=stated.get("nodata"), **profile) as raster:
        raster.write(numbers.astype(kind), 1)
        raster.scales, raster.offsets = (scale,), (offset,)
        if "unit" in stated:
            raster.units = (stated["unit"],)
    return path


Found = tuple[NDArray[np.float64], tuple[Notice, ...]]


def by_check(path: Path, at: NDArray[np.float64]) -> Found:
    points = path.with_suffix(".csv")
    rows = [f"p{k},{x:.3f},{y:.3f},{plane_m(x, y):.4f}\n" for k, (x, y) in enumerate(at.tolist())]
    points.write_text("name,e_m,n_m,h_m\n" + "".join(rows))
    found = surface_at_points(path, points)
    return np.array([point.found_m[2] for point in found.points]), found.notices


def by_soil(path: Path, at: NDArray[np.float64]) -> Found:
    west, south = at.min(axis=0).tolist()
    east, north = at.max(axis=0).tolist()
    with open_soil_raster(path, MAP, (west, south, east, north)) as soil:
        return soil.heights_m(at, CELL_M), soil.raster.scale.notices


def sampled(heights: NDArray[Any], grid: Grid, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights of the plane at places by those of the cells that they lie in."""
    column = np.floor(at[:, 0] / grid.cell_m).astype(int) - grid.west
    row = grid.north - 1 - np.floor(at[:, 1] / grid.cell_m).astype(int)
    inside = (column >= 0) & (row >= 0) & (row < grid.rows) & (column < grid.columns)
    centre_x = (column + grid.west + 0.5) * grid.cell_m
    centre_y = (grid.north - row - 0.5) * grid.cell_m
    there = np.full(len(at), math.nan)
    there[inside] = heights[row[inside], column[inside]]
    out: NDArray[np.float64] = there + plane_m(at[:, 0], at[:, 1]) - plane_m(centre_x, centre_y)
    return out


def by_mosaic_of_cells(path: Path, at: NDArray[np.float64], cell_m: float = CELL_M) -> Found:
    made = write_mosaic([path], path.with_name("mosaic.tif"), cell_m=cell_m)
    with rasterio.open(made.path) as raster:
        heights = raster.read(1, masked=True).astype(np.float64).filled(np.nan)
        grid = Grid(cell_m, round(raster.bounds.left / cell_m), round(raster.bounds.top / cell_m), raster.shape)
    return sampled(heights, grid, at), made.notices


def by_coarser_mosaic(path: Path, at: NDArray[np.float64]) -> Found:
    return by_mosaic_of_cells(path, at, 2.0 * CELL_M)


def by_finer_mosaic(path: Path, at: NDArray[np.float64]) -> Found:
    return by_mosaic_of_cells(path, at, 0.4)


def by_surface(path: Path, at: NDArray[np.float64]) -> Found:
    file = height_surface(path, unusable)
    assert file.grid is not None
    with open_surface(file) as surface:
        return sampled(surface.read(file.grid), file.grid, at), file.scale.notices


def by_reference_of_tie(path: Path, at: NDArray[np.float64]) -> Found:
    file = height_surface(path, unusable)
    grid = Grid.of_bounds(0.4, file.bounds_m)
    with resample_surface(file, grid) as surface:
        return sampled(surface.read(grid), grid, at), file.scale.notices


def by_python(path: Path, at: NDArray[np.float64]) -> Found:
    raster: Any = read_raster(path)
    values = raster.array if hasattr(raster, "array") else raster.values
    grid = Grid(CELL_M, round(EAST_M / CELL_M), round(NORTH_M / CELL_M), values.shape)
    return sampled(np.asarray(values, np.float64), grid, at), ()


WAYS: Mapping[str, Callable[[Path, NDArray[np.float64]], Found]] = {
    "check": by_check,
    "parcels --soil": by_soil,
    "farm mosaic": by_mosaic_of_cells,
    "farm mosaic, coarser": by_coarser_mosaic,
    "farm mosaic, finer": by_finer_mosaic,
    "tie": by_surface,
    "tie --reference": by_reference_of_tie,
    "read_raster": by_python,
}
OF_HEIGHTS = (by_check, by_soil, by_surface, by_reference_of_tie)
"""What takes heights alone; a mosaic may be of anything."""
SCALES: Mapping[str, dict[str, Any]] = {
    "plain": {},
    "centimetres by scale": {"scale": 0.01, "dtype": "uint16"},
    "millimetres by scale and offset": {"scale": 0.001, "offset": 50.0, "dtype": "int32"},
    "offset alone": {"offset": 90.0},
    "feet by scale and unit": {"scale": 0.01, "dtype": "uint16", "unit": "foot", "unit_m": FEET},
    "offset in feet": {"offset": 50.0, "unit": "ft", "unit_m": FEET},
    "scale with declared nodata": {"scale": 0.01, "dtype": "int16", "nodata": -32768, "holes": (-32768,)},
}
UNITS: Mapping[str, float] = {
    "m": 1.0, "metre": 1.0, "meters": 1.0, "cm": 0.01, "mm": 0.001, "dm": 0.1, "ft": FEET, "foot": FEET, "feet": FEET,
    "Feet": FEET, "US survey foot": FEET_US, "us-ft": FEET_US, "US Survey Feet": FEET_US, "foot_us": FEET_US,
}  # fmt: skip
COMPOUND: Mapping[str, float] = {"EPSG:26918+8228": FEET, "EPSG:26918+6360": FEET_US, "EPSG:26918+5703": 1.0}
NO_HEIGHTS: Mapping[str, dict[str, Any]] = {
    "-9999": {"holes": (-9999.0,)},
    "-9999 and 9999": {"holes": (-9999.0, 9999.0)},
    "-32767": {"holes": (-32767.0,)},
    "-32767 in centimetres": {"holes": (-32767.0,), "dtype": "int16", "scale": 0.01},
    "-32768 in centimetres": {"holes": (-32768.0,), "dtype": "int16", "scale": 0.01},
    "65535 in centimetres": {"holes": (65535.0,), "dtype": "uint16", "scale": 0.01},
    "0": {"holes": (0.0,), "dtype": "uint16", "scale": 0.005},
    "3.4e38": {"holes": (3.4e38,)},
    "least float32": {"holes": (float(np.finfo(np.float32).min),)},
    "largest float32": {"holes": (float(np.finfo(np.float32).max),)},
    "1e20": {"holes": (1e20,), "dtype": "float64"},
    "least float64": {"holes": (float(np.finfo(np.float64).min),), "dtype": "float64"},
    "infinite": {"holes": (float("inf"), float("-inf"))},
    "-9999 beside a declared -32768": {"holes": (-9999.0, -32768.0), "nodata": -32768.0},
    "-9999 of feet": {"holes": (-9999.0,), "unit": "ft", "unit_m": FEET},
}


def expect_plane(found: NDArray[np.float64]) -> None:
    """Within a cell's rounding of the numbers; where a way has no height between cells, it has one elsewhere."""
    np.testing.assert_allclose(found, plane_m(PLACES[:, 0], PLACES[:, 1]), atol=0.012)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("stated", SCALES)
def test_scale_and_offset__are_applied(tmp_path: Path, stated: str, way: str) -> None:
    expect_plane(WAYS[way](write(tmp_path / "a.tif", **SCALES[stated]), PLACES)[0])


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("unit", UNITS)
def test_unit_of_the_band__is_converted_and_told(tmp_path: Path, unit: str, way: str) -> None:
    path = write(tmp_path / "a.tif", unit=unit, unit_m=UNITS[unit])
    found, notices = WAYS[way](path, PLACES)
    expect_plane(found)
    if way != "read_raster":
        assert ("heights-in-feet" in {notice.code for notice in notices}) == (UNITS[unit] != 1.0)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("crs", COMPOUND)
def test_unit_of_the_vertical_crs__is_converted_and_told(tmp_path: Path, crs: str, way: str) -> None:
    found, notices = WAYS[way](write(tmp_path / "a.tif", crs=crs, unit_m=COMPOUND[crs]), PLACES)
    expect_plane(found)
    if way != "read_raster":
        assert ("heights-in-feet" in {notice.code for notice in notices}) == (COMPOUND[crs] != 1.0)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("stated", NO_HEIGHTS)
def test_numbers_that_are_no_heights__are_named_and_left_out(tmp_path: Path, stated: str, way: str) -> None:
    path = write(tmp_path / "a.tif", **NO_HEIGHTS[stated])
    found, notices = WAYS[way](path, np.vstack([PLACES, [[EAST_M + 0.9, NORTH_M - 0.9]]]))
    expect_plane(found[:-1])
    assert np.isnan(found[-1])
    if way != "read_raster":
        named = [dict(notice.values)["values"] for notice in notices if notice.code == "nodata-undeclared"]
        assert len(named) == 1
        declared = NO_HEIGHTS[stated].get("nodata")
        for hole in NO_HEIGHTS[stated]["holes"]:
            assert (f"{hole:.6g}"[:5] in str(named[0])) == (hole != declared)


@pytest.mark.parametrize("way", WAYS)
def test_depths__are_refused(tmp_path: Path, way: str) -> None:
    """A vertical CRS whose axis points down: MSL depth."""
    with pytest.raises(InputError, match="depths") as refused:
        WAYS[way](write(tmp_path / "a.tif", crs="EPSG:26918+5715"), PLACES)
    assert refused.value.code == "heights-downward"


@pytest.mark.parametrize("way", WAYS)
def test_such_numbers_near_the_others__are_heights(tmp_path: Path, way: str) -> None:
    path = write(tmp_path / "a.tif", offset=100.0, holes=(0.0,))
    found, notices = WAYS[way](path, np.vstack([PLACES, [[EAST_M + 0.75, NORTH_M - 0.75]]]))
    expect_plane(found[:-1])
    assert found[-1] == pytest.approx(100.0, abs=0.012)
    assert notices == ()


def plain_with(path: Path, **stated: Any) -> Path:
    """The plain raster with tags, a mask or an alpha band that leave out a corner, which has another height."""
    with rasterio.open(write(path.with_name("plain.tif"))) as plain:
        heights = plain.read()
        profile = {**plain.profile, "count": 2 if stated.get("alpha") else 1}
    shown = np.full((SIDE, SIDE), 255, np.uint8)
    if stated.keys() & {"mask", "alpha"}:
        shown[:4, :4] = 0
        heights[0, :4, :4] = 12.0
    if stated.get("numbers"):
        heights = stated["numbers"](heights)
        profile["dtype"] = heights.dtype.name
    if stated.get("beside"):
        del profile["transform"]
    with (
        rasterio.Env(GDAL_TIFF_INTERNAL_MASK=stated.get("mask") == "inside"),
        rasterio.open(path, "w", **profile) as out,
    ):
        out.update_tags(**stated.get("tags", {}))
        out.write(heights[0], 1)
        if stated.get("mask"):
            out.write_mask(shown)
        if stated.get("alpha"):
            out.write(shown.astype("float32"), 2)
            out.colorinterp = (ColorInterp.gray, ColorInterp.alpha)
    if stated.get("pam"):
        band = f'<PAMRasterBand band="1">{stated["pam"]}</PAMRasterBand>'
        path.with_name(f"{path.name}.aux.xml").write_text(f"<PAMDataset>{band}</PAMDataset>")
    if stated.get("beside"):
        middle = (EAST_M + 0.5 * CELL_M, NORTH_M - 0.5 * CELL_M)
        path.with_suffix(".tfw").write_text("\n".join(map(str, (CELL_M, 0.0, 0.0, -CELL_M, *middle))))
    return path


FORMS: Mapping[str, Callable[[Path], Path]] = {
    "cells named by their middles": lambda path: plain_with(path, tags={"AREA_OR_POINT": "Point"}),
    "a mask in the file": lambda path: plain_with(path, mask="inside"),
    "a mask beside the file": lambda path: plain_with(path, mask="beside"),
    "a band of transparency": lambda path: plain_with(path, alpha=True),
    "scale and offset beside the file": lambda path: plain_with(
        path,
        pam="<Offset>50</Offset><Scale>0.01</Scale>",
        numbers=lambda h: np.rint((h - 50.0) * 100.0).astype("int32"),
    ),
    "unit beside the file": lambda path: plain_with(
        path, pam="<UnitType>ft</UnitType>", numbers=lambda h: h / np.float32(FEET)
    ),
    "a world file": lambda path: plain_with(path, beside=True),
    "a negative scale": lambda path: write(path, scale=-1.0),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("form", FORMS)
def test_what_stands_elsewhere_in_files__is_heeded(tmp_path: Path, form: str, way: str) -> None:
    expect_plane(WAYS[way](FORMS[form](tmp_path / "a.tif"), PLACES)[0])


REFUSED: Mapping[str, Callable[[Path], Path]] = {
    "a scale of 0": lambda path: write(path, scale=0.0),
    "a scale that is no number": lambda path: write(path, scale=math.nan),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("stated", REFUSED)
def test_scales_that_are_none__are_refused(tmp_path: Path, stated: str, way: str) -> None:
    with pytest.raises(InputError, match="states the scale") as refused:
        WAYS[way](REFUSED[stated](tmp_path / "a.tif"), PLACES)
    assert len(str(refused.value).splitlines()) == 3


TURNED = {
    "rotated by 30°": SOUND * Affine.translation(-10, 10) * Affine.rotation(-30.0),
    "rotated by 90°": Affine(0.0, CELL_M, EAST_M, CELL_M, 0.0, NORTH_M - SIDE * CELL_M),
    "sheared": SOUND @ Affine(1.0, 0.2, -4.0, 0.0, 1.0, 0.0),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("turned", TURNED)
def test_rotated_and_sheared_cells__are_honoured_or_refused(tmp_path: Path, turned: str, way: str) -> None:
    path = write(tmp_path / "a.tif", TURNED[turned])
    if way in ("check", "parcels --soil"):
        expect_plane(WAYS[way](path, PLACES)[0])
        return
    with pytest.raises(InputError, match=r"rotated or sheared|not square and north-up") as refused:
        WAYS[way](path, PLACES)
    assert len(str(refused.value).splitlines()) == 3


@pytest.mark.parametrize("big", ["NO", "YES"])
@pytest.mark.parametrize("endianness", ["LITTLE", "BIG"])
@pytest.mark.parametrize("way", WAYS)
def test_unit_of_keys_beside_a_vertical_code__is_converted_and_told(
    tmp_path: Path, way: str, endianness: str, big: str
) -> None:
    path = write(tmp_path / "a.tif", crs="EPSG:26918+6360", unit_m=FEET_US, ENDIANNESS=endianness, BIGTIFF=big)
    order = ">" if endianness == "BIG" else "<"
    area, chart, code, changed, unit = (
        struct.pack(f"{order}4H", key, 0, 1, value)
        for key, value in ((1025, 1), (3072, 26918), (4096, 6360), (4096, 5703), (4099, 9003))
    )
    # GDAL writes no unit beside a code: it takes the place of the citation, the key between those two
    data, count = re.subn(
        re.escape(area) + b".{8}" + re.escape(chart + code),
        area + chart + changed + unit,
        path.read_bytes(),
        flags=re.DOTALL,
    )
    assert count >= 1
    path.write_bytes(data)
    found, notices = WAYS[way](path, PLACES)
    expect_plane(found)
    if way != "read_raster":
        assert {"heights-in-feet", "height-units-differ"} <= {notice.code for notice in notices}


def test_two_units__are_told_and_that_of_the_band_counts(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", crs="EPSG:26918+5703", unit="ft", unit_m=FEET)
    found, notices = by_check(path, PLACES)
    expect_plane(found)
    assert {"height-units-differ", "heights-in-feet"} <= {notice.code for notice in notices}


@pytest.mark.parametrize("unit", ["percent", "degree", "dB"])
def test_units_that_are_none_of_length__are_refused(tmp_path: Path, unit: str) -> None:
    path = write(tmp_path / "a.tif", unit=unit)
    for way in OF_HEIGHTS:
        with pytest.raises(InputError, match="no known unit of length"):
            way(path, PLACES)


@pytest.mark.parametrize(
    ("names", "why"),
    [
        (("density", "Elevation"), "'density' in its first band and heights in band 2, 'Elevation'"),
        (("slope", "", "DTM [m]"), "heights in band 3"),
        (None, "colours"),
    ],
)
def test_rasters_whose_first_band_is_something_else__are_refused(
    names: tuple[str, ...] | None, why: str, tmp_path: Path
) -> None:
    path = tmp_path / "bands.tif"
    count = len(names) if names else 3
    profile = {"width": SIDE, "height": SIDE, "count": count, "dtype": "float32" if names else "uint8"}
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:26918", transform=SOUND, **profile) as raster:
        raster.write(np.full((count, SIDE, SIDE), 7, profile["dtype"]))
        if names:
            raster.descriptions = names
    for by in OF_HEIGHTS:
        with pytest.raises(InputError, match=re.escape(why)) as refused:
            by(path, PLACES)
        assert len(str(refused.value).splitlines()) == 3


def test_rasters_of_several_bands__whose_first_is_heights_are_read(tmp_path: Path) -> None:
    path = tmp_path / "bands.tif"
    with rasterio.open(write(tmp_path / "plain.tif")) as plain:
        heights = plain.read(1)
        profile = {**plain.profile, "count": 2}
    with rasterio.open(path, "w", **profile) as raster:
        raster.write(np.stack([heights, np.zeros_like(heights)]))
        raster.descriptions = ("dsm", "density")
    expect_plane(by_check(path, PLACES)[0])


def test_virtual_mosaics__do_not_refer_to_numbers_that_are_no_metres(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", unit="ft", unit_m=FEET)
    with pytest.raises(RefusedError) as refused:
        write_mosaic([path], tmp_path / "mosaic.vrt")
    assert refused.value.code == "mosaic-virtual"


@pytest.mark.parametrize(
    ("raster", "points"),
    [
        ("06-tiff-scale-offset/cm.tif", "points.csv"),
        ("06-tiff-scale-offset/mm.tif", "points.csv"),
        ("08-tiff-heights-in-feet/compound.tif", "points_compound.csv"),
        ("08-tiff-heights-in-feet/bandunit.tif", "points.csv"),
    ],
)
def test_samples__have_no_error(
    shared_data: Path, raster: str, points: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = shared_data / "foreign" / raster
    assert command_line(["check", str(path), str(path.with_name(points)), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    errors = [point["error_h_m"] for point in answer["points"]]
    assert len(errors) == 10
    assert np.abs(errors).max() < 0.004
    told = {warning["code"] for warning in answer["warnings"]}
    assert ("heights-in-feet" in told) == ("feet" in raster)
