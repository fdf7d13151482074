"""Which model a scanner is of, by level ground as lasers of known elevations see it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.matching.laser_elevations import other_model
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan

ELEVATIONS_DEG = {
    "VLP-16": np.arange(-15.0, 16.0, 2.0),
    "Puck Hi-Res": np.linspace(-10.0, 10.0, 16),
    "VLP-32C": np.sort([-25.0, -15.6, -11.3, -8.8, -7.3, *np.arange(-6.3, 3.0, 0.4), 4.7, 7.0, 10.3, 15.0])[:32],
    "HDL-32E": np.linspace(-30.67, 10.67, 32),
    "OS1": np.linspace(22.5, -22.5, 32)[::-1],
    "OS0": np.linspace(45.0, -45.0, 32)[::-1],
}
PAIRS = [
    (true, read_as)
    for group in (("VLP-16", "Puck Hi-Res"), ("VLP-32C", "HDL-32E"), ("OS1", "OS0"))
    for true, read_as in (group, group[::-1])
]
MOUNTINGS = [
    Mounting((-0.6, 0.0, 2.4), (0.8, 40.6, 179.3)),
    Mounting((1.2, 0.0, 1.9), (0.0, 25.0, 0.0)),
    Mounting((0.0, 0.0, 1.6), (0.0, 0.0, 0.0)),
]


def scan(true: str, read_as: str, mounting: Mounting, tilt_deg: float = 0.0, relief_m: float = 0.02) -> Scan:
    """A turn over rough ground, tilted against the vehicle, decoded with elevations of another model."""
    rng = np.random.default_rng(1)
    laser, turn = np.meshgrid(np.arange(len(ELEVATIONS_DEG[true])), np.radians(np.arange(0.0, 360.0, 0.4)))
    laser = laser.ravel()
    turn = turn.ravel()

    def directions(model: str) -> FloatArray:
        up = np.radians(ELEVATIONS_DEG[model])[laser]
        return np.column_stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])

    normal = Rotation.from_euler("x", tilt_deg, degrees=True).apply([0.0, 0.0, 1.0])
    seen = directions(true) @ mounting.rotation.T
    slant = seen @ normal
    height_m = float(np.asarray(mounting.xyz_m) @ normal)
    with np.errstate(divide="ignore"):
        away_m = np.where(slant < 0.0, (rng.normal(0.0, relief_m, len(slant)) - height_m) / slant, np.inf)
    hit = (away_m > 1.0) & (away_m < 40.0)
    places = (away_m[hit][:, None] * directions(read_as)[hit]).astype(np.float32)
    n = len(places)
    zeros = np.zeros(n, np.uint8)
    return Scan(
        0, np.linspace(0.0, 0.1, n), places, zeros, laser[hit].astype(np.uint8), np.zeros(n, np.uint16), zeros, zeros
    )


def tables(read_as: str) -> dict[str, FloatArray]:
    many = len(ELEVATIONS_DEG[read_as])
    others = {name: table for name, table in ELEVATIONS_DEG.items() if len(table) == many and name != read_as}
    return {read_as: ELEVATIONS_DEG[read_as], **others}


@pytest.mark.parametrize("mounting", MOUNTINGS, ids=["behind", "ahead", "upright"])
@pytest.mark.parametrize(("true", "read_as"), PAIRS)
@pytest.mark.parametrize("relief_m", [0.02, 0.06])
def test_scanner__read_as_another_model_is_known_by_its_ground(
    true: str, read_as: str, mounting: Mounting, relief_m: float
) -> None:
    """Closer elevations make rough ground more even than it is."""
    found = other_model([scan(true, read_as, mounting, relief_m=relief_m)], mounting, tables(read_as))
    assert found is not None
    assert (found.name, found.read_as) == (true, read_as)
    assert other_model([scan(true, true, mounting, relief_m=relief_m)], mounting, tables(true)) is None


@pytest.mark.parametrize("mounting", MOUNTINGS, ids=["behind", "ahead", "upright"])
@pytest.mark.parametrize("tilt_deg", [-9.0, 6.0])
def test_ground__that_slopes_is_no_other_model(mounting: Mounting, tilt_deg: float) -> None:
    """As of a plough whose wheels run in the furrow."""
    assert other_model([scan("VLP-16", "VLP-16", mounting, tilt_deg)], mounting, tables("VLP-16")) is None


@pytest.mark.parametrize("off", [(0.0, 11.0, 0.0), (0.0, -11.0, 0.0), (6.0, 0.0, 0.0), (0.0, 0.0, 90.0)])
@pytest.mark.parametrize("up_m", [0.0, 0.3, -0.3])
def test_wrong_mounting__is_no_other_model(off: tuple[float, float, float], up_m: float) -> None:
    true = MOUNTINGS[0]
    roll, pitch, yaw = np.add(true.rpy_deg, off).tolist()
    x, y, z = true.xyz_m
    stated = Mounting((x, y, z + up_m), (roll, pitch, yaw))
    assert other_model([scan("VLP-16", "VLP-16", true)], stated, tables("VLP-16")) is None


def test_model__whose_packets_are_like_no_others_is_taken_as_it_is() -> None:
    mounting = MOUNTINGS[0]
    only = {"VLP-16": ELEVATIONS_DEG["VLP-16"]}
    assert other_model([scan("Puck Hi-Res", "VLP-16", mounting)], mounting, only) is None
    assert other_model([], mounting, tables("VLP-16")) is None
