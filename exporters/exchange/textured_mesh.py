"""The surface of a result with its orthophoto as texture: binary glTF 2.0 (Khronos, ISO/IEC 12113).

glTF has y up and no place for a CRS. Coordinates are metres of the map against a local origin, which the file states:
32-bit floats far from their origin would be centimetres off.
"""

import json
import struct
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from math import ceil, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import NotGeoreferencedWarning

from furrowmap.core.readers.geotiff import open_geotiff
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Words
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import DSM, ORTHOPHOTO, ResultFolder

MESH: Final = "glb"
MAX_MESH_VERTICES: Final = 1_000_000
"""A file of this many has 44 MB beside its texture; programs for maps and the web show it without waiting."""
MAX_TEXTURE_PIXELS: Final = 8192
"""Across the texture: the largest that graphics cards of laptops take without exception."""
UNSEEN_GREY: Final = 128
"""Level of places without a picture."""
_GLB: Final = 0x46546C67
_JSON: Final = 0x4E4F534A
_BIN: Final = 0x004E4942
_FLOAT: Final = 5126
_UINT: Final = 5125
_VERTICES: Final = 34962
_INDICES: Final = 34963
_QUALITY: Final = "88"


def write_textured_mesh(target: Path, result: ResultFolder) -> list[Notice]:
    """Write the surface model of a result with its orthophoto as a mesh; a notice where cells or pixels are coarsened.

    Cells become vertices, at most MAX_MESH_VERTICES: beyond, heights are means over larger cells. Holes stay holes.
    """
    for name in (DSM, ORTHOPHOTO):
        if not (result.folder / name).is_file():
            raise InputError("no-orthophoto", folder=result.folder, name=name)
    dsm = result.folder / DSM
    notices = []
    with open_geotiff(dsm, _unusable) as raster:
        factor = max(1, ceil(sqrt(raster.height * raster.width / MAX_MESH_VERTICES)))
        rows = ceil(raster.height / factor)
        columns = ceil(raster.width / factor)
        heights = raster.read(1, out_shape=(rows, columns), resampling=Resampling.average, masked=True)
        left, bottom, right, top = raster.bounds
        crs = raster.crs.to_string() if raster.crs is not None else ""
        cell_m = float(raster.transform.a)
        step_m = (right - left) / columns
    if columns > 1 and step_m > 1.01 * cell_m:
        notices.append(Notice("mesh-reduced", step_m=step_m, dsm=DSM, cell_m=cell_m))
    jpeg, bounds, reduced = _texture(result.folder / ORTHOPHOTO)
    height_m = np.ma.filled(heights.astype(np.float64), np.nan)
    has = np.isfinite(height_m)
    if not has.any():
        raise _unusable(dsm, "the surface has no heights")
    number = np.full(has.shape, -1, np.int64)
    number[has] = np.arange(np.count_nonzero(has))
    row, column = np.nonzero(has)
    east = (left + (np.arange(columns) + 0.5) * (right - left) / columns)[column]
    north = (top - (np.arange(rows) + 0.5) * (top - bottom) / rows)[row]
    origin = [float(np.floor(values.min())) for values in (east, north, height_m[has])]
    place = np.column_stack([east - origin[0], height_m[has] - origin[2], origin[1] - north]).astype("<f4")
    west, _, _, edge = bounds
    at = np.column_stack([(east - west) / (bounds[2] - west), (edge - north) / (edge - bounds[1])]).astype("<f4")
    scene = {"crs": crs, "origin_m": origin, "axes": "x east, y up, z south, metres of the map"}
    with atomic_output(target) as unfinished:
        _write_glb(unfinished, place, at, triangles(number).astype("<u4"), jpeg, scene, result)
    return notices + reduced


def _texture(path: Path) -> tuple[bytes, Sequence[float], list[Notice]]:
    """A picture as JPEG, and its west, south, east and north edges."""
    notices = []
    with open_geotiff(path, _unusable) as raster:
        factor = max(1.0, max(raster.height, raster.width) / MAX_TEXTURE_PIXELS)
        shape = max(1, round(raster.height / factor)), max(1, round(raster.width / factor))
        rgb = raster.read((1, 2, 3), out_shape=(3, *shape), resampling=Resampling.average)
        rgb[:, raster.dataset_mask(out_shape=shape) == 0] = UNSEEN_GREY
        bounds = raster.bounds
        if factor > 1.0:
            size = (bounds.right - bounds.left) / shape[1]
            notices.append(
                Notice("texture-reduced", pixel_m=size, orthophoto=ORTHOPHOTO, orthophoto_pixel_m=raster.transform.a)
            )
    with warnings.catch_warnings(), rasterio.MemoryFile(ext=".jpg") as memory:
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        kind: dict[str, Any] = {"driver": "JPEG", "height": shape[0], "width": shape[1], "count": 3, "dtype": "uint8"}
        with memory.open(**kind, QUALITY=_QUALITY) as picture:
            picture.write(rgb)
        return memory.read(), bounds, notices


def _write_glb(
    path: Path,
    place: NDArray[np.float32],
    at: NDArray[np.float32],
    corners: NDArray[np.uint32],
    jpeg: bytes,
    scene: dict[str, Any],
    result: ResultFolder,
) -> None:
    """The file: header, JSON, and one binary chunk with vertices, places in the texture, triangles and the picture."""
    parts = [place.tobytes(), at.tobytes(), corners.tobytes(), jpeg]
    views = []
    offset = 0
    for part, target in zip(parts, (_VERTICES, _VERTICES, _INDICES, None), strict=True):
        view = {"buffer": 0, "byteOffset": offset, "byteLength": len(part)}
        views.append(view if target is None else view | {"target": target})
        offset += _padded(len(part))
    extent = {"min": place.min(axis=0).tolist(), "max": place.max(axis=0).tolist()}
    east, north, up = scene["origin_m"]
    content = {
        "asset": {"version": "2.0", "generator": f"furrowmap {version('furrowmap')}", "extras": result.origin.metadata},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0], "extras": scene}],
        "nodes": [{"mesh": 0, "name": f"{result.name}, origin {east:.0f} {north:.0f} {up:.0f}"}],
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
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(content, ensure_ascii=False).encode()
    text += b" " * (_padded(len(text)) - len(text))
    with path.open("wb") as file:
        file.write(struct.pack("<5I", _GLB, 2, 28 + len(text) + offset, len(text), _JSON) + text)
        file.write(struct.pack("<2I", offset, _BIN))
        for part in parts:
            file.write(part + bytes(_padded(len(part)) - len(part)))


def triangles(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (m, 3) of the vertices of a grid, counter-clockwise from above; −1 is no vertex."""
    a = number[:-1, :-1]
    b = number[:-1, 1:]
    c = number[1:, :-1]
    d = number[1:, 1:]
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


def _unusable(path: Path, fault: Words) -> InputError:
    return InputError("not-a-surface", path=path, fault=fault)
