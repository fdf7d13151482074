"""Points of clouds sorted by parcel, and bare soil around the parcels by tile, in one pass and in a temporary file."""

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.crops.bare_soil import SoilCells, noise_in_pixels, soil_cells
from furrowmap.core.readers.areas.rings import ring_at, rings_of
from furrowmap.core.runtime.arrays import Float32Array, FloatArray, IntArray
from furrowmap.core.runtime.background import in_threads
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.record_spool import RecordSpool, square_keys
from furrowmap.core.values.parcel import Parcel

CROP_MARGIN_M: Final = 0.12
"""Soil nearer than this to a gross parcel is left out: beams meet the side of the crop there."""
SOIL_REACH_M: Final = 3.0
"""Soil farther than this from every gross parcel is not needed."""
PUBLISHED_STRIP_M: Final = 0.25
"""Width of the strip around a gross parcel whose points belong to the parcel too, for the published method."""
EDGE_M: Final = 0.06
"""Width of the strip around a net parcel whose points are kept: pixels on its outline are whole."""
SOIL_TILE_M: Final = 8.0
"""Side of the squares by which the soil is stored."""
USUAL_NOISE_M: Final = 0.012
"""Standard deviation of a return's height where bare soil does not show it: range noise in data sheets."""
MIN_NOISE_PIXELS: Final = 200
_WAITING: Final = 1 << 18
"""Points that are written together."""
_POINT: Final = np.dtype(("<f4", 3))


