"""The textured surface, opened by trimesh: vertices and colours are where the rasters have them."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from rasterio.transform import from_origin

from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.exchange import textured_mesh
from furrowmap.exporters.exchange.textured_mesh import triangles, write_textured_mesh
from furrowmap.exporters.files.result_folder import ResultFolder

WEST, NORTH, CELL = 651_000.5, 6_132_000.25, 0.25
SHAPE = (30, 50)
REPORT = {
    "furrowmap": "0.1.0",
    "session": {"name": "slope", "crs": {"map": "EPSG:25832"}},
    "coordinates": {"frame": "ETRS89", "epoch": None},
    "inputs": [{"name": "recording.pcap", "sha256": "00ff"}],
    "figures": {"start": "2026-06-11T01:23:40.937Z", "end": "2026-06-11T01:24:40.692Z"},
}


def height(east: NDArray[Any], north: NDArray[Any]) -> NDArray[Any]:
    """A slope, 20 m above the datum."""
    return 20.0 + 0.3 * (east - WEST) + 0.1 * (NORTH - north)


def colour(east: NDArray[Any], north: NDArray[Any]) -> NDArray[Any]:
    """Levels that change slowly to the east in red, to the south in green."""
    return np.stack([40 + 12 * (east - WEST), 30 + 20 * (NORTH - north), np.full(np.shape(east), 90.0)])


def middles(cell: float, shape: tuple[int, int]) -> tuple[NDArray[Any], NDArray[Any]]:
    east, north = WEST + cell * (np.arange(shape[1]) + 0.5), NORTH - cell * (np.arange(shape[0]) + 0.5)
    return tuple(np.meshgrid(east, north))  # type: ignore[return-value]


@pytest.fixture
def result(tmp_path: Path) -> ResultFolder:
    """A slope with a hole of two cells, and its picture in pixels of a fifth of a cell."""
    heights = height(*middles(CELL, SHAPE))
    heights[10, 20:22] = np.nan
    kind = {"driver": "GTiff", "crs": "EPSG:25832", "nodata": np.nan, "count": 1, "dtype": "float32"}
    place = {"height": SHAPE[0], "width": SHAPE[1], "transform": from_origin(WEST, NORTH, CELL, CELL)}
    with rasterio.open(tmp_path / "dsm.tif", "w", **kind, **place) as file:
        file.write(heights.astype(np.float32), 1)
    fine = (5 * SHAPE[0], 5 * SHAPE[1])
    rgb = np.round(colour(*middles(CELL / 5, fine))).astype(np.uint8)
    kind = {"driver": "GTiff", "crs": "EPSG:25832", "count": 3, "dtype": "uint8", "photometric": "RGB"}
    place = {"height": fine[0], "width": fine[1], "transform": from_origin(WEST, NORTH, CELL / 5, CELL / 5)}
    with rasterio.open(tmp_path / "orthophoto.tif", "w", **kind, **place) as file:
        file.write(rgb)
    return ResultFolder(tmp_path, REPORT, ())


def opened(path: Path) -> tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any]]:
    """trimesh's mesh; east, north and height of its vertices with the origin that the file states."""
    scene = trimesh.load(path)
    (mesh,) = scene.geometry.values()
    stated = scene.metadata if "origin_m" in scene.metadata else scene.metadata["extras"]
    assert stated["crs"] == "EPSG:25832"
    east, north, up = stated["origin_m"]
    x, y, z = np.asarray(mesh.vertices).T
    return mesh, x + east, north - z, y + up


