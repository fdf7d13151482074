"""Draws the figures of docs/explanation from the sample recordings beside the checkout."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import geopandas as gpd
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from shapely import affinity

from furrowmap.core.coverage.worked_ground import worked_ground
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.implement.heights import ToolHeightTracker
from furrowmap.core.implement.learning import learn_implement
from furrowmap.core.implement.near_scans import NearScans
from furrowmap.core.implement.seen_implement import Hint
from furrowmap.core.implement.states import tool_history
from furrowmap.core.readers.reader import GivesPoses, GivesScans, GivesTrack, ReadOptions, open_recording
from furrowmap.core.session.session_file import load_session
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.vehicle_motion import local_velocity
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion

CHECKOUT = Path(__file__).resolve().parents[1]
DATA = CHECKOUT.parent / "shared" / "data"
IMAGES = CHECKOUT / "docs" / "images"


def initial_heading(name: str, picture: Path) -> None:
    """Errors of the course of the antenna and of the heading of the axle over time."""
    session = load_session(DATA / name / "session.toml")
    assert session.antenna is not None
    reader = open_recording([DATA / name / "gnss.nmea"], ReadOptions())
    assert isinstance(reader, GivesTrack)
    track, frame = reader.track(), map_frame(session.crs)
    found = trajectory_from_gnss(track, frame, session.antenna.xyz_m, None)
    t_s = found.trajectory.t_s
    truth = np.genfromtxt(DATA / name / "truth" / "trajectory.csv", delimiter=",", names=True)
    heading = np.degrees(np.unwrap(np.radians(truth["heading_deg"])))

    def error(at_s: NDArray[np.float64], heading_deg: NDArray[np.float64]) -> NDArray[np.float64]:
        return wrap_deg(heading_deg - np.interp(at_s, truth["time_unix_s"], heading))

    e, n = frame.project(track.lon_deg, track.lat_deg)
    segment = np.cumsum(np.diff(track.t_s, prepend=track.t_s[:1]) > 1.0, dtype=np.intp)
    velocity = local_velocity(track.t_s, np.column_stack([e, n]), segment, 0.5)
    course = 90.0 - np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))
    moving = np.hypot(*velocity.T) > 0.1

    begin = truth["time_unix_s"][0]
    figure, axes = plt.subplots(figsize=(9, 3.4), layout="constrained")
    colours = {Motion.FORWARD: "#f4f1e8", Motion.STANDING: "#ffffff", Motion.REVERSE: "#f3d9c4"}
    for i in range(len(t_s) - 1):
        colour = colours[Motion(int(found.trajectory.motion[i]))]
        axes.axvspan(t_s[i] - begin, t_s[i + 1] - begin, color=colour, lw=0)
    axes.plot(
        track.t_s[moving] - begin, error(track.t_s, course)[moving], ".", ms=2.5, c="#9a9a9a", label="antenna's course"
    )
    off = error(t_s, found.trajectory.attitude_deg()[2])
    sigma = found.trajectory.sigma[:, 5]
    gap = np.flatnonzero(np.diff(t_s) > found.trajectory.max_gap_s) + 1
    t_s, off, sigma = (np.insert(values, gap, np.nan) for values in (t_s, off, sigma))
    axes.fill_between(t_s - begin, -2 * sigma, 2 * sigma, color="#3f6b4e", alpha=0.25, lw=0, label="± 2 sigma")
    axes.plot(t_s - begin, off, c="#2c4a34", lw=1.4, label="axle's heading")
    axes.set(xlabel="time, s", ylabel="error of heading, °", ylim=(-40, 40), xlim=(0, t_s[-1] - begin))
    axes.legend(loc="upper right", ncols=3, frameon=False, fontsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.savefig(picture, dpi=110)


def worked_ground_map(name: str, picture: Path) -> None:
    """The worked ground from the true trajectory and tool states, with overlaps, misses and zones."""
    session = load_session(DATA / name / "session.toml")
    assert session.implement is not None
    frame = map_frame(session.crs)
    reader = open_recording([DATA / name / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(reader, GivesPoses)
    trajectory = trajectory_from_poses(reader.poses(), frame)
    tool = pd.read_csv(DATA / name / "truth" / "implement.csv")
    t_s, down = tool.time_unix_s.to_numpy(), (tool.state == "down").to_numpy()
    change = 1 + np.flatnonzero(np.diff(down))
    cuts = np.concatenate([t_s[:1], t_s[change], t_s[-1:]])
    state = np.concatenate([down[:1], down[change]]).astype(np.int8)
    zero = np.zeros(len(state))
    states = ToolStates(cuts[:-1], cuts[1:], state, zero + 1.0, zero, zero)
    ground = worked_ground(trajectory, states, session.implement, frame)

    figure, axes = plt.subplots(figsize=(9, 4.6), layout="constrained")
    headland = [place.ground for place in ground.zones if place.kind == "headland"]
    overlaps, misses = [place.ground for place in ground.overlaps], [place.ground for place in ground.misses]
    layers = [
        (headland, "#e9dcc3", "none", "headland"),
        ([one.ground for one in ground.passes], "#8fb08a", "#2c4a34", "passes"),
        (overlaps, "#d1603d", "none", "overlaps"),
        (misses, "#7a4fa3", "none", "missed"),
    ]
    e0, n0 = trajectory.xyz_m[:, :2].min(axis=0)
    for shapes, face, edge, label in layers:
        local = [affinity.translate(shape, -e0, -n0) for shape in shapes]
        gpd.GeoSeries(local).plot(ax=axes, facecolor=face, edgecolor=edge, linewidth=0.8)
        axes.plot([], [], "s", c=face, label=label)
    axes.plot(*(trajectory.xyz_m[:, :2] - [e0, n0]).T, c="#555555", lw=0.7, label="rear axle")
    axes.set(xlabel="m east", ylabel="m north", aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.savefig(picture, dpi=110)


def implement(name: str, depth_picture: Path, height_picture: Path) -> None:
    """Range images of the implement up and down, its side view, and its height over time."""
    session = load_session(DATA / name / "session.toml")
    assert session.implement is not None
    truth = np.genfromtxt(
        DATA / name / "truth" / "implement.csv", delimiter=",", names=True, dtype=None, encoding="ascii"
    )
    true_s, true_m = truth["time_unix_s"], truth["tool_height_m"]
    reader = open_recording([DATA / name / "recording.pcap.gz"], ReadOptions(near_s=float(true_s.mean())))
    assert isinstance(reader, GivesScans)
    scans = list(reader.scans())
    mounting, depth_m = session.lidar.mounting, session.implement.working_depth_m
    near = NearScans(mounting)
    for scan in scans:
        near.add(scan)
    found = learn_implement(near.scans, Hint(session.implement.xy_m, session.implement.width_m)).implement
    assert found is not None
    watch = ToolHeightTracker(mounting, found, depth_m)
    for scan in scans:
        watch.add(scan)
    history = tool_history(watch.heights(), found, depth_m)

    figure, axes = plt.subplots(1, 3, figsize=(9, 2.6), layout="constrained", width_ratios=[2, 2, 1.3])
    images = found.images
    extent = (images.azimuth_deg[0], images.azimuth_deg[-1], -0.5, len(images.up_m) - 0.5)
    for side, image, word in zip(axes, (images.up_m, images.down_m), ("up", "down"), strict=False):
        shown = side.imshow(image, origin="lower", aspect="auto", extent=extent, cmap="YlGn_r", vmin=1.0, vmax=6.0)
        side.contour(
            images.azimuth_deg, np.arange(len(image)), images.implement, [0.5], colors="#a03c1e", linewidths=0.8
        )
        side.set(title=word, xlabel="azimuth, °", ylabel="laser")
    figure.colorbar(shown, ax=axes[1], label="range, m")
    grid = found.template.grid
    x, z = grid.x_m + 0.1 * np.arange(grid.columns), grid.z_m + 0.02 * np.arange(grid.rows) + found.working_m
    axes[2].pcolormesh(x, z, found.template.gain.T, cmap="Greens", shading="nearest")
    axes[2].set(title="side view", xlabel="x, m", ylabel="height above ground, m", ylim=(0.1, 1.4))
    figure.savefig(depth_picture, dpi=100)

    begin = float(true_s[0])
    figure, axis = plt.subplots(figsize=(9, 2.8), layout="constrained")
    states = history.states
    for k in range(len(states)):
        colour = "#f3d9c4" if states.state[k] == ToolState.DOWN else "#ffffff"
        axis.axvspan(states.begin_s[k] - begin, states.end_s[k] - begin, color=colour, lw=0)
    axis.axhline(history.threshold_m, c="#9a9a9a", lw=0.8, ls="--")
    axis.plot(true_s - begin, true_m, c="#9a9a9a", lw=3.0, label="truth")
    axis.plot(history.t_s - begin, history.tool_height_m, c="#2c4a34", lw=1.0, label="found")
    axis.set(xlabel="time, s", ylabel="tool above working position, m", xlim=(0, true_s[-1] - begin))
    axis.legend(loc="upper right", ncols=2, frameon=False, fontsize=8)
    for edge in ("top", "right"):
        axis.spines[edge].set_visible(False)
    figure.savefig(height_picture, dpi=100)


if __name__ == "__main__":
    initial_heading("tractor_fishtail", IMAGES / "initial-heading.png")
    implement("tractor_loop", IMAGES / "implement-seen.png", IMAGES / "implement-height.png")
    worked_ground_map("tractor_fishtail", IMAGES / "worked-ground.png")