class ParcelPoints:
    """Collects points by parcel: a context manager. `kept` are the polygons whose points are kept, by parcel.

    Args:
        parcels: the parcels; their net parts do not overlap.
        folder: for the temporary files; None for the default one.
        around_m: width of the strip around the gross parcels whose points are kept too; None keeps the points of the
            net parcels only.
        notices: about the file of the parcels.
    """

    def __init__(
        self,
        parcels: Sequence[Parcel],
        folder: Path | None,
        around_m: float | None = None,
        notices: Sequence[Notice] = (),
    ) -> None:
        self.parcels = tuple(parcels)
        self.notices = tuple(notices)
        bounds = np.array([parcel.gross.bounds for parcel in parcels])
        self.origin_m = (float(np.floor(bounds[:, 0].min())), float(np.floor(bounds[:, 1].min())))
        self.kept = [_wider(p.net, EDGE_M) if around_m is None else _wider(p.gross, around_m) for p in parcels]
        self._own_rings = rings_of(self.kept, self.origin_m)
        self._crop = rings_of([_wider(parcel.gross, CROP_MARGIN_M) for parcel in parcels], self.origin_m)
        self._reach = rings_of([_wider(parcel.gross, SOIL_REACH_M) for parcel in parcels], self.origin_m)
        self._wide = around_m is not None and around_m > CROP_MARGIN_M
        # Tiles are numbered by columns, from the one in the south-west.
        low = np.floor(self._reach.boxes[:, :2].min(axis=0) / SOIL_TILE_M).astype(int) - 1
        high = np.floor(self._reach.boxes[:, 2:].max(axis=0) / SOIL_TILE_M).astype(int) + 1
        self._tiles = int(low[0]), int(low[1]), int(high[1] - low[1]) + 1
        self._base_m: float | None = None
        self._storing = threading.Lock()
        self._waiting: list[tuple[Float32Array, IntArray, Float32Array, IntArray]] = []
        self._waiting_points = 0
        self._own = RecordSpool(_POINT, folder)
        self._soil = RecordSpool(_POINT, folder)
        self.count = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._own.close()
        self._soil.close()

    @property
    def box_m(self) -> tuple[float, float, float, float]:
        """West, south, east, north of all that is kept, in map coordinates."""
        west, south = self._reach.boxes[:, :2].min(axis=0) + self.origin_m
        east, north = self._reach.boxes[:, 2:].max(axis=0) + self.origin_m
        return float(west), float(south), float(east), float(north)

    def add(self, xyz_m: FloatArray) -> None:
        """Add points (n, 3) float64 in map coordinates."""
        if not len(xyz_m):
            return
        if self._base_m is None:
            self._base_m = float(np.floor(np.median(xyz_m[:, 2])))
        x = xyz_m[:, 0] - self.origin_m[0]
        y = xyz_m[:, 1] - self.origin_m[1]
        sown = ring_at(self._crop, x, y) >= 0
        own = ring_at(self._own_rings, x, y, None if self._wide else sown)
        tile = ring_at(self._reach, x, y, ~sown)
        _number_tiles(x, y, tile, *self._tiles)
        corner = (*self.origin_m, self._base_m)
        found = *_select_keyed(xyz_m, corner, own), *_select_keyed(xyz_m, corner, tile)
        self.count += len(found[0])
        self._waiting.append(found)
        self._waiting_points += len(found[0]) + len(found[2])
        if self._waiting_points >= _WAITING:
            self._store()

    def _store(self) -> None:
        """Write the points that wait."""
        with self._storing:
            if not self._waiting:
                return
            columns = zip(*self._waiting, strict=True)
            own, parcel, soil, tile = (np.concatenate(c) if len(c) > 1 else c[0] for c in columns)
            self._own.add(own, parcel)
            self._soil.add(soil, tile)
            self._waiting.clear()
            self._waiting_points = 0

    def of(self, number: int) -> FloatArray:
        """The points (n, 3) float64 of a parcel by its number, in map coordinates."""
        self._store()
        return self._on_map(self._own.read([number]))

    def soil(self) -> SoilCells:
        """The cells of bare soil near the parcels, in map coordinates."""
        self._store()

        def cells(keys: Sequence[int]) -> list[SoilCells]:
            return [soil_cells(self._on_map(self._soil.read([key]))) for key in keys]

        tiles = list(chain.from_iterable(in_threads(cells, list(self._soil.counts))))
        empty = soil_cells(np.zeros((0, 3)))
        return SoilCells(*(np.concatenate([getattr(c, name) for c in (empty, *tiles)]) for name in vars(empty)))

    def noise_m(self, pixel_m: float) -> float:
        """Standard deviation of the heights of returns from one pixel of bare soil; `USUAL_NOISE_M` with too few."""
        self._store()
        keys = list(self._soil.counts)
        some = keys[:: max(1, len(keys) // 40)]

        def noises(keys: Sequence[int]) -> list[FloatArray]:
            return [noise_in_pixels(self._on_map(self._soil.read([key])), pixel_m) for key in keys]

        noise = np.concatenate([np.zeros(0), *chain.from_iterable(in_threads(noises, some))])
        if len(noise) < MIN_NOISE_PIXELS:
            return USUAL_NOISE_M
        return float(noise[noise < 3.0 * np.median(noise)].mean())  # pixels with more hold an edge, not soil

    def _on_map(self, near: NDArray[Any]) -> FloatArray:
        corner = np.array([*self.origin_m, self._base_m or 0.0])
        out: FloatArray = near.astype(np.float64) + corner
        return out


class CellsNear(Mapping[str, SoilCells]):
    """The cells of the site's soil within reach of each parcel, by its id; gathered when they are asked for."""

    def __init__(self, parcels: Sequence[Parcel], soil: SoilCells) -> None:
        self._parcels = {parcel.id: parcel for parcel in parcels}
        tile = np.floor(soil.xy_m / SOIL_TILE_M).astype(np.int64)
        keys = square_keys(tile[:, 0], tile[:, 1])
        order = np.argsort(keys, kind="stable")
        self._keys = keys[order]
        self._soil = soil.at(order)

    def __getitem__(self, name: str) -> SoilCells:
        shape = _wider(self._parcels[name].gross, SOIL_REACH_M)
        west, south, east, north = (math.floor(end / SOIL_TILE_M) for end in shape.bounds)
        columns = np.arange(west, east + 1)
        first = np.searchsorted(self._keys, square_keys(columns, south))
        end = np.searchsorted(self._keys, square_keys(columns, north), side="right")
        some = self._soil.at(np.concatenate([np.arange(a, b) for a, b in zip(first, end, strict=True)]))
        return some.at(shapely.contains_xy(shape, some.xy_m))

    def __contains__(self, name: object) -> bool:
        return name in self._parcels

    def __iter__(self) -> Iterator[str]:
        return iter(self._parcels)

    def __len__(self) -> int:
        return len(self._parcels)


@kernel()
def _number_tiles(x, y, tile, west, south, rows):  # type: ignore[no-untyped-def]
    """Replace the values from 0 on by the number of the tile that the point lies in."""
    for k in range(len(tile)):
        if tile[k] >= 0:
            tile[k] = (math.floor(x[k] / SOIL_TILE_M) - west) * rows + math.floor(y[k] / SOIL_TILE_M) - south


@kernel()
def _select_keyed(points, corner, key):  # type: ignore[no-untyped-def]
    """The points (n, 3) with a key from 0 on, as float32 from a corner, and their keys."""
    count = 0
    for k in range(len(key)):
        count += key[k] >= 0
    out = np.empty((count, 3), np.float32)
    keys = np.empty(count, np.int64)
    n = 0
    for k in range(len(key)):
        if key[k] >= 0:
            keys[n] = key[k]
            for axis in range(3):
                out[n, axis] = points[k, axis] - corner[axis]
            n += 1
    return out, keys


def _wider(shape: shapely.Polygon, by_m: float) -> shapely.Polygon:
    return shape.buffer(by_m, join_style="mitre")