def test_mesh__is_the_surface_in_the_colours_of_the_picture(result: ResultFolder, tmp_path: Path) -> None:
    assert write_textured_mesh(tmp_path / "x.glb", result) == []
    mesh, east, north, up = opened(tmp_path / "x.glb")
    assert len(east) == SHAPE[0] * SHAPE[1] - 2
    assert np.abs(up - height(east, north)).max() < 1e-4
    assert (east.min(), north.max()) == pytest.approx((WEST + CELL / 2, NORTH - CELL / 2))
    # Each quad has two triangles; around the hole of two cells, six are gone and four corners are left over.
    assert len(mesh.faces) == 2 * (SHAPE[0] - 1) * (SHAPE[1] - 1) - 2 * 6 + 4
    assert (mesh.face_normals[:, 1] > 0.9).all(), "up"
    off = np.abs(mesh.visual.to_color().vertex_colors[:, :3].T - colour(east, north))
    assert off.max() < 4.0, "levels: JPEG"
    size, kind = struct.unpack("<2I", (tmp_path / "x.glb").read_bytes()[12:20])
    asset = json.loads((tmp_path / "x.glb").read_bytes()[20 : 20 + size])["asset"]
    assert kind == 0x4E4F534A
    assert (asset["extras"]["SESSION"], asset["extras"]["INPUT_1"]) == ("slope", "recording.pcap sha256:00ff")


def test_large_results__become_larger_cells_and_pixels(
    result: ResultFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(textured_mesh, "MAX_MESH_VERTICES", 400)
    monkeypatch.setattr(textured_mesh, "MAX_TEXTURE_PIXELS", 100)
    told = write_textured_mesh(tmp_path / "x.glb", result)
    assert [notice.code for notice in told] == ["mesh-reduced", "texture-reduced"]
    assert "have 0.50 m, those of dsm.tif 0.25 m" in told[0].text
    mesh, east, north, up = opened(tmp_path / "x.glb")
    assert len(east) <= 400
    assert mesh.visual.material.baseColorTexture.size == (100, 60)
    assert np.median(np.abs(up - height(east, north))) < 1e-4
    off = np.abs(mesh.visual.to_color().vertex_colors[:, :3].T - colour(east, north))
    assert np.median(off) < 3.0


@pytest.mark.parametrize("name", ["dsm.tif", "orthophoto.tif"])
def test_result__without_one_of_both_is_refused(result: ResultFolder, tmp_path: Path, name: str) -> None:
    (tmp_path / name).unlink()
    with pytest.raises(InputError, match=f"has no {name}") as refused:
        write_textured_mesh(tmp_path / "x.glb", result)
    assert refused.value.code == "no-orthophoto"
    (tmp_path / name).write_bytes(b"no raster")
    with pytest.raises(InputError, match="cannot be read as a GeoTIFF"):
        write_textured_mesh(tmp_path / "x.glb", result)
    assert not (tmp_path / "x.glb").exists()


def test_surface__without_a_height_is_refused(result: ResultFolder, tmp_path: Path) -> None:
    with rasterio.open(tmp_path / "dsm.tif", "r+") as file:
        file.write(np.full(SHAPE, np.nan, np.float32), 1)
    with pytest.raises(InputError, match=r"dsm\.tif: the surface has no heights") as refused:
        write_textured_mesh(tmp_path / "x.glb", result)
    assert refused.value.code == "not-a-surface"
    assert not (tmp_path / "x.glb").exists()


@given(arrays(np.bool_, st.tuples(st.integers(2, 6), st.integers(2, 6))))
@settings(max_examples=60, deadline=None)
def test_triangles__cover_what_has_three_corners_once(has: NDArray[np.bool_]) -> None:
    number = np.where(has, np.cumsum(has).reshape(has.shape) - 1, -1)
    found = triangles(number)
    place = np.argwhere(has)[:, ::-1] * [1.0, -1.0]
    first, second = place[found[:, 1]] - place[found[:, 0]], place[found[:, 2]] - place[found[:, 0]]
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    assert (area == 0.5).all(), "counter-clockwise from above"
    corners = has[:-1, :-1].astype(int) + has[:-1, 1:] + has[1:, :-1] + has[1:, 1:]
    assert len(found) == 2 * (corners == 4).sum() + (corners == 3).sum()
