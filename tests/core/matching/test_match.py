"""Matching a short simulated drive, against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.matching.matched import Matched, matched_by, prepare
from furrowmap.core.matching.placing import Tool
from furrowmap.core.matching.returns import GroundReturns, ground_returns
from furrowmap.core.matching.schedule import solve
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.trajectory import SIGMA_NAMES, Motion, Trajectory
from tests.core.conftest import Recording


@dataclass(frozen=True)
class Judged:
    """What came of matching.

    Attributes:
        before: errors (n, 6) of the approximate trajectory, in the order of SIGMA_NAMES.
        after: of the matched one.
        moving: (n,) where headings count.
    """

    matched: Matched
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    sigma: NDArray[np.float64]
    moving: NDArray[np.bool_]
    told: list[float]


def errors(found: Trajectory, truth: Trajectory, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    ours, true = found.at(t_s), truth.at(t_s)
    angles = zip(ours.attitude_deg(), true.attitude_deg(), strict=True)
    return np.column_stack([ours.xyz_m - true.xyz_m, *(wrap_deg(a - b) for a, b in angles)])


@pytest.fixture(scope="module")
def judged(straight: Recording) -> Judged:
    session, located = straight.session, straight.located
    assert located.antenna is not None
    assert session.antenna is not None
    assert session.implement is not None
    returns = ground_returns(straight.scans(), session.lidar.mounting, located.trajectory)
    told: list[float] = []
    tool = Tool(session.implement.xy_m, 0.5 * session.implement.width_m)
    mounting = session.lidar.mounting
    prepared = prepare(returns, located.trajectory, located.antenna, session.antenna.xyz_m, mounting, tool)
    assert prepared is not None
    matched = matched_by(prepared, solve(prepared.problem, prepared.first, told.append))
    trajectory = matched.trajectory
    t = np.arange(returns.t_s[0] + 0.1, returns.t_s[-1] - 0.1, 0.05)
    k, share, known = trajectory.interval(t)
    assert known.all()
    moving = trajectory.motion[k] != Motion.STANDING
    sigma = trajectory.sigma[k + (share > 0.5)]
    before, after = (errors(one, straight.truth, t) for one in (located.trajectory, trajectory))
    return Judged(matched, before, after, sigma, moving, told)


def rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_roll_pitch_and_height_follow_the_sway(judged: Judged) -> None:
    """Their mean over so short a way is GNSS's to know."""
    assert judged.before[:, 3].std() > 0.2
    for column, most in ((2, 0.006), (3, 0.04), (4, 0.05)):
        assert judged.after[:, column].std() <= most, SIGMA_NAMES[column]
    assert abs(judged.after[:, 3].mean()) < 0.6
    assert abs(judged.after[:, 4].mean()) < 0.3


def test_the_relief_shows_the_heading_at_once(judged: Judged) -> None:
    assert rms(judged.before[judged.moving, 5]) > 1.0
    assert rms(judged.after[judged.moving, 5]) <= 0.12
    assert "relief" in judged.matched.trajectory.heading_from


def test_positions_are_no_worse_than_those_of_gnss(judged: Judged) -> None:
    horizontal = np.hypot(judged.after[:, 0], judged.after[:, 1])
    assert rms(horizontal) < 0.025
    assert rms(horizontal) < rms(np.hypot(judged.before[:, 0], judged.before[:, 1]))


def test_errors_are_what_their_sigmas_say(judged: Judged) -> None:
    assert (judged.sigma > 0).all()
    ratio = np.abs(judged.after) / judged.sigma
    assert (ratio[:, :5] < 3.0).mean() > 0.98
    assert (ratio[judged.moving, 5] < 3.0).mean() > 0.98
    assert np.sqrt((ratio**2).mean(axis=0)).max() < 2.0
    assert np.median(judged.sigma[:, 5]) < 0.3


def test_a_right_mounting_stays_as_it_is(straight: Recording, judged: Judged) -> None:
    assert judged.matched.mounting == straight.session.lidar.mounting
    assert judged.matched.notices == ()
    assert judged.matched.seen.cause is None


def test_the_report_tells_what_was_matched(judged: Judged) -> None:
    figures = judged.matched.figures
    assert 0.005 < figures["residual_rms_m"] < 0.015
    assert 0.5 * figures["returns"] < figures["returns_matched"] <= figures["returns"]
    assert figures["body_footprint_m2"] > 1.0


def test_progress_is_told(judged: Judged) -> None:
    assert all(0.0 < share <= 1.0 for share in judged.told)
    assert judged.told[-1] == max(judged.told) > 0.9
    assert judged.told[0] < 0.2


def test_too_few_returns_are_not_matched(straight: Recording) -> None:
    located = straight.located
    assert located.antenna is not None
    few = GroundReturns(np.zeros(10), np.zeros((10, 3), np.float32), np.zeros(10, np.uint8), np.zeros((80, 80), bool))
    lever, mounting = (0.0, 0.0, 0.0), straight.session.lidar.mounting
    assert prepare(few, located.trajectory, located.antenna, lever, mounting, None) is None


def test_a_stray_return_long_after_all_others_does_no_harm(straight: Recording) -> None:
    located, session = straight.located, straight.session
    assert located.antenna is not None
    assert session.antenna is not None
    whole = ground_returns(straight.scans(), session.lidar.mounting, located.trajectory)
    part = slice(0, int(np.searchsorted(whole.t_s, whole.t_s[0] + 3.0)))
    stray_s = located.trajectory.span_s[1] + 20.0
    few = GroundReturns(whole.t_s[part], whole.xyz_m[part], whole.half[part], whole.body)
    more = GroundReturns(
        np.append(few.t_s, stray_s),
        np.concatenate([few.xyz_m, few.xyz_m[:1]]),
        np.append(few.half, few.half[:1]),
        whole.body,
    )
    arguments = located.trajectory, located.antenna, session.antenna.xyz_m, session.lidar.mounting, None
    prepared = [prepare(returns, *arguments) for returns in (few, more)]
    without, found = (
        matched_by(one, solve(one.problem, one.first, lambda share: None)) for one in prepared if one is not None
    )
    near = len(without.trajectory)
    assert (found.trajectory.t_s[near:] > stray_s - 1.0).all()
    assert found.trajectory.sigma[near:, :2].min() > 1.0
    assert np.abs(found.trajectory.xyz_m[:near] - without.trajectory.xyz_m).max() < 0.001
    np.testing.assert_allclose(found.trajectory.sigma[:near], without.trajectory.sigma, rtol=0.02)
