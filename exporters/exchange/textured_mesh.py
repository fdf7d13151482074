"""The surface of a result with its orthophoto as texture: binary glTF 2.0 (Khronos, ISO/IEC 12113).

glTF has y up and no place for a CRS. Coordinates are metres of the map against a local origin, which the file states:
32-bit floats far from their origin would be centimetres off.
"""

from __future__ import annotations

import json
import struct
import warnings
from dataclasses import dataclass
from importlib.metadata import version
from math import ceil, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import DSM, ORTHOPHOTO, ResultFolder

FloatArray = NDArray[np.float64]

MESH: Final = "glb"
MOST_VERTICES: Final = 1_000_000
"""A file of this many has 44 MB beside its texture; programs for maps and the web show it without waiting."""
MOST_PIXELS: Final = 8192
"""Across the texture: the largest that graphics cards of laptops take without exception."""
UNSEEN: Final = 128
"""Level of places without a picture."""
_GLB, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UINT, _VERTICES, _INDICES = 5126, 5125, 34962, 34963
_QUALITY: Final = "88"


@dataclass(frozen=True)
class _Surface:
    """Heights at the middles of cells, which may be larger than those of the file.

    Attributes:
        height_m: (rows, columns), nan where there are none.
        east, north: (columns,) and (rows,) of the middles, metres of the map.
        crs: in words.
    """

    height_m: FloatArray
    east: FloatArray
    north: FloatArray
    crs: str
    cell_m: float


@dataclass(frozen=True)
class _Texture:
    """A picture as JPEG.

    Attributes:
        west, north, width_m, height_m: of its edges, metres of the map.
    """

    jpeg: bytes
    west: float
    north: float
    width_m: float
    height_m: float


def write_textured_mesh(target: Path, result: ResultFolder) -> list[Notice]:
    """Write the surface model of a result with its orthophoto as a mesh.

    Cells become vertices, at most MOST_VERTICES: beyond, heights are means over larger cells. Holes stay holes.

    Args:
        result: with `dsm.tif` and `orthophoto.tif`.

    Returns:
        That the cells or pixels are larger than those of the result, where they are.

    Raises:
        InputError: if one of the two is missing or cannot be read.
        OSError: if the file cannot be written.
    """
    for name in (DSM, ORTHOPHOTO):
        if not (result.folder / name).is_file():
            raise InputError("no-orthophoto", folder=result.folder, name=name)
    surface = _surface(result.folder / DSM)
    texture, notices = _texture(result.folder / ORTHOPHOTO)
    step_m = float(surface.east[1] - surface.east[0]) if len(surface.east) > 1 else surface.cell_m
    if step_m > 1.01 * surface.cell_m:
        notices.insert(0, Notice("mesh-reduced", step_m=step_m, dsm=DSM, cell_m=surface.cell_m))
    with atomic_output(target) as unfinished:
        _write_glb(unfinished, surface, texture, result)
    return notices


def _surface(path: Path) -> _Surface:
    from rasterio.enums import Resampling

    with open_geotiff(path, _unusable) as raster:
        factor = max(1, ceil(sqrt(raster.height * raster.width / MOST_VERTICES)))
        shape = ceil(raster.height / factor), ceil(raster.width / factor)
        heights = raster.read(1, out_shape=shape, resampling=Resampling.average, masked=True)
        left, bottom, right, top = raster.bounds
        return _Surface(
            np.ma.filled(heights.astype(np.float64), np.nan),
            left + (np.arange(shape[1]) + 0.5) * (right - left) / shape[1],
            top - (np.arange(shape[0]) + 0.5) * (top - bottom) / shape[0],
            raster.crs.to_string() if raster.crs is not None else "",
            float(raster.transform.a),
        )


def _texture(path: Path) -> tuple[_Texture, list[Notice]]:
    import rasterio
    from rasterio.enums import Resampling
    from rasterio.errors import NotGeoreferencedWarning

    notices = []
    with open_geotiff(path, _unusable) as raster:
        factor = max(1.0, max(raster.height, raster.width) / MOST_PIXELS)
        shape = max(1, round(raster.height / factor)), max(1, round(raster.width / factor))
        rgb = raster.read((1, 2, 3), out_shape=(3, *shape), resampling=Resampling.average)
        seen = raster.dataset_mask(out_shape=shape) > 0
        left, bottom, right, top = raster.bounds
        if factor > 1.0:
            size = (right - left) / shape[1]
            notices.append(Notice("texture-reduced", size=size, orthophoto=ORTHOPHOTO, a=raster.transform.a))
    rgb[:, ~seen] = UNSEEN
    with warnings.catch_warnings(), rasterio.MemoryFile(ext=".jpg") as memory:
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        kind: dict[str, Any] = {"driver": "JPEG", "height": shape[0], "width": shape[1], "count": 3, "dtype": "uint8"}
        with memory.open(**kind, QUALITY=_QUALITY) as picture:
            picture.write(rgb)
        return _Texture(memory.read(), left, top, right - left, top - bottom), notices


