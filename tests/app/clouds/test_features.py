"""`furrowmap.features`: the products of a simulated yard, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import geopandas as gpd
import laspy
import numpy as np
import pyogrio
import pyproj
import pytest

import furrowmap
from benchmarks.yards import Yard, yard
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, RefusedError, UsageError
from tests.app.told_progress import Told

EAST, NORTH = -20_000.0, -40_000.0


def write(path: Path, xyz: np.ndarray, crs: str | None = "EPSG:6677", classes: Any = 1, rgb: Any = None) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6 if rgb is None else 7)
    header.scales, header.offsets = np.full(3, 0.001), np.array([EAST, NORTH, 0.0])
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    if crs is not None:
        header.add_crs(pyproj.CRS(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (xyz + np.array([EAST, NORTH, 30.0])).T if len(xyz) else np.zeros((3, 0))
    las.classification = np.broadcast_to(classes, len(xyz)).astype(np.uint8)
    las.return_number = las.number_of_returns = np.ones(len(xyz), np.uint8)
    las.gps_time = 3e8 + np.arange(len(xyz)) * 1e-4
    if rgb is not None:
        las.red, las.green, las.blue = (rgb * 65535).astype(np.uint16).T
    las.write(path)
    return path


@pytest.fixture(scope="module")
def seen() -> Yard:
    return yard(5, 20.0, 0.7)


@pytest.fixture(scope="module")
def cloud(seen: Yard, tmp_path_factory: pytest.TempPathFactory) -> Path:
    noise = np.where(np.arange(len(seen.kind)) < 5, 7, 1)
    return write(tmp_path_factory.mktemp("yard") / "yard.laz", seen.xyz_m, classes=noise, rgb=seen.rgb)


@pytest.fixture(scope="module")
def folder(cloud: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("features") / "out"
    furrowmap.features([cloud], out, progress=Told())
    return out


def test_cloud__has_every_point_with_its_class(seen: Yard, folder: Path) -> None:
    las = laspy.read(folder / "cloud.copc.laz")
    assert len(las.points) == len(seen.xyz_m)
    codes, counts = np.unique(np.asarray(las.classification), return_counts=True)
    assert {*codes.tolist()} == {2, 3, 4, 5, 7, 66, 67, 68}
    assert counts[codes == 7] == 5
    assert counts[codes == 2] == pytest.approx(np.count_nonzero(seen.kind == 0), rel=0.02)
    account = json.loads((folder / "features.json").read_text())
    assert account["points_by_class"] == {str(c): n for c, n in zip(codes.tolist(), counts.tolist(), strict=True)}
    assert account["figures"]["points_ground"] == counts[codes == 2]
    assert account["products"] == ["cloud.copc.laz", "features.gpkg", "features.json"]
    assert account["warnings"] == []


def test_layers__have_styles_and_what_stands_in_the_yard(seen: Yard, folder: Path) -> None:
    path = folder / "features.gpkg"
    styled = pyogrio.read_dataframe(path, layer="layer_styles")
    assert {*styled["f_table_name"]} == {"planes", "lines", "plants"} <= {*styled["styleName"]}
    planes, lines, plants = (gpd.read_file(path, layer=name) for name in ("planes", "lines", "plants"))
    assert planes.crs.to_epsg() == 6677
    rectangles = np.array(seen.scene.rectangles)
    level = rectangles[rectangles[:, 9] == 1]
    area = np.linalg.norm(np.cross(level[:, 3:6], level[:, 6:9]), axis=1).sum()
    assert planes.area_m2[planes.kind == "horizontal"].sum() == pytest.approx(area, rel=0.15)
    flat = planes[planes.kind == "horizontal"]
    np.testing.assert_allclose(flat.area, flat.area_m2 * np.cos(np.radians(flat.tilt_deg)), rtol=1e-6)
    np.testing.assert_allclose(planes.normal_e**2 + planes.normal_n**2 + planes.normal_h**2, 1.0)
    assert planes.tilt_deg[planes.kind == "vertical"].min() > 80.0
    assert {*lines.kind} >= {"pole", "wall"}
    cylinders = np.array(seen.scene.cylinders)
    tallest = (cylinders[:, 5] - cylinders[:, 2]).max() - 0.1
    assert lines.height_m[lines.kind == "pole"].max() == pytest.approx(tallest, abs=0.4)
    assert lines.length_m.min() > 0.5
    tops = np.column_stack([plants.geometry.x - EAST, plants.geometry.y - NORTH])
    trees = [box for box in seen.scene.plants if box[5] - box[2] > 1.5]
    assert len(trees) >= 2
    for west, south, _, east, north, *_ in trees:
        assert np.all((tops > [west, south]) & (tops < [east, north]), axis=1).any()


def test_a_classified_cloud__keeps_its_ground(cloud: Path, folder: Path, tmp_path: Path) -> None:
    account = furrowmap.features([folder / "cloud.copc.laz"], tmp_path / "again")
    assert account["parameters"]["ground"] == "class"
    whole = json.loads((folder / "features.json").read_text())
    assert account["figures"]["points_ground"] == pytest.approx(whole["figures"]["points_ground"], rel=0.01)


def test_sparse_points__are_said_to_be_sparse(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(0.0, 60.0, (3000, 2)), np.zeros(3000)])
    account = furrowmap.features([write(tmp_path / "a.las", flat)], tmp_path / "out")
    assert [warning["code"] for warning in account["warnings"]] == ["features-sparse"]
    assert account["figures"]["points_ground"] == 3000
    layers = {name: gpd.read_file(tmp_path / "out" / "features.gpkg", layer=name) for name in ("planes", "plants")}
    assert [len(layer) for layer in layers.values()] == [0, 0]


def test_refusals(cloud: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    some = np.random.default_rng(1).uniform(0.0, 5.0, (100, 3))
    with pytest.raises(InputError) as missing:
        furrowmap.features([write(tmp_path / "none.las", some, crs=None)], tmp_path / "a")
    with pytest.raises(InputError) as empty:
        furrowmap.features([write(tmp_path / "empty.las", np.zeros((0, 3)))], tmp_path / "a")
    with pytest.raises(InputError) as unclassified:
        furrowmap.features([cloud], tmp_path / "a", furrowmap.FeatureSettings(ground="class"))
    with pytest.raises(RefusedError) as there:
        furrowmap.features([cloud], folder)
    (tmp_path / "report.json").write_text("{}")
    with pytest.raises(RefusedError) as of_run:
        furrowmap.features([cloud], tmp_path)
    with pytest.raises(UsageError, match="--ground-method 'guess'"):
        furrowmap.FeatureSettings(ground="guess")  # type: ignore[arg-type]
    codes = [error.value.code for error in (missing, empty, unclassified, of_run)]
    assert codes == ["crs-missing", "no-points-left", "no-ground-class", "output-is-run"]
    assert there.value.exit_status == 4
    assert not (tmp_path / "a").exists()
    assert command_line(["features", str(tmp_path / "empty.las"), "-o", str(tmp_path / "a")]) == 3
    assert len(capsys.readouterr().err.strip().splitlines()) == 3


def test_command__answers_with_figures_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(0.0, 10.0, (2000, 2)), rng.normal(0.0, 0.01, 2000)])
    path = write(tmp_path / "flat.las", flat)
    assert (
        command_line(["features", str(path), "-o", str(tmp_path / "out"), "--bbox", "-20000,-40000,-19995,-39990"]) == 0
    )
    words = capsys.readouterr().out
    assert "points ground" in words
    assert "features.gpkg" in words
