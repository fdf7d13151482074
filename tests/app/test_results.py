"""The result of a run, read through the Python API and by the libraries that the formats come from."""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import copclib
import laspy
import numpy as np
import pandas as pd
import pyogrio
import pytest
import rasterio
from numpy.testing import assert_array_equal
from pyproj import CRS

import furrowmap

GPS_TO_UTC_S = 1e9 + 315_964_800 - 18  # of adjusted standard GPS time, with the leap seconds of 2026
LABELS = Path(furrowmap.__file__).resolve().parents[1] / "exporters" / "vectors" / "labels.toml"
PROPERTIES = tomllib.loads(LABELS.read_text(encoding="utf-8"))["layers"]
"""All layers that a run may write."""


def present(result: furrowmap.Result) -> list[str]:
    return [name for name in PROPERTIES if name in result.layers]


def test_result__is_that_of_its_folder(result: furrowmap.Result) -> None:
    for folder in (result.path, str(result.path)):
        assert furrowmap.open_result(folder).report == json.loads((result.path / "report.json").read_text())
    assert "One pass" in repr(result)


def test_layers__are_those_of_the_geopackage(result: furrowmap.Result) -> None:
    path = result.path / "field.gpkg"
    assert set(result.layers) == {name for name, kind in pyogrio.list_layers(path) if kind is not None}
    assert len(result.layers) == len(list(result.layers))
    assert {"trajectory", "passes", "coverage", "events"} <= set(present(result))
    for name, layer in result.layers.items():
        expected = pyogrio.read_dataframe(path, layer=name)
        for time in expected.select_dtypes("datetime"):  # GDAL gives a layer without rows no zone
            expected[time] = expected[time].dt.tz_localize("UTC")
        assert layer.crs == CRS("EPSG:6677")
        pd.testing.assert_frame_equal(layer.drop(columns="geometry"), expected.drop(columns="geometry"))
        assert layer.geometry.geom_equals(expected.geometry).all()
    for name in present(result):
        assert getattr(result, name).equals(result.layers[name])


@pytest.mark.parametrize("name", PROPERTIES)
def test_layers__are_attributes_wherever_a_run_writes_them(name: str, result: furrowmap.Result, tmp_path: Path) -> None:
    (tmp_path / "report.json").write_bytes((result.path / "report.json").read_bytes())
    pyogrio.write_dataframe(result.trajectory, tmp_path / "field.gpkg", layer=name)
    opened = furrowmap.open_result(tmp_path)
    assert [*opened.layers] == [name]
    assert len(getattr(opened, name)) == len(opened.layers[name]) == len(result.trajectory)


def test_layers__of_other_names_are_refused(result: furrowmap.Result) -> None:
    assert "parcels" not in result.layers
    with pytest.raises(KeyError, match="parcels"):
        _ = result.layers["parcels"]


def test_result__without_a_layer_or_a_file_says_so(result: furrowmap.Result, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "report.json").write_bytes((result.path / "report.json").read_bytes())
    pyogrio.write_dataframe(result.trajectory, bare / "field.gpkg", layer="trajectory")
    opened = furrowmap.open_result(bare)
    with pytest.raises(furrowmap.InputError, match="no layer 'passes'"):
        _ = opened.passes
    with pytest.raises(furrowmap.InputError, match=r"no dsm\.tif"):
        _ = opened.dsm
    with pytest.raises(furrowmap.InputError, match=r"no cloud\.copc\.laz"):
        opened.points()
    with pytest.raises(furrowmap.InputError, match=r"no report\.json"):
        furrowmap.open_result(tmp_path)


def test_points__are_those_of_the_cloud(result: furrowmap.Result) -> None:
    points = result.points().read()
    cloud = laspy.read(result.path / "cloud.copc.laz")
    assert points.dtype == furrowmap.POINT
    assert_array_equal([points[axis] for axis in "xyz"], [cloud.x, cloud.y, cloud.z])
    np.testing.assert_allclose(points["t_s"], np.asarray(cloud.gps_time) + GPS_TO_UTC_S, rtol=0, atol=1e-6)
    for name, dimension in [
        ("intensity", "intensity"),
        ("classification", "classification"),
        ("return_number", "return_number"),
        ("returns", "number_of_returns"),
        ("point_source_id", "point_source_id"),
    ]:
        assert_array_equal(points[name], cloud[dimension])
    assert_array_equal(np.asarray(result.points()), points)
    assert result.points().crs.name == CRS("EPSG:6677").name


