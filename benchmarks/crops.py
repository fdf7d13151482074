"""Speed of crops by parcel: ``python benchmarks/crops.py [PARCELS]``.

Parcels of 10 m by 2.5 m with 700 points a square metre, in memory; the limit is 5 s for 100 of them. With more than
1,000 the peak of the memory says whether it grows with their number. BLAS has one thread, as in every run of furrowmap.
"""

from __future__ import annotations

import math
import os
import resource
import sys
from time import process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import shapely

from furrowmap.core.crops.measure import measure_parcels
from furrowmap.core.crops.parcel_points import ParcelPoints
from furrowmap.core.crops.site_soil import site_soil
from furrowmap.core.values.parcel import Parcel

DENSITY_M2 = 700
LENGTH_M, WIDTH_M, ALLEY_M, TRACK_M = 10.0, 2.5, 1.0, 0.5
BATCH = 1_000_000


def main(count: int) -> None:
    """Print seconds of the processor, points a second and the memory."""
    columns = math.ceil(math.sqrt(count / 4.0))
    corners = [
        (k % columns * (LENGTH_M + ALLEY_M), k // columns * (WIDTH_M + TRACK_M)) for k in range(count)
    ]  # fmt: skip
    parcels = [
        Parcel(
            str(k),
            shapely.box(x, y, x + LENGTH_M, y + WIDTH_M),
            shapely.box(x + 1.0, y + 0.11, x + LENGTH_M - 1.0, y + WIDTH_M - 0.11),
        )
        for k, (x, y) in enumerate(corners)
    ]
    rng = np.random.default_rng(1)
    with ParcelPoints(parcels[:1], None) as points:  # compiles
        points.add(_batch(rng, -1.0, -1.0, LENGTH_M + 1.0, WIDTH_M + 1.0, 20_000))
        list(measure_parcels(points, site_soil(points).soil.under, 0.012))
    east, north = max(x for x, _ in corners) + LENGTH_M, max(y for _, y in corners) + WIDTH_M
    total = int(DENSITY_M2 * (east + 2.0) * (north + 2.0))
    before, sorting, done = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, 0.0, 0
    with ParcelPoints(parcels, None) as points:
        while done < total:
            # a flight goes from south to north
            south, some = -1.0 + (north + 2.0) * done / total, min(BATCH, total - done)
            batch = _batch(rng, -1.0, south, east + 1.0, south + (north + 2.0) * some / total, some)
            done += some
            begin = process_time()
            points.add(batch)
            sorting += process_time() - begin
        begin = process_time()
        soil = site_soil(points)
        found = process_time()
        heights = [row.figures.mean_height_m for row, _ in measure_parcels(points, soil.soil.under, soil.noise_m)]
        end = process_time()
    whole = sorting + end - begin
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    print(
        f"{count} parcels, {total:,} points: {whole:.1f} s ({total / whole / 1e6:.1f} M points/s): "
        f"sorting {sorting:.1f} s ({total / sorting / 1e6:.1f} M points/s), soil {found - begin:.1f} s, "
        f"heights {end - found:.1f} s; memory + {grown:.0f} MB; mean height {np.mean(heights):.4f} m (0.5 m)"
    )


def _batch(rng: np.random.Generator, west: float, south: float, east: float, north: float, count: int) -> np.ndarray:
    """Points of a crop of 0.5 m on parcels that repeat, and of bare soil between them."""
    xy = rng.uniform((west, south), (east, north), (count, 2))
    column, row = xy[:, 0] % (LENGTH_M + ALLEY_M), xy[:, 1] % (WIDTH_M + TRACK_M)
    height = 50.0 + 0.01 * rng.standard_normal(count)
    crop = (column < LENGTH_M) & (row < WIDTH_M)
    height[crop] += np.maximum(0.5 - 0.07 * rng.weibull(1.3, int(crop.sum())), 0.0)
    return np.column_stack([xy, height])


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
