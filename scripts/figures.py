"""Draws the figures of docs/explanation from the sample recordings beside the checkout."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.reader import GivesTrack, ReadOptions, open_recording
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.trajectory.motion import local_velocity
from furrowmap.core.trajectory.projection import map_frame
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.session import load_session
from furrowmap.core.values.trajectory import Motion

CHECKOUT = Path(__file__).resolve().parents[1]
DATA = CHECKOUT.parent / "shared" / "data"
IMAGES = CHECKOUT / "docs" / "images"


def initial_heading(name: str, picture: Path) -> None:
    """Errors of the antenna's course and of the axle's heading against the truth, over a recording's time."""
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


if __name__ == "__main__":
    initial_heading("tractor_fishtail", IMAGES / "initial-heading.png")
