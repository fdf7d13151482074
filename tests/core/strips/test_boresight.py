"""A scanner flown over rolling ground: mounting, place and clock are found from the ground alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.strips.boresight import BORESIGHT_NAMES, Boresight, boresight, boresight_notices
from furrowmap.core.strips.strips import strip_returns
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

FloatArray = NDArray[np.float64]
T0 = 1_779_529_272.0
LINE_S = 6.0
SPEED_MPS = 3.0
HEIGHT_M = 8.0
SIGMA_DEG = 0.002


def ground(x: FloatArray, y: FloatArray) -> FloatArray:
    """Rolling: waves of 5 to 11 m, up to 15 cm high."""
    return 0.15 * np.sin(x / 1.1 + 0.4 * y) + 0.1 * np.sin(y / 0.8 - 0.3 * x) + 0.15 * np.cos(0.6 * (x + y))


@cache
def flown() -> Trajectory:
    """Lines east, west, north and south over one another, each turned about on the spot, in gusts."""
    t = np.arange(0.0, 4 * LINE_S, 0.005)
    line, within = (t // LINE_S).astype(int), t % LINE_S * SPEED_MPS - 0.5 * LINE_S * SPEED_MPS
    heading = np.array([90.0, 270.0, 0.0, 180.0])[line]
    offset = np.array([-2.0, 2.0, -2.0, 2.0])[line]
    east, north = np.sin(np.radians(heading)), np.cos(np.radians(heading))
    xy = np.column_stack([within * east + offset * north, within * north + offset * east])
    roll = 3.0 * np.sin(4.0 * t) + 2.0 * np.sin(7.1 * t + 1.0)
    pitch = 2.0 * np.sin(5.0 * t + 2.0) + 2.0 * np.sin(2.3 * t)
    xyz = np.column_stack([xy, HEIGHT_M + 0.3 * np.sin(0.9 * t)])
    made = trajectory_from_attitude(T0 + t, xyz, roll, pitch, heading + 2.0 * np.sin(1.7 * t), max_gap_s=0.1)
    made.sigma[:] = (0.005, 0.005, 0.005, SIGMA_DEG, SIGMA_DEG, SIGMA_DEG)
    return made


def measured(mounting: Mounting, seed: int, returns: int, trajectory: Trajectory) -> tuple[FloatArray, ...]:
    """Times, lasers and places in the scanner's frame."""
    random = np.random.default_rng(seed)
    t = np.sort(random.uniform(T0 + 0.05, T0 + 4 * LINE_S - 0.05, returns))
    laser = random.integers(0, 16, returns)
    below = -mounting.rotation[2]
    up = np.radians(2.0 * laser - 15.0)
    around = np.arctan2(-below[1], below[0]) + np.radians(random.uniform(-45.0, 45.0, returns))
    beam = np.column_stack([np.cos(up) * np.cos(around), -np.cos(up) * np.sin(around), np.sin(up)])
    poses = trajectory.at(t)
    turned = Rotation.from_quat(poses.quaternion, scalar_first=True)
    place = poses.xyz_m + turned.apply(mounting.xyz_m)
    way = turned.apply(beam @ mounting.rotation.T)
    reach = -place[:, 2] / way[:, 2]
    for _ in range(20):
        at = place + reach[:, None] * way
        reach = reach + 0.7 * (ground(at[:, 0], at[:, 1]) - at[:, 2]) / way[:, 2]
    xyz = beam * (reach + random.normal(0.0, 0.01, len(reach)))[:, None]
    return t, laser, xyz


@cache
def measured_when_flown(mounting: Mounting, seed: int, returns: int) -> tuple[FloatArray, ...]:
    """The same on the flight of most tests."""
    return measured(mounting, seed, returns, flown())