def test_points__of_a_rectangle_and_a_class_are_those_that_copclib_finds(result: furrowmap.Result) -> None:
    x, y = result.trajectory.geometry.x.iloc[0], result.trajectory.geometry.y.iloc[0]
    bounds = (x - 2.0, y - 3.0, x + 1.5, y + 2.5)
    reader = copclib.FileReader(str(result.path / "cloud.copc.laz"))
    inside = [
        (point.x, point.y, point.z)
        for node in reader.GetAllNodes()
        for point in reader.GetPoints(node)
        if bounds[0] <= point.x <= bounds[2] and bounds[1] <= point.y <= bounds[3] and point.classification == 2
    ]
    points = result.points(bounds=bounds, classes=(2,)).read()
    assert len(points) == len(inside) > 1000
    found = np.sort(points, order=("x", "y", "z"))
    assert_array_equal(np.column_stack([found[axis] for axis in "xyz"]), sorted(inside))
    for path in (result.path / "cloud.copc.laz", str(result.path / "cloud.copc.laz")):
        assert_array_equal(furrowmap.open_points(path, bounds, [2]).read(), points)


def test_points__in_chunks_are_the_same(result: furrowmap.Result) -> None:
    points = result.points(classes=(1, 2))
    chunks = list(points.chunks(20_000))
    assert len(chunks) > 2
    assert_array_equal(np.concatenate(chunks), points.read())
    none = result.points(bounds=(0.0, 0.0, 1.0, 1.0))
    assert (list(none.chunks()), len(none.read())) == ([], 0)


def test_open3d__missing_is_reported_in_three_lines(result: furrowmap.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(furrowmap.InputError, match="package open3d is not installed") as caught:
        result.points().to_open3d()
    assert (caught.value.code, len(str(caught.value).splitlines())) == ("extra-missing", 3)


class Recorded(ModuleType):
    """The part of Open3D that is used, with arrays in the place of its vectors."""

    class geometry:  # noqa: N801
        class PointCloud:
            points: Any = None
            colors: Any = None

    class utility:  # noqa: N801
        Vector3dVector = staticmethod(np.asarray)


def coloured(folder: Path) -> Path:
    """A red point, and one in a fifth of blue."""
    las = laspy.LasData(laspy.LasHeader(point_format=7, version="1.4"))
    las.x, las.y, las.z = [1.0, 2.0], [3.0, 4.0], [5.0, 6.0]
    las.red, las.green, las.blue = [65535, 0], [0, 0], [0, 13107]
    las.write(folder / "coloured.las")
    return folder / "coloured.las"


def test_open3d__gets_points_and_colours(
    result: furrowmap.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "open3d", Recorded("open3d"))
    points = result.points(classes=(65,))
    found = points.to_open3d()
    assert_array_equal(found.points.T, [points.read()[axis] for axis in "xyz"])
    assert found.colors is None
    found = furrowmap.open_points(coloured(tmp_path)).to_open3d()
    np.testing.assert_allclose(found.colors, [[1, 0, 0], [0, 0, 0.2]])


def test_open3d__makes_a_point_cloud(result: furrowmap.Result, tmp_path: Path) -> None:
    """Skipped where it is missing; `make test-open3d` has it."""
    pytest.importorskip("open3d")
    points = result.points(classes=(65,))
    cloud = points.to_open3d()
    assert_array_equal(np.asarray(cloud.points).T, [points.read()[axis] for axis in "xyz"])
    assert not cloud.has_colors()
    colours = furrowmap.open_points(coloured(tmp_path)).to_open3d().colors
    np.testing.assert_allclose(np.asarray(colours), [[1, 0, 0], [0, 0, 0.2]])


@pytest.mark.parametrize("name", ["dsm", "dsm_before", "change"])
def test_surfaces__are_those_of_the_geotiffs(result: furrowmap.Result, name: str) -> None:
    xarray = pytest.importorskip("xarray")
    surface = getattr(result, name)
    assert isinstance(surface, xarray.DataArray)
    with rasterio.open(result.path / f"{name}.tif") as source:
        values = source.read(1, masked=True).filled(np.nan)
        x, y = source.xy(7, 11)
        crs = CRS.from_wkt(source.crs.to_wkt())
    assert_array_equal(surface.values, values)
    assert (float(surface.x[11]), float(surface.y[7])) == pytest.approx((x, y), abs=1e-9)
    assert CRS.from_wkt(surface.attrs["crs"]) == crs
    assert surface.sel(x=x, y=y, method="nearest").equals(surface[7, 11])


def test_surface__is_an_array_with_its_transform_without_xarray(
    result: furrowmap.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    dsm = result.dsm
    assert isinstance(dsm, furrowmap.Raster)
    with rasterio.open(result.path / "dsm.tif") as source:
        assert_array_equal(dsm.array, source.read(1, masked=True).filled(np.nan))
        assert (dsm.transform, dsm.crs) == (source.transform, CRS.from_wkt(source.crs.to_wkt()))
