"""Values of several arrays: each has its shape, times increase, and anything else is refused by its name."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from furrowmap.core.session.session_file import parse_toml
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import AttitudeTrack, MountMotion, PoseTrack
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import ScanPoses, Trajectory

N = 4
T_S = np.arange(float(N))
ONE, TURN = np.ones(N), np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
THREE, SIX = np.ones((N, 3)), np.ones((N, 6))
BYTES, WORDS = np.ones(N, np.int8), np.full(N, "gnss")
FROM = (WORDS, WORDS, WORDS, WORDS)

VALUES: list[Any] = [
    AttitudeTrack(T_S, ONE, ONE, ONE),
    GnssTrack.build(T_S, lon_deg=ONE),
    InertialTrack(T_S, THREE, THREE),
    MountMotion(T_S, TURN),
    PoseTrack(T_S, THREE, True, ONE, ONE, ONE, True, SIX),
    Scan(0, T_S, THREE.astype(np.float32), *[ONE.astype(np.uint8)] * 5),
    ScanPoses(np.arange(N), T_S, THREE, TURN, ONE, BYTES, BYTES, SIX, *FROM, np.arange(N)),
    ToolStates(T_S, T_S + 1.0, BYTES, ONE, ONE, ONE),
    Trajectory(T_S, THREE, TURN, ONE, BYTES, BYTES, SIX, *FROM, 1.0),
]
ARRAYS = [
    (value, field.name)
    for value in VALUES
    for field in fields(value)
    if isinstance(getattr(value, field.name), np.ndarray)
]
LENGTHS_ALONE = {f"Scan.{name}" for name in ("t_s", "intensity", "laser", "column", "return_number", "returns")}
"""There are many scans: only lengths are compared."""
IDS = [f"{type(value).__name__}.{name}" for value, name in ARRAYS]


def shorter(array: Any) -> Any:
    return array[:-1]


def longer(array: Any) -> Any:
    return np.concatenate([array, array[-1:]])


def wider(array: Any) -> Any:
    return np.concatenate([array.reshape(N, -1), array.reshape(N, -1)], axis=1)


@pytest.mark.parametrize("change", [shorter, longer, wider])
@pytest.mark.parametrize(("value", "name"), ARRAYS, ids=IDS)
def test_array__of_another_shape_is_refused(value: Any, name: str, change: Callable[[Any], Any]) -> None:
    if change is wider and f"{type(value).__name__}.{name}" in LENGTHS_ALONE:
        return
    with pytest.raises(ValueError, match=rf"^{type(value).__name__}"):
        replace(value, **{name: change(getattr(value, name))})


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_times__increase(value: Any) -> None:
    if isinstance(value, Scan):
        return  # dual returns of a firing have one time
    name = {"ScanPoses": "scan", "ToolStates": "begin_s"}.get(type(value).__name__, "t_s")
    times = getattr(value, name)
    backward = times.copy()
    backward[2] = 0
    same = times.copy()
    same[2] = times[1]
    for wrong in (backward, same):
        with pytest.raises(ValueError, match=f"{name} does not increase|not in the order of time"):
            replace(value, **{name: wrong})


def test_quaternions__of_a_trajectory_have_the_length_one() -> None:
    trajectory = VALUES[-1]
    for factor, right in ((1.0 + 1e-7, True), (-1.0, True), (1.001, False), (0.0, False), (np.nan, False)):
        if right:
            assert len(replace(trajectory, quaternion=factor * TURN)) == N
        else:
            with pytest.raises(ValueError, match="must hold unit quaternions"):
                replace(trajectory, quaternion=factor * TURN)


@pytest.mark.parametrize("name", ["t_s", "xyz_m", "quaternion"])
def test_poses_of_scans__are_known(name: str) -> None:
    (poses,) = (value for value in VALUES if isinstance(value, ScanPoses))
    array = getattr(poses, name).copy()
    array[1] = np.nan
    with pytest.raises(ValueError, match=f"ScanPoses.{name} is not finite"):
        replace(poses, **{name: array})


@pytest.mark.parametrize(
    "inner", [Grid(0.5, 1, 5, (2, 2)), Grid(0.5, -1, 4, (2, 2)), Grid(0.5, 3, 4, (2, 2)), Grid(0.5, 1, 3, (4, 2)),
              Grid(0.25, 1, 3, (2, 2))]
)  # fmt: skip
def test_grid__that_is_not_within_another_has_no_window_in_it(inner: Grid) -> None:
    outer = Grid(0.5, 0, 4, (4, 4))
    assert Grid(0.5, 1, 3, (3, 2)).window_in(outer) == (slice(1, 4), slice(1, 3))
    assert outer.window_in(outer) == (slice(0, 4), slice(0, 4))
    with pytest.raises(ValueError, match="does not lie in"):
        inner.window_in(outer)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"a = {1 << 63}", "an integer has more than 64 bits"),
        (f"a = [1, {{ b = -{(1 << 63) + 1} }}]", "an integer has more than 64 bits"),
        ("a = " + "9" * 5000, "a number has too many digits"),
        ("a = " + "[" * 100_000, "it is nested too deeply|Invalid"),
        ("a = ", "Invalid value"),
    ],
)
def test_toml__whose_numbers_or_nesting_are_none(text: str, words: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError, match=words):
        parse_toml(text)


def test_toml__integers_of_64_bits_are_read() -> None:
    assert parse_toml(f"a = [{(1 << 63) - 1}, {-(1 << 63)}, {{ b = 1.5 }}]") == {
        "a": [(1 << 63) - 1, -(1 << 63), {"b": 1.5}]
    }