@dataclass(frozen=True)
class Scene:
    """What is true: the mounting, and how far the scanner's clock is behind."""

    mounting: Mounting
    behind_s: float = 0.0
    seed: int = 0

    def scans(self, trajectory: Trajectory, returns: int = 300_000) -> Iterator[Scan]:
        """Scans of a tenth of a second, with 10 mm of range noise."""
        if trajectory is flown():
            t, laser, xyz = measured_when_flown(self.mounting, self.seed, returns)
        else:
            t, laser, xyz = measured(self.mounting, self.seed, returns, trajectory)
        for number, part in enumerate(np.array_split(np.arange(len(t)), 400)):
            one = np.ones(len(part), np.uint8)
            stamped = t[part] - self.behind_s
            yield Scan(
                number, stamped, xyz[part].astype(np.float32), one, laser[part].astype(np.uint8),
                np.zeros(len(part), np.uint16), one, one,
            )  # fmt: skip

    def found(self, stated: Mounting) -> Boresight:
        trajectory = flown()
        found = boresight(strip_returns(self.scans(trajectory), trajectory), trajectory, stated)
        assert found is not None
        return found

    def off_deg(self, found: Boresight) -> FloatArray:
        off: FloatArray = np.degrees(
            Rotation.from_matrix(found.mounting.rotation @ self.mounting.rotation.T).as_rotvec()
        )
        return off


@pytest.mark.parametrize("rpy_deg", [(-90.0, 34.0, -90.0), (180.0, 90.0, 90.0)])
def test_angles__are_found_within_their_sigma_from_degrees_away(rpy_deg: tuple[float, float, float]) -> None:
    """Spin axis forward, and to the side and turned over: the drawing is 3 to 4° off."""
    stated = Mounting((0.1, 0.02, -0.3), rpy_deg)
    turned = Rotation.from_euler("ZYX", [4.0, -3.0, 3.0], degrees=True).as_matrix()
    scene = Scene(Mounting.from_rotation(stated.xyz_m, turned @ stated.rotation))
    found = scene.found(stated)
    off = np.abs(scene.off_deg(found))
    assert found.certain
    assert (off < (0.02, 0.02, 0.05)).all()
    assert (off < 3.0 * np.array(found.sigma_deg)).all()
    assert found.mounting.xyz_m == stated.xyz_m
    assert found.clock_used_s == 0.0
    assert found.scatter_m[1] < 0.2 * found.scatter_m[0]
    assert [notice.code for notice in boresight_notices(found, stated)] == ["boresight-off"]


def test_place_and_clock__are_corrected_where_they_are_certainly_off() -> None:
    stated = Mounting((0.0, 0.0, -0.3), (-90.0, 34.0, -90.0))
    scene = Scene(Mounting((0.09, -0.07, -0.3), (-89.6, 34.4, -89.3)), behind_s=0.008, seed=3)
    found = scene.found(stated)
    assert (np.abs(scene.off_deg(found)) < (0.02, 0.02, 0.05)).all()
    assert found.clock_used_s == pytest.approx(0.008, abs=0.0003)
    np.testing.assert_allclose(found.mounting.xyz_m, scene.mounting.xyz_m, atol=0.008)
    together = dict(
        zip(BORESIGHT_NAMES, zip(found.free.value.tolist(), found.free.sigma.tolist(), strict=True), strict=True)
    )
    for name, true in (("time_s", 0.008), ("x_m", 0.09), ("y_m", -0.07), ("z_m", 0.0)):
        value, sigma = together[name]
        assert abs(value - true) < 3.5 * sigma
    # Level ground from above shows nothing of the height of the scanner: it stays as stated.
    assert found.mounting.xyz_m[2] == stated.xyz_m[2]
    assert together["z_m"][1] > 3.0 * together["x_m"][1]
    np.testing.assert_allclose(np.diag(found.free.correlation), 1.0)
    codes = {notice.code for notice in boresight_notices(found, stated)}
    assert codes == {"boresight-off", "lever-arm-off", "scanner-clock-off"}


def test_one_line__shows_no_mounting() -> None:
    trajectory = flown()
    scene = Scene(Mounting((0.0, 0.0, -0.3), (-90.0, 34.0, -90.0)))
    scans = [scan for scan in scene.scans(trajectory) if scan.t_s[-1] < T0 + 1.0]
    found = boresight(strip_returns(scans, trajectory), trajectory, Mounting((0.0, 0.0, -0.3), (-90.0, 33.0, -90.0)))
    assert found is None or not found.certain
    assert [notice.code for notice in boresight_notices(found, Mounting())] == ["boresight-assumed"]
