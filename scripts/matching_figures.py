"""Draws the figures of docs/explanation/scan-matching.md from the sample recordings beside the checkout."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from furrowmap.core.matching.height_grid import TILE_NODES, add_returns, empty_surface, tiles_over
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.matching.session_match import match_session
from furrowmap.core.readers.reader import GivesPoses, ReadOptions, open_recording
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Motion, Trajectory

FloatArray = NDArray[np.float64]

CHECKOUT = Path(__file__).resolve().parents[1]
DATA = CHECKOUT.parent / "shared" / "data"
IMAGES = CHECKOUT / "docs" / "images"
DARK: Final = "#2c4a34"
GREY: Final = "#9a9a9a"
RED: Final = "#b5542e"


@dataclass(frozen=True)
class Sample:
    """A sample recording: its session, the trajectories of GNSS alone and of matching, and the truth."""

    session: Session
    opened: OpenSession
    gnss: Trajectory
    matched: Trajectory
    truth: Trajectory

    def scans(self) -> Iterator[Scan]:
        """The recording's scans, once more."""
        yield from self.opened.lidar(self.truth.span_s[0]).scans()


def sample(name: str) -> Sample:
    """The sample of that name, matched."""
    file = DATA / name / "session.toml"
    opened = open_session(file)
    session, frame = opened.session, opened.frame
    located = locate(opened.positions(), session, frame)
    near_s = float(np.mean(located.trajectory.span_s))
    matched = match_session(located, opened.lidar(near_s), session).matched
    poses = open_recording([DATA / name / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(poses, GivesPoses)
    return Sample(session, opened, located.trajectory, matched.trajectory, trajectory_from_poses(poses.poses(), frame))


def placed(xyz_m: FloatArray, t_s: FloatArray, trajectory: Trajectory) -> FloatArray:
    """Map coordinates of points of the vehicle frame."""
    poses = trajectory.at(t_s)
    return np.asarray(poses.xyz_m + Rotation.from_quat(poses.quaternion, scalar_first=True).apply(xyz_m))


def without_frame(axes: Axes) -> None:
    """The axes with lines on two sides only."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def no_movement(one: Sample, picture: Path) -> None:
    """What two scans a second apart have in common, and what the ground between them says."""
    returns = ground_returns(one.scans(), one.session.lidar.mounting, one.truth)
    unworked = np.abs(returns.xyz_m[:, 1]) > 1.2  # beside the tool
    t, half = np.asarray(returns.t_s[unworked]), np.asarray(returns.half[unworked])
    xyz = np.asarray(returns.xyz_m[unworked], np.float64)
    begin = t[0] + 8.0  # on the first pass
    ahead = placed(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.full(2, begin), one.truth)
    course = (ahead[0] - ahead[1])[:2]
    way = float((one.truth.at(begin + 1.0).xyz_m - one.truth.at(begin).xyz_m)[0, :2] @ course)

    def seen(from_s: float) -> FloatArray:
        mine = (t >= from_s) & (t < from_s + 0.1) & (np.hypot(xyz[:, 0], xyz[:, 1]) < 9.0)
        return xyz[mine]

    first, later = seen(begin), seen(begin + 1.0)
    shifts = np.arange(-0.4, 2.0001, 0.02)
    tree = cKDTree(first)
    apart = [
        float(np.sqrt(np.mean(np.minimum(tree.query(later + np.array([s, 0.0, 0.0]))[0], 0.1) ** 2))) for s in shifts
    ]

    # The ground of all scans but those within a second, and the later scan pushed along its course over it.
    scan = (t >= begin + 1.0) & (t < begin + 1.1) & (half == 0)
    others = (np.abs(t - begin - 1.0) < 6.0) & (half == 1)
    cell_m = 0.1
    origin = np.array([*np.round(ahead[1][:2]), 0.0])
    world = placed(xyz[others], t[others], one.truth) - origin
    surface = empty_surface(tiles_over(world[:, :2], cell_m))
    n = len(world)
    add_returns(surface, world, np.zeros(n, np.int8), np.zeros(n, np.uint8), np.full(n, 255, np.uint8))
    probe = placed(xyz[scan], t[scan], one.truth) - origin

    def off(shift: float) -> float:
        en = probe[:, :2] + (shift - way) * course
        u = en / cell_m
        corner = np.floor(u).astype(int)
        share = u - corner
        total, least = np.zeros(len(en)), np.full(len(en), np.inf)
        for a in (0, 1):
            for b in (0, 1):
                x, y = corner[:, 0] + a, corner[:, 1] + b
                column = (x >> 5) - surface.tiles.west
                row = (y >> 5) - surface.tiles.south
                rows, columns = surface.tiles.number.shape
                inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
                tile = np.where(inside, surface.tiles.number[row.clip(0, rows - 1), column.clip(0, columns - 1)], -1)
                weight = np.where(a, share[:, 0], 1 - share[:, 0]) * np.where(b, share[:, 1], 1 - share[:, 1])
                total += weight * surface.height_m[tile, 0, y & TILE_NODES - 1, x & TILE_NODES - 1]
                known = np.where(tile >= 0, surface.weight[tile, 0, y & TILE_NODES - 1, x & TILE_NODES - 1], 0.0)
                least = np.minimum(least, known)
        residual = (probe[:, 2] - total)[least > 2]
        residual -= np.median(residual)
        return float(np.sqrt(np.mean(np.clip(residual, -0.04, 0.04) ** 2)))

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    left.plot(first[:, 0], first[:, 1], ".", ms=2.5, c=GREY, label="a scan")
    left.plot(later[:, 0], later[:, 1], ".", ms=1.2, c=RED, label=f"a second, {way:.2f} m, later")
    left.set(xlabel="m forward", ylabel="m to the left", aspect="equal", xlim=(-8, 0), ylim=(-6, 6))
    left.legend(loc="lower left", bbox_to_anchor=(-0.3, 1.0), fontsize=8, frameon=False, markerscale=4)
    heights = np.array([off(s) for s in shifts])
    right.plot(shifts, np.array(apart) / max(apart), c=GREY, label="distance to the earlier scan's points")
    right.plot(shifts, heights / heights.max(), c=DARK, label="height above the ground's relief")
    right.axvline(0.0, c=GREY, lw=0.8, ls=":")
    right.axvline(way, c=DARK, lw=0.8, ls=":")
    right.set(xlabel="way between the two scans, m", ylabel="RMS, share of the largest", ylim=(0.6, 1.02))
    right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize=8, frameon=False)
    without_frame(left)
    without_frame(right)
    figure.savefig(picture, dpi=110)


def relief(one: Sample, picture: Path) -> None:
    """The same soil in two independent halves of the scans, and their slopes against each other."""
    returns = ground_returns(one.scans(), one.session.lidar.mounting, one.matched)
    t = np.asarray(returns.t_s)
    early = t < t[0] + 10.0  # the first pass over stubble
    xyz = placed(np.asarray(returns.xyz_m[early], np.float64), t[early], one.matched)
    half = np.asarray(returns.half[early])
    middle = np.round(np.median(xyz, axis=0))
    xyz -= middle
    cell_m = 0.1
    surface = empty_surface(tiles_over(xyz[:, :2], cell_m))
    add_returns(surface, xyz, np.zeros(len(xyz), np.int8), half, np.full(len(xyz), 255, np.uint8))
    side = 40
    index = np.arange(-side // 2, side // 2)
    x, y = np.meshgrid(index, index)
    tile = surface.tiles.number[(y >> 5) - surface.tiles.south, (x >> 5) - surface.tiles.west]
    grids, slopes = [], []
    for h in (0, 1):
        height = surface.height_m[tile, h, y & TILE_NODES - 1, x & TILE_NODES - 1].astype(float)
        known = surface.weight[tile, h, y & TILE_NODES - 1, x & TILE_NODES - 1] > 2
        plane = np.column_stack([np.ones(side * side), x.ravel(), y.ravel()])
        fit = np.linalg.lstsq(plane[known.ravel()], height[known], rcond=None)[0]
        height -= (plane @ fit).reshape(height.shape)
        grids.append(np.where(known, height - uniform_filter(np.where(known, height, 0), 15), np.nan))
        slopes.append(np.concatenate([(np.diff(grids[-1], axis=a) / cell_m).ravel() for a in (0, 1)]))
    both = np.isfinite(slopes[0]) & np.isfinite(slopes[1])
    a, b = slopes[0][both], slopes[1][both]
    share = float(np.mean(a * b) / np.mean(0.5 * (a * a + b * b)))

    figure, axes = plt.subplots(1, 3, figsize=(9, 3.1), layout="constrained", width_ratios=(1, 1, 0.9))
    extent = (index[0] * cell_m, (index[-1] + 1) * cell_m) * 2
    for panel, grid, title in zip(axes[:2], grids, ("even scans", "odd scans"), strict=True):
        image = panel.imshow(1000 * grid, origin="lower", extent=extent, cmap="BrBG_r", vmin=-35, vmax=35)
        panel.set(title=title, xlabel="m")
        panel.title.set_fontsize(9)
    figure.colorbar(image, ax=axes[:2], shrink=0.8, label="mm")
    axes[2].plot(a, b, ".", ms=1.5, c=DARK, alpha=0.5)
    line = np.array([-0.5, 0.5])
    axes[2].plot(line, line, c=GREY, lw=0.8)
    axes[2].set(xlim=line, ylim=line, aspect="equal", xlabel="slope by even scans", ylabel="slope by odd scans")
    axes[2].set_title(f"{share:.0%} of the variance is relief", fontsize=9)
    without_frame(axes[2])
    figure.savefig(picture, dpi=110)


def errors(one: Sample, picture: Path) -> None:
    """Errors of heading, roll and place over time, from GNSS alone and after matching."""
    begin, end = (float(v) for v in one.matched.span_s)
    t = np.arange(begin + 0.1, end - 0.1, 0.05)
    truth = one.truth.at(t)
    figure, axes = plt.subplots(3, 1, figsize=(9, 5.6), sharex=True, layout="constrained")
    limits = (8.0, 2.5, 12.0)
    labels = ("heading, °", "roll, °", "place, cm")
    for trajectory, colour, width, label in (
        (one.gnss, GREY, 1.0, "GNSS alone"),
        (one.matched, DARK, 1.4, "matched"),
    ):
        ours = trajectory.at(t)
        attitude = [wrap_deg(a - b) for a, b in zip(ours.attitude_deg(), truth.attitude_deg(), strict=True)]
        place = 100 * np.hypot(*(ours.xyz_m - truth.xyz_m)[:, :2].T)
        for panel, values in zip(axes, (attitude[2], attitude[0], place), strict=True):
            panel.plot(t - begin, values, c=colour, lw=width, label=label)
    k, share, _ = one.matched.interval(t)
    sigma = one.matched.sigma[k + (share > 0.5)]
    axes[0].fill_between(t - begin, -2 * sigma[:, 5], 2 * sigma[:, 5], color=DARK, alpha=0.2, lw=0, label="± 2 sigma")
    axes[1].fill_between(t - begin, -2 * sigma[:, 3], 2 * sigma[:, 3], color=DARK, alpha=0.2, lw=0)
    axes[2].fill_between(t - begin, 0, 200 * np.hypot(sigma[:, 0], sigma[:, 1]), color=DARK, alpha=0.2, lw=0)
    reverse = one.matched.motion[k + (share > 0.5)] == Motion.REVERSE
    for panel, limit, label in zip(axes, limits, labels, strict=True):
        low = 0.0 if panel is axes[2] else -limit
        panel.fill_between(t - begin, low, limit, where=reverse, color="#f3d9c4", lw=0, zorder=0)
        panel.set(ylabel=label, ylim=(low, limit))
        without_frame(panel)
    axes[2].set(xlabel="time, s", xlim=(0, end - begin))
    axes[0].legend(loc="upper right", ncols=3, frameon=False, fontsize=8)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    loop = sample("tractor_loop")
    no_movement(loop, IMAGES / "matching-no-movement.png")
    relief(loop, IMAGES / "matching-relief.png")
    errors(sample("tractor_fishtail"), IMAGES / "matching-errors.png")
