"""Shaded relief behind a map, against the light on planes in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from furrowmap.exporters.cloud.copc_file import CopcFormat
from furrowmap.exporters.cloud.point_batches import PointBatch
from furrowmap.exporters.cloud.writer import CopcWriter
from furrowmap.exporters.rasters.relief import shaded_ground

WEST_M, SOUTH_M, SIDE_M = 16_600.0, 96_500.0, 20.0
BOX_M = (WEST_M, SOUTH_M, WEST_M + SIDE_M, SOUTH_M + SIDE_M)


def relief_of(folder: Path, xyz_m: np.ndarray, node_points: int = 100_000) -> np.ndarray | None:
    path = folder / "cloud.copc.laz"
    kind = CopcFormat(CRS("EPSG:6677").to_wkt("WKT1_GDAL"), (WEST_M, SOUTH_M, 0.0))
    with CopcWriter(path, kind, node_points=node_points) as writer:
        writer.append(PointBatch(xyz_m, 1.75e9 + np.arange(len(xyz_m)) * 1e-3))
        summary = writer.close()
    return shaded_ground(path, summary.points_by_level, BOX_M)


def places(n: int = 20_000) -> np.ndarray:
    return np.random.default_rng(5).uniform(0.0, SIDE_M, (n, 2))


@pytest.mark.parametrize("rise", [(0.0, 0.0), (-0.2, 0.2), (0.1, -0.05), (0.0, -0.1), (-0.1, 0.0)])
def test_planes__are_lit_from_the_north_west_with_slopes_three_times_as_steep(
    rise: tuple[float, float], tmp_path: Path
) -> None:
    """Light by Lambert's law, at 45°; a tenth of the light of level ground is a tenth of 160 grey values."""
    xy = places()
    relief = relief_of(tmp_path, np.column_stack([xy, 5.0 + xy @ rise]))
    assert relief is not None
    normal = np.array([-3.0 * rise[0], -3.0 * rise[1], 1.0]) / np.hypot(1.0, 3.0 * np.hypot(*rise))
    light = normal @ [-0.5, 0.5, np.sqrt(0.5)]
    wanted = float(np.clip(235.0 + 160.0 * (light - np.sqrt(0.5)), 150.0, 255.0))
    grey = relief[5:-5, 5:-5, 0].astype(np.float64)
    assert np.median(grey) == pytest.approx(wanted, abs=3.0)
    assert (relief[..., 1] == 255).all()


def test_what_stands_on_the_ground_and_what_is_far_from_points_is_not_drawn(tmp_path: Path) -> None:
    xy = places()
    seen = xy[(xy[:, 0] < 10.0) | (xy[:, 1] > 18.0)]  # the south-east is not
    above = np.column_stack([seen[::3], np.full(len(seen[::3]), 2.0)])
    ground = np.column_stack([seen, np.zeros(len(seen))])
    relief = relief_of(tmp_path, np.concatenate([ground, above]))
    assert relief is not None
    rows, columns = relief.shape[:2]
    cell_m = SIDE_M / columns
    assert cell_m == pytest.approx(np.sqrt(6 * SIDE_M**2 / (len(seen) * 4 / 3)), rel=0.05)  # six points a cell
    alpha = relief[..., 1]
    east = (np.arange(columns) + 0.5) * cell_m - 10.0  # metres beyond what was seen
    row = slice(rows // 2, rows)
    assert (alpha[row][:, (east > 0.0) & (east < 2.0 * cell_m)] == 255).all()
    assert (alpha[row][:, east > 5.0 * cell_m] == 0).all()
    drawn = relief[: rows // 2, : columns // 2 - 3, 0].astype(np.float64)
    assert (np.abs(drawn - 234.5) < 1.0).mean() > 0.9


def test_a_box_beside_the_cloud_has_no_relief(tmp_path: Path) -> None:
    xy = places(50) + 5 * SIDE_M
    assert relief_of(tmp_path, np.column_stack([xy, np.zeros(50)])) is None
