"""Features of simulated yards: F1 of each class by shape and colours, and speed beside jakteristics.

``python benchmarks/features.py table [SEED…]`` prints F1 of yards of 24 m; ``python benchmarks/features.py speed``
prints points per second.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter, process_time

import numpy as np
from numpy.typing import NDArray

from benchmarks.yards import Kind, Yard, yard
from furrowmap.core.features.classification import FeatureTile, classify
from furrowmap.core.features.eigenfeatures import neighbourhoods
from furrowmap.core.surfaces.ground_filter import classify_ground

CELL_M = 0.05
SIZE_M = 24.0
RADIUS_M = 0.3
HELD_OUT = (101, 102, 103, 104, 105, 106)


def f1(kind: NDArray[np.int8], feature: NDArray[np.uint8]) -> list[float]:
    """F1 of each class."""
    out = []
    for k in Kind:
        both = 2.0 * np.count_nonzero((kind == k) & (feature == k + 1))
        out.append(both / (np.count_nonzero(kind == k) + np.count_nonzero(feature == k + 1)))
    return out


def scores(seen: Yard) -> NDArray[np.float64]:
    """F1 (2, 5) by shape, with colours."""
    ground = classify_ground(seen.xyz_m)
    tiles = [FeatureTile(seen.xyz_m, ground, CELL_M, rgb) for rgb in (None, seen.rgb)]
    return np.array([f1(seen.kind, classify(tile).feature) for tile in tiles])


def table(seeds: tuple[int, ...]) -> None:
    """Print F1 of each yard, their means and their least."""
    found = []
    for seed in seeds:
        found.append(scores(yard(seed, SIZE_M)))
        for name, row in zip(("shape", "colours"), found[-1], strict=True):
            print(seed, name, *(f"{kind.name.lower()} {value:.3f}" for kind, value in zip(Kind, row, strict=True)))
    print("mean", np.mean(found, axis=0).round(3), "least", np.min(found, axis=0).round(3), sep="\n")


def speed() -> None:
    """Print points per second."""
    import jakteristics

    seen = yard(1, 32.0, 2.0)
    xyz, ground = seen.xyz_m, classify_ground(seen.xyz_m)
    neighbourhoods(xyz[:1000], xyz[:1000], (RADIUS_M,))
    classify(FeatureTile(xyz[:50_000], ground[:50_000], CELL_M))  # compiles
    some = xyz[(xyz[:, 0] < 16.0) & (xyz[:, 1] < 16.0)]
    begin = process_time()
    neighbourhoods(some, some, (RADIUS_M,))
    ours, begin = process_time() - begin, process_time()
    names = ["linearity", "planarity", "sphericity", "verticality", "nx", "ny", "nz"]
    jakteristics.compute_features(some, RADIUS_M, num_threads=1, feature_names=names)
    theirs = process_time() - begin
    print(f"eigenfeatures: {len(some) / ours:,.0f} points/s a core, {theirs / ours:.1f} times jakteristics")
    begin = process_time()
    classify_ground(xyz)
    filtered, begin = process_time() - begin, process_time()
    classify(FeatureTile(xyz, ground, CELL_M))
    classed = process_time() - begin
    print(
        f"SMRF: {len(xyz) / filtered:,.0f} points/s a core; classification: {len(xyz) / classed:,.0f} points/s a core"
    )
    wall = perf_counter()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(classify, [FeatureTile(xyz, ground, CELL_M)] * 2))
    print(f"two tiles in two threads: {2 * len(xyz) / (perf_counter() - wall):,.0f} points/s of the clock")


if __name__ == "__main__":
    if sys.argv[1:2] == ["speed"]:
        speed()
    else:
        table(tuple(map(int, sys.argv[2:])) or HELD_OUT)
