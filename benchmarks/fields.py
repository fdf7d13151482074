"""Simulated fields with a truth for each point: crop and bare soil, a fence at its edge, a power line over it, a ditch.

``python benchmarks/fields.py [SEED…]`` prints what `features` finds in fields of many crops, and what is not there.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numba
import numpy as np
import shapely

from benchmarks.yards import FloatArray, Kind, Scene, Yard, _poles, _rays, _wire_fence, cast
from furrowmap.core.features.classification import FeatureTile, classify
from furrowmap.core.features.cloud_features import _own_features
from furrowmap.core.features.objects import LineObject, join_planes
from furrowmap.core.surfaces.ground_filter import classify_ground

CROP_CELL_M = 0.04
RANGE_NOISE_M = 0.012


@dataclass(frozen=True)
class Crop:
    """What grows on a field.

    Attributes:
        height_m: 0 for none.
        row_m: distance of rows with bare soil between them; 0 for a closed crop.
        plots: whether it grows on plots of 2.5 m with bare tracks of half a metre between them, else everywhere but in
            two tramlines.
        extinction_per_m: chance that a metre of it stops a pulse.
        furrow_m: amplitude of furrows of 0.75 m in the soil.
    """

    height_m: float
    row_m: float = 0.0
    plots: bool = False
    extinction_per_m: float = 15.0
    furrow_m: float = 0.0


CROPS = {
    "ploughed": Crop(0.0, furrow_m=0.08),
    "wheat, 0.2 m": Crop(0.2),
    "wheat plots, 0.45 m": Crop(0.45, plots=True),
    "wheat, 0.8 m": Crop(0.8),
    "rye plots, 1.3 m": Crop(1.3, plots=True, extinction_per_m=8.0),
    "beet rows, 0.4 m": Crop(0.4, row_m=0.5, extinction_per_m=10.0),
    "potato ridges, 0.5 m": Crop(0.5, row_m=0.75, extinction_per_m=12.0, furrow_m=0.1),
    "maize, 1.0 m": Crop(1.0, row_m=0.75, extinction_per_m=5.0),
    "maize, 2.5 m": Crop(2.5, row_m=0.75, extinction_per_m=3.0),
}


def field(seed: int, crop: Crop, size_m: float = 24.0, density: float = 0.6) -> Yard:
    """A field of its own for each seed: the crop in the west, a fence beside it, a ditch in the east."""
    rng = np.random.default_rng(seed)
    turned = rng.uniform(-0.15, 0.15)
    across, along = np.array([math.cos(turned), math.sin(turned)]), np.array([-math.sin(turned), math.cos(turned), 0.0])
    waves = [[rng.uniform(0.02, 0.12), *rng.uniform(-0.3, 0.3, 2), rng.uniform(0.0, 6.0)] for _ in range(3)]
    waves.append([crop.furrow_m, *(across * math.tau / 0.75), 0.0])
    scene = Scene(size_m, np.array(waves), (size_m * 0.92, rng.uniform(0.35, 0.6), rng.uniform(0.8, 1.2)))
    _wire_fence(scene, rng, 0.79 * size_m, 0.5 * size_m, 0.8 * size_m, along)
    _poles(scene, rng, 0.4 * size_m, 0.5 * size_m, 0.8 * size_m)
    begin, way = _rays(rng, size_m, density)
    range_m, kind, rgb = cast(begin, way, *scene.arrays())
    if crop.height_m > 0.0:
        top = _crop_top(rng, crop, scene, across)
        depth = rng.standard_exponential(len(way)) / crop.extinction_per_m
        kind[_stop_in_crop(begin, way, depth, top, CROP_CELL_M, range_m)] = Kind.SCATTER
    seen = np.isfinite(range_m)
    noise = rng.normal(0.0, RANGE_NOISE_M, len(way))
    xyz = (begin + way * (range_m + noise)[:, None])[seen]
    inside = np.all((xyz[:, :2] > 0.0) & (xyz[:, :2] < size_m), axis=1)
    return Yard(xyz[inside], kind[seen][inside], rgb[seen][inside], scene)


def _crop_top(rng: np.random.Generator, crop: Crop, scene: Scene, across: FloatArray) -> FloatArray:
    """Height (columns, rows) of the top of the crop; -inf where there is none."""
    middles = (np.arange(int(scene.size_m / CROP_CELL_M)) + 0.5) * CROP_CELL_M
    x, y = np.meshgrid(middles, middles, indexing="ij")
    u, v = across[0] * x + across[1] * y, across[0] * y - across[1] * x
    ground = sum(a * np.sin(p * x + q * y + phase) for a, p, q, phase in scene.waves)
    end = 0.78 * scene.size_m * across[0]  # up to the fence
    grown = (x > 0.08 * scene.size_m) & (u < end) & (v > 0.1 * scene.size_m) & (v < 0.9 * scene.size_m)
    if crop.plots:
        grown &= (np.mod(u, 3.0) < 2.5) & (np.mod(v, 7.0) < 6.0)
    else:
        grown &= (np.abs(np.abs(u - 0.4 * scene.size_m) - 0.9) > 0.2) & (rng.random(x.shape) > 0.02)
    if crop.row_m:
        grown &= np.abs(np.mod(u, crop.row_m) - 0.5 * crop.row_m) < 0.3 * crop.row_m
    height = crop.height_m * (1.0 + 0.08 * rng.normal(size=x.shape))
    out: FloatArray = np.where(grown, ground + height, -np.inf)
    return out


@numba.njit(cache=True, nogil=True)
def _stop_in_crop(begin, way, depth, top, cell, range_m):  # type: ignore[no-untyped-def]
    """Which rays end in a crop after a depth in it, by which their ranges are shortened."""
    out = np.zeros(len(way), np.bool_)
    highest, step = top.max(), 0.02
    for i in range(len(way)):
        if way[i, 2] > -1e-3:
            continue
        t = max((highest - begin[i, 2]) / way[i, 2], 0.0)
        left = depth[i]
        while t < range_m[i]:
            j, k = int((begin[i, 0] + t * way[i, 0]) // cell), int((begin[i, 1] + t * way[i, 1]) // cell)
            if 0 <= j < top.shape[0] and 0 <= k < top.shape[1] and begin[i, 2] + t * way[i, 2] < top[j, k]:
                left -= step
                if left < 0.0:
                    range_m[i], out[i] = t, True
                    break
            t += step
    return out


@dataclass(frozen=True)
class Judged:
    """What was found in a field.

    Attributes:
        found: share of the length of ditch, cable and fence that was found.
        false: lines that are not there.
    """

    found: dict[str, float]
    false: list[LineObject]
    poles: int
    planes: int


def judge(seen: Yard, every: int = 1) -> Judged:
    """Lines of a field, told by its truth; of all points or every n-th."""
    scene = seen.scene
    xyz = seen.xyz_m[::every]
    cell_m = min(max(math.ceil(100.0 * scene.size_m / math.sqrt(len(xyz))) / 100.0, 0.05), 0.4)
    tile = FeatureTile(xyz, classify_ground(xyz), cell_m)
    found = _own_features(tile, classify(tile), np.ones(len(xyz), bool), np.zeros(3))
    planes = join_planes(found.planes)
    lines = found.all_lines(planes)
    thin = np.array(scene.cylinders)
    upright = np.abs(thin[:, 5] - thin[:, 2]) > 0.5
    wires = shapely.MultiLineString([[a[:2], a[3:5]] for a in thin[~upright & (thin[:, 2] < 3.0)]]).buffer(0.3)
    cable = shapely.MultiLineString([[a[:2], a[3:5]] for a in thin[~upright & (thin[:, 2] > 3.0)]])
    ditch = shapely.LineString([(scene.ditch[0], 0.0), (scene.ditch[0], scene.size_m)])
    posts = shapely.MultiPoint(thin[upright][:, :2]).buffer(0.4)
    places = {
        "ditch": (ditch, ditch.buffer(0.6), ("ditch",)),
        "cable": (cable, cable.buffer(0.4), ("wire",)),
        "fence": (wires, wires, ("fence", "wire", "wall")),
    }
    rims = ditch.buffer(scene.ditch[2] + 0.8)
    share, true = {}, set()
    for name, (course, near, kinds) in places.items():
        own = [line for line in lines if line.kind in kinds and near.buffer(0.2).contains(_flat(line))]
        true |= {id(line) for line in own}
        covered = shapely.union_all([_flat(line).buffer(0.3) for line in own])
        middle = course if name != "fence" else shapely.LineString([thin[upright][0, :2], thin[upright][-3, :2]])
        share[name] = middle.intersection(covered).length / middle.length
    true |= {id(line) for line in lines if line.kind == "edge" and rims.contains(_flat(line))}
    true |= {id(line) for line in lines if line.kind == "pole" and posts.contains(_flat(line))}
    false = [line for line in lines if id(line) not in true]
    return Judged(share, false, sum(each.kind == "pole" for each in lines), sum(not p.is_open for p in planes))


def _flat(line: LineObject) -> shapely.Geometry:
    return shapely.force_2d(line.shape)


if __name__ == "__main__":
    for seed in tuple(map(int, sys.argv[1:])) or (201,):
        for name, crop in CROPS.items():
            seen = field(seed, crop)
            for every in (1, 4, 16):
                told = judge(seen, every)
                false = ", ".join(f"{line.kind} {line.length_m:.0f} m" for line in told.false)
                shares = " ".join(f"{what} {share:.2f}" for what, share in told.found.items())
                print(f"{seed} {name}, 1/{every}: {shares} poles {told.poles} planes {told.planes} false: {false}")