def _write_glb(path: Path, surface: _Surface, texture: _Texture, result: ResultFolder) -> None:
    """The file: header, JSON, and one binary chunk with vertices, places in the texture, triangles and the picture."""
    has = np.isfinite(surface.height_m)
    row, column = np.nonzero(has)
    east, north, height = surface.east[column], surface.north[row], surface.height_m[has]
    if not len(height):
        raise _unusable(result.folder / DSM, "the surface has no heights")
    origin = [float(np.floor(values.min())) for values in (east, north, height)]
    place = np.column_stack([east - origin[0], height - origin[2], origin[1] - north]).astype("<f4")
    at = np.column_stack([(east - texture.west) / texture.width_m, (texture.north - north) / texture.height_m])
    number = np.full(has.shape, -1, np.int64)
    number[has] = np.arange(len(height))
    corners = triangles(number).astype("<u4")
    parts = [place.tobytes(), at.astype("<f4").tobytes(), corners.tobytes(), texture.jpeg]
    views, offset = [], 0
    for part, target in zip(parts, (_VERTICES, _VERTICES, _INDICES, None), strict=True):
        view = {"buffer": 0, "byteOffset": offset, "byteLength": len(part)}
        views.append(view if target is None else view | {"target": target})
        offset += _padded(len(part))
    stated = {"crs": surface.crs, "origin_m": origin, "axes": "x east, y up, z south, metres of the map"}
    content = _content(place, corners, views, offset, result.name, stated)
    content["asset"]["extras"] = result.origin.metadata
    text = json.dumps(content, ensure_ascii=False).encode()
    text += b" " * (_padded(len(text)) - len(text))
    with path.open("wb") as file:
        file.write(struct.pack("<5I", _GLB, 2, 28 + len(text) + offset, len(text), _JSON) + text)
        file.write(struct.pack("<2I", offset, _BIN))
        for part in parts:
            file.write(part + bytes(_padded(len(part)) - len(part)))


def _content(
    place: NDArray[np.float32],
    corners: NDArray[np.uint32],
    views: list[dict[str, int]],
    size: int,
    name: str,
    stated: dict[str, Any],
) -> dict[str, Any]:
    """The JSON of the file."""
    extent = {"min": place.min(axis=0).tolist(), "max": place.max(axis=0).tolist()}
    east, north, up = stated["origin_m"]
    return {
        "asset": {"version": "2.0", "generator": f"furrowmap {version('furrowmap')}"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0], "extras": stated}],
        "nodes": [{"mesh": 0, "name": f"{name}, origin {east:.0f} {north:.0f} {up:.0f}"}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0, "mode": 4}]}
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": 0},
                    "metallicFactor": 0.0,
                    "roughnessFactor": 1.0,
                },
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}],
        "images": [{"bufferView": 3, "mimeType": "image/jpeg"}],
        "accessors": [
            {"bufferView": 0, "componentType": _FLOAT, "count": len(place), "type": "VEC3", **extent},
            {"bufferView": 1, "componentType": _FLOAT, "count": len(place), "type": "VEC2"},
            {"bufferView": 2, "componentType": _UINT, "count": corners.size, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": size}],
    }


def triangles(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (m, 3) between the vertices of a grid, counter-clockwise from above.

    Args:
        number: (rows, columns) of the vertices, rows from north to south; −1 where there is none.
    """
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    has = [corner >= 0 for corner in (a, b, c, d)]
    found = []
    # Two triangles where all four are there, one where three are.
    for corners, condition in (
        ((a, c, b), has[0] & has[1] & has[2]),
        ((b, c, d), has[1] & has[2] & has[3]),
        ((a, c, d), has[0] & ~has[1] & has[2] & has[3]),
        ((a, d, b), has[0] & has[1] & ~has[2] & has[3]),
    ):
        found.append(np.column_stack([corner[condition] for corner in corners]))
    return np.concatenate(found)


def _padded(size: int) -> int:
    """The next multiple of 4."""
    return -(-size // 4) * 4


def _unusable(path: Path, fault: str) -> InputError:
    return InputError("not-a-surface", path=path, fault=fault)
