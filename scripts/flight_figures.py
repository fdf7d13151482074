"""Draws the figure of docs/explanation/inertial.md from the sample flight.

flight_figures.py FLIGHT [FOLDER]       FLIGHT holds session.toml; the pictures go to docs/images by default
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from furrowmap.process import prepare_process

prepare_process()

from matplotlib import pyplot as plt  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from furrowmap.core.session.opened import open_session  # noqa: E402
from furrowmap.core.strips.boresight import boresight  # noqa: E402
from furrowmap.core.strips.strips import strip_returns  # noqa: E402
from furrowmap.core.trajectory.located import locate  # noqa: E402

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
ALONG_M = (-16.0, 12.0)
WIDE_M = 0.15


def draw(flight: Path, folder: Path) -> None:
    """A section through crop and soil with the stated mounting and with the estimated one."""
    opened = open_session(flight / "session.toml")
    located = locate(opened.positions(), opened.session, opened.frame, opened.inertial)
    lidar = opened.lidar(float(np.mean(located.trajectory.span_s)))
    returns = strip_returns(lidar.scans(), located.trajectory)
    stated = opened.session.lidar.mounting
    found = boresight(returns, located.trajectory, stated)
    assert found is not None
    figure, axes = plt.subplots(2, 1, figsize=(9, 5), sharex=True, sharey=True, layout="constrained")
    turned = Rotation.from_quat(returns.rotation, scalar_first=True)
    points = None
    for axis, mounting, title in (
        (axes[0], stated, "as the session states the mounting"),
        (axes[1], found.mounting, "with the estimated boresight"),
    ):
        xyz = returns.origin_m + turned.apply(returns.sensor_m @ mounting.rotation.T + np.asarray(stated.xyz_m))
        inside = (np.abs(xyz[:, 1]) < WIDE_M) & (xyz[:, 0] > ALONG_M[0]) & (xyz[:, 0] < ALONG_M[1])
        x, z = xyz[inside, 0], xyz[inside, 2]
        points = axis.scatter(x, z - np.median(z), 2, returns.t_s[inside] - returns.t_s[0], cmap="viridis", lw=0)
        axis.set(title=title, ylabel="height (m)")
    axes[1].set(xlabel="easting (m)", ylim=(-0.6, 0.4))
    figure.colorbar(points, ax=axes, label="time of the return (s)")
    figure.savefig(folder / "boresight.png", dpi=110)


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else IMAGES)
