"""Draws the figure of docs/explanation/ground-and-terrain.md from a sample recording beside the checkout."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import laspy
import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import furrowmap
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.terrain import find_depressions, hillshade
from furrowmap.core.values.scan import PointClass
from furrowmap.exporters.files.result_folder import CLOUD

CHECKOUT = Path(__file__).resolve().parents[1]
SAMPLE = CHECKOUT.parent / "shared" / "data" / "tractor_loop"
IMAGE = CHECKOUT / "docs" / "images" / "point-classes.png"
COLOURS: Final = {
    PointClass.GROUND: "#8c6239",
    PointClass.OTHER: "#4b8f4b",
    PointClass.NOISE: "#d62728",
    PointClass.VEHICLE: "#555555",
    PointClass.IMPLEMENT: "#1f77b4",
}
PASS: Final = 2
SECONDS: Final = 0.6
LANE_DEG: Final = 81.0
SPOT_DEPTH_M: Final = 0.03
SPOT_AREA_M2: Final = 0.25


def draw() -> None:
    """The points of a moment from the side, by class; and the low spots of the ground as it was left."""
    with TemporaryDirectory() as folder:
        furrowmap.run(SAMPLE / "session.toml", Path(folder) / "result")
        cloud = laspy.read(Path(folder) / "result" / CLOUD)
    figure, (side, map_) = plt.subplots(2, 1, figsize=(9.0, 8.0), height_ratios=(1.0, 1.9), layout="constrained")
    _side_view(side, cloud)
    _low_spots(map_)
    figure.savefig(IMAGE, dpi=110)


def _side_view(axes: Axes, cloud: laspy.LasData) -> None:
    t_s, classes = np.asarray(cloud.gps_time), np.asarray(cloud.classification)
    middle_s = np.median(t_s[np.asarray(cloud.point_source_id) == PASS])
    then = np.abs(t_s - middle_s) < 0.5 * SECONDS
    xyz, kind = np.asarray(cloud.xyz)[then], classes[then]
    middle = np.median(xyz[kind == PointClass.IMPLEMENT], axis=0)
    heading = np.radians(LANE_DEG)
    lane = np.array([[np.sin(heading), np.cos(heading)], [np.cos(heading), -np.sin(heading)]])
    along, across = lane @ (xyz[:, :2] - middle[:2]).T
    near = (np.abs(along) < 8.0) & (np.abs(across) < 6.0)
    floor = np.median(xyz[near & (kind == PointClass.GROUND), 2])
    for number, colour in COLOURS.items():
        of = near & (kind == number)
        label = f"{number.name.lower()} ({number.value})"
        axes.scatter(along[of], xyz[of, 2] - floor, s=1.5, c=colour, linewidths=0, label=label)
    title = f"{SECONDS} s of a pass, 12 m across, seen from the side"
    axes.set(xlabel="along the lane, m", ylabel="height, m", ylim=(-0.4, 3.4), title=title)
    axes.legend(loc="upper right", markerscale=5.0, fontsize=8)


def _low_spots(axes: Axes) -> None:
    with np.load(SAMPLE / "truth" / "surface.npz") as truth:
        height: NDArray[np.float64] = truth["after"][::-1].astype(np.float64)
        cell_m, e0_m, n0_m = (float(truth[name]) for name in ("cell_m", "e0", "n0"))
    grid = Grid(cell_m, round(e0_m / cell_m), round(n0_m / cell_m) + height.shape[0], height.shape)
    water = find_depressions(height, grid, SPOT_DEPTH_M, SPOT_AREA_M2)
    extent = (0.0, height.shape[1] * cell_m, 0.0, height.shape[0] * cell_m)
    axes.imshow(hillshade(height, cell_m), cmap="gray", extent=extent)
    depth = np.ma.masked_less_equal(np.ma.masked_invalid(100.0 * water.depth_m), 0.0)
    shown = axes.imshow(depth, cmap="winter_r", extent=extent, vmin=0.0)
    axes.figure.colorbar(shown, ax=axes, label="water, cm", shrink=0.8)
    axes.set(
        xlabel="east, m",
        ylabel="north, m",
        title=f"{len(water)} low spots of {SPOT_AREA_M2} m² and more hold {1000 * water.volume_m3.sum():.0f} litres",
    )


if __name__ == "__main__":
    draw()
