"""The error of positions by control points: closed forms, dense least squares, and points in error."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from furrowmap.core.pipeline.control.frame_error import (
    CRITICAL_RESIDUAL,
    FRAME_SIGMA_M,
    ControlObservations,
    ErrorModel,
    FrameError,
    snooped,
)
from furrowmap.core.runtime.arrays import FloatArray

UP = 2
DRIFT_SHARE = 0.5
PRIOR = ErrorModel(np.zeros(3), np.full(3, FRAME_SIGMA_M), np.zeros(3), DRIFT_SHARE)
"""Of a frame that does not turn."""
TILTING = ErrorModel(np.zeros(3), np.full(3, FRAME_SIGMA_M), np.array([0.002, 0.002, 0.001]), 0.0)


def at(error: FrameError, t_s: FloatArray, gnss_m: float = 0.01) -> tuple[FloatArray, FloatArray]:
    """In the middle of the frame."""
    return error.at(t_s, np.zeros((len(t_s), 3)), np.full((len(t_s), 3), gnss_m))


def heights(
    off_m: FloatArray,
    t_s: FloatArray,
    *,
    sigma_m: float = 0.005,
    survey_m: float = 0.005,
    gnss_m: float = 0.01,
    place_m: FloatArray | None = None,
) -> ControlObservations:
    """A height at each point, each seen once."""
    count = len(off_m)
    return ControlObservations(
        point=np.arange(count),
        component=np.full(count, UP),
        direction=np.tile([0.0, 0.0, 1.0], (count, 1)),
        place_m=np.zeros((count, 3)) if place_m is None else place_m,
        off_m=np.asarray(off_m, np.float64),
        sigma_m=np.full(count, sigma_m),
        survey_sigma_m=np.full(count, survey_m),
        share=np.eye(count),
        t_s=np.asarray(t_s, np.float64),
        gnss_sigma_m=np.full((count, 3), gnss_m),
    )


def test_one_point__has_the_weight_of_its_variance() -> None:
    seen = heights(np.array([0.05]), np.array([10.0]))
    before = FRAME_SIGMA_M**2 + 0.01**2
    own = 0.005**2 + 0.005**2
    shift, variance = at(FrameError(seen, PRIOR), np.array([10.0]))
    assert shift[0] == pytest.approx([0.0, 0.0, 0.05 * before / (before + own)])
    assert variance[0, UP] == pytest.approx(before * own / (before + own))
    assert variance[0, 0] == pytest.approx(0.01**2)  # nothing shows easting


def test_estimate__is_that_of_least_squares_with_the_process_as_unknowns() -> None:
    """The same by the normal equations of the frame, the lasting part and the Gauss-Markov part at every time."""
    chance = np.random.default_rng(5)
    t_s = np.sort(chance.uniform(0.0, 300.0, 6))
    off = chance.normal(0.04, 0.02, 6)
    seen = heights(off, t_s)
    at_s = np.linspace(-50.0, 350.0, 9)
    every_s = np.concatenate([t_s, at_s])
    process = np.exp(-np.abs(every_s[:, None] - every_s) / PRIOR.correlation_s) * DRIFT_SHARE * 0.01**2
    prior = np.zeros((len(every_s) + 2, len(every_s) + 2))
    prior[0, 0] = FRAME_SIGMA_M**2
    prior[1, 1] = (1.0 - DRIFT_SHARE) * 0.01**2
    prior[2:, 2:] = process
    design = np.column_stack([np.ones(6), np.ones(6), np.eye(len(every_s))[:6]])
    normal = design.T @ design / (2 * 0.005**2) + np.linalg.inv(prior)
    covariance = np.linalg.inv(normal)
    found = covariance @ design.T @ off / (2 * 0.005**2)
    wanted = np.column_stack([np.ones(9), np.ones(9), np.eye(len(every_s))[6:]])
    shift, variance = at(FrameError(seen, PRIOR), at_s)
    np.testing.assert_allclose(shift[:, UP], wanted @ found, atol=1e-9)
    np.testing.assert_allclose(variance[:, UP], np.einsum("ij,jk,ik->i", wanted, covariance, wanted), rtol=1e-6)


def test_normalised_residual__is_that_of_the_point_against_all_others() -> None:
    chance = np.random.default_rng(2)
    off = chance.normal(0.03, 0.01, 5)
    seen = heights(off, np.arange(5) * 40.0)
    residuals = FrameError(seen, PRIOR).normalised()
    for number in range(5):
        others = FrameError(seen.where(seen.point != number), PRIOR)
        shift, variance = at(others, seen.t_s[[number]])
        expected = (off[number] - shift[0, UP]) / np.sqrt(variance[0, UP] + 2 * 0.005**2)
        assert residuals[number, UP] == pytest.approx(expected)


def test_survey__is_shared_by_all_visits_of_a_point() -> None:
    """However often a wrong height is seen, it stays as wrong."""
    many = 200
    seen = heights(np.full(many, 0.05), np.arange(many) * 1.0, survey_m=0.02)
    one = ControlObservations(**{**vars(seen), "point": np.zeros(many, np.int64)})
    _, variance = at(FrameError(one, PRIOR), np.array([100.0]))
    assert variance[0, UP] > 0.9 * 0.02**2


@pytest.mark.parametrize("wrong", range(4))
def test_one_point_in_error__is_left_out_and_named(wrong: int) -> None:
    chance = np.random.default_rng(wrong)
    off = 0.05 + chance.normal(0.0, 0.006, 4)
    off[wrong] += 0.1
    found = snooped(heights(off, np.arange(4) * 30.0), PRIOR)
    assert found.left_out == (wrong,)
    assert abs(found.residual[wrong, UP]) > CRITICAL_RESIDUAL
    assert found.error is not None
    shift, _ = at(found.error, np.array([45.0]))
    assert shift[0, UP] == pytest.approx(np.delete(off, wrong).mean(), abs=0.003)


def test_two_points__that_differ_contradict_each_other() -> None:
    found = snooped(heights(np.array([0.0, 0.1]), np.array([0.0, 30.0])), PRIOR)
    assert (found.error, found.left_out, found.contradicting) == (None, (), (0, 1))


def test_most_points_in_error__are_not_outvoted() -> None:
    found = snooped(heights(np.array([0.05, 0.05, 0.4, -0.5, 0.9]), np.arange(5) * 30.0), PRIOR)
    assert found.error is None
    assert found.contradicting == (0, 1, 2, 3, 4)


def test_points_that_agree_on_more_than_is_usual__are_believed() -> None:
    found = snooped(heights(np.array([1.2, 1.2, 1.2]), np.arange(3) * 30.0), PRIOR)
    assert found.error is not None
    shift, _ = at(found.error, np.array([30.0]))
    assert shift[0, UP] == pytest.approx(1.2, abs=1e-4)


def test_single_point__that_is_far_off_is_not_believed() -> None:
    found = snooped(heights(np.array([0.6]), np.zeros(1)), PRIOR)
    assert (found.error, found.contradicting) == (None, (0,))


def test_right_points__are_left_out_as_seldom_as_the_critical_value_says() -> None:
    chance = np.random.default_rng(11)
    t_s = np.linspace(0.0, 200.0, 6)
    sigma = np.full(6, 0.01)
    cover = FRAME_SIGMA_M**2 + PRIOR.position_covariance(t_s, sigma, t_s, sigma)
    root = np.linalg.cholesky(cover + np.diag(np.full(6, 2 * 0.005**2)))
    trials = 3000
    doubted = sum(bool(FrameError(heights(root @ chance.normal(size=6), t_s), PRIOR).doubted()) for _ in range(trials))
    rate = 6 * 2 * norm.sf(CRITICAL_RESIDUAL)  # of six tests, hardly correlated
    assert rate == pytest.approx(0.006, rel=0.01)
    assert doubted / trials < rate + 3 * np.sqrt(rate / trials)


def test_tilt__of_the_frame_is_found_from_heights_far_from_each_other() -> None:
    """Against least squares of a plane, with the standard deviations before as observations."""
    chance = np.random.default_rng(8)
    place = np.column_stack([chance.uniform(-20.0, 20.0, (5, 2)), np.zeros(5)])
    off = 0.03 - 0.001 * place[:, 0] + 0.0015 * place[:, 1] + chance.normal(0.0, 0.004, 5)
    error = FrameError(heights(off, np.zeros(5), place_m=place), TILTING)
    design = np.column_stack([np.ones(5), place[:, 1], -place[:, 0]])
    prior = np.diag([1.0 / (FRAME_SIGMA_M**2 + 0.01**2), 0.002**-2.0, 0.002**-2.0])
    covariance = np.linalg.inv(design.T @ design / (2 * 0.005**2) + prior)
    found = covariance @ design.T @ off / (2 * 0.005**2)
    turn, variance = error.turn_rad
    np.testing.assert_allclose(turn, [found[1], found[2], 0.0], atol=1e-12)
    np.testing.assert_allclose(variance[:2], np.diag(covariance)[1:], rtol=1e-9)
    assert variance[2] == 0.001**2  # heights do not show a heading
    far = np.array([[15.0, -12.0, 0.0]])
    shift, after = error.at(np.zeros(1), far, np.full((1, 3), 0.01))
    row = np.array([1.0, -12.0, -15.0])
    assert shift[0, UP] == pytest.approx(row @ found)
    assert after[0, UP] == pytest.approx(row @ covariance @ row)


def test_one_of_two_that_cannot_be_told__both_are_left_out() -> None:
    """Four points in a square: what a plane does not fit is the same at all, and what is known before decides."""
    place = np.array([[10.0, 10.0, 0.0], [-10.0, 10.0, 0.0], [-10.0, -10.0, 0.0], [10.0, -10.0, 0.0]])
    free = ErrorModel(np.zeros(3), np.full(3, 10.0), np.full(3, 1.0), 0.0)
    off = np.array([0.1, 0.0, 0.0, 0.0])
    found = snooped(heights(off, np.zeros(4), place_m=place), free)
    assert found.error is None
    assert found.contradicting == (0, 1, 2, 3)
    narrow = ErrorModel(np.zeros(3), np.full(3, 0.1), np.full(3, 0.0005), 0.0)
    found = snooped(heights(off, np.zeros(4), place_m=place), narrow)
    assert (found.left_out, found.unclear) == ((0,), ())
