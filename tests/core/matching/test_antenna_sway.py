"""The lever arm by the sway of the vehicle, where the antenna is off by a known way and nothing else errs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import KNOT_STEP_S, VEHICLE, State, knots_over
from furrowmap.core.adjustment.position_observations import AntennaPositions
from furrowmap.core.matching.antenna_sway import AntennaSway, antenna_sway
from furrowmap.core.values.gnss import Positions

STATED_M = np.array([1.8, -0.4, 2.6])


def seen(off_m: tuple[float, float, float], every: int = 4, seconds: float = 30.0, late: int = 0) -> AntennaSway:
    """A vehicle on its way that rolls and pitches at 1.5 and 1.1 Hz, with poses that do not give way."""
    t_s = np.arange(0.0, seconds, 0.1)
    knots = knots_over(t_s)
    s = knots.t_s - knots.t_s[0]
    tilt = np.radians(1.5) * np.column_stack([np.sin(2.0 * np.pi * 1.1 * s), np.cos(2.0 * np.pi * 1.5 * s)])
    rotation = Rotation.from_euler("ZYX", np.column_stack([np.full(len(s), 0.3), tilt])).as_matrix()
    state = State(np.column_stack([1.2 * s, 0.2 * s, 0.0 * s]), rotation, np.zeros((len(s), 3)))
    at = np.arange(late, len(s) - 1, every)
    n = len(at)
    xyz_m = state.xyz_m[at] + rotation[at] @ (STATED_M + off_m)
    sigma = np.full((n, 3), 0.01)
    none, run = np.full(n, np.nan), np.zeros(n, np.intp)
    positions = Positions(knots.t_s[at - late] + 1e-6, xyz_m, sigma, sigma, run, np.full(n, 4, np.int8), none)
    held = NormalEquations(len(s) * VEHICLE.size, 2 * VEHICLE.size)
    held.band[0] = 1e12
    return antenna_sway(knots, state, AntennaPositions.unweighted(positions, np.zeros(3), STATED_M), held)


@pytest.mark.parametrize(
    "off_m", [(0.0, 0.0, 0.0), (0.9, 0.0, 0.0), (0.0, -0.8, 0.0), (0.0, 0.0, 0.7), (1.0, 0.4, -0.6)]
)
def test_sway__shows_what_is_missing_to_the_lever_arm(off_m: tuple[float, float, float]) -> None:
    found = seen(off_m)
    assert found.lever_m == pytest.approx(off_m, abs=0.01)
    assert found.off == (max(map(abs, off_m)) > 0.0)
    assert found.known
    assert found.plain() is not None


def test_sway__is_known_no_better_than_its_floor_and_the_share_of_the_arm_that_poses_follow() -> None:
    sigma_m = seen((0.0, 0.0, 0.0)).sigma_m
    expected = np.hypot([0.06, 0.06, 0.03], [0.1 * 1.8, 0.1 * 0.4, 0.05 * 2.6])
    assert sigma_m == pytest.approx(expected, abs=1e-3)


def test_sway__is_not_shown_by_few_or_rare_positions() -> None:
    for found in (seen((1.0, 0.0, 0.0), every=9), seen((1.0, 0.0, 0.0), seconds=3.0)):
        assert found == AntennaSway()
        assert not found.off
        assert not found.known
        assert found.plain() is None


def test_sway__that_comes_late_is_an_offset_of_the_clocks() -> None:
    found = seen((0.0, 0.0, 0.0), late=28)
    assert found.off
    assert found.clock_s == pytest.approx(28 * KNOT_STEP_S, abs=0.01)
    assert seen((1.0, 0.4, -0.6)).clock_s == 0.0


def test_an_antenna_that_does_not_sway_along__is_told() -> None:
    assert seen((-1.8, 0.4, 0.0)).unrelated
    assert not seen((-3.6, 0.4, 0.0)).unrelated
