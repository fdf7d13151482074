"""The move between two dates by a few things whose equations are solved by hand."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.coregistration.upright import Upright, tie_uprights

MIDDLE_M = np.array([100.0, 200.0])
SIGMA = np.array([0.03, 0.03, 0.005])


def posts(*off_m: tuple[float, float], sigma_m: float = 0.01) -> Upright:
    """Posts at places about the middle."""
    n = len(off_m)
    return Upright(MIDDLE_M + np.reshape(off_m, (n, 2)), np.full((n, 2), np.nan), np.full(n, sigma_m))


def face(east_m: float, north_m: float, normal_deg: float, sigma_m: float = 0.01) -> Upright:
    """A piece of a face beside the middle; the normal clockwise from north."""
    normal = np.array([[np.sin(np.radians(normal_deg)), np.cos(np.radians(normal_deg))]])
    return Upright(MIDDLE_M + np.array([[east_m, north_m]]), normal, np.array([sigma_m]))


@pytest.mark.parametrize(
    ("place_sigma", "reach_m"),
    [(0.001, 0.1), (0.03, 3.0 * np.hypot(0.03, 0.03)), (0.06, 3.0 * np.hypot(0.06, 0.06)), (2.0, 0.5)],
)
def test_post__is_matched_within_three_standard_deviations_of_the_receivers(place_sigma: float, reach_m: float) -> None:
    """Between 0.1 and 0.5 m."""
    sigma = np.array([place_sigma, place_sigma, 0.005])
    for times, matched in ((0.98, True), (1.02, False)):
        tie = tie_uprights(posts((0.0, 0.0)), posts((0.6 * times * reach_m, 0.8 * times * reach_m)), MIDDLE_M, sigma)
        assert (tie is not None) is matched


@pytest.mark.parametrize("sigma_m", [0.0, 0.004, 0.05])
def test_place__of_one_post_is_as_good_as_it_and_the_slow_error_of_both_dates(sigma_m: float) -> None:
    """Variances add: of the post on both dates, 5 mm that things share, 3 mm at least."""
    tie = tie_uprights(posts((-0.02, 0.01), sigma_m=sigma_m), posts((0.0, 0.0), sigma_m=sigma_m), MIDDLE_M, SIGMA)
    assert tie is not None
    assert tie.place == pytest.approx([-0.02, 0.01, 0.0], abs=1e-9)
    variance = 2.0 * sigma_m**2 + 0.005**2 + 0.003**2
    assert tie.information == pytest.approx(np.diag([1.0 / variance, 1.0 / variance, 0.0]), rel=1e-6, abs=1e-3)
    assert (len(tie.used_m), len(tie.moved_m)) == (1, 0)


@pytest.mark.parametrize(("apart_m", "together"), [(3.0, True), (20.0, False)])
def test_posts__of_one_thing_share_an_error(apart_m: float, together: bool) -> None:
    """Squares of 8 m; the middle lies 4 m from an edge of its own."""
    places = ((-0.5 * apart_m, 0.0), (0.5 * apart_m, 0.0))
    tie = tie_uprights(posts(*places), posts(*places), MIDDLE_M, SIGMA)
    assert tie is not None
    alone, shared = 2.0 * 0.01**2, 0.005**2
    mean = 0.5 * alone + (shared if together else 0.5 * shared)
    assert 1.0 / tie.information[0, 0] == pytest.approx(mean + 0.003**2, rel=1e-6)
    arm = 0.5 * max(apart_m, 2.0)
    assert 1.0 / tie.information[2, 2] == pytest.approx((mean + 0.003**2) / arm**2, rel=1e-6)


def test_turn__is_counter_clockwise_about_the_middle() -> None:
    turn, places = 0.004, np.array([(-10.0, 0.0), (10.0, 0.0), (0.0, 10.0), (0.0, -10.0)])
    turned = places + turn * np.column_stack([-places[:, 1], places[:, 0]])
    tie = tie_uprights(posts(*map(tuple, turned)), posts(*map(tuple, places)), MIDDLE_M, SIGMA)
    assert tie is not None
    assert tie.place == pytest.approx([0.0, 0.0, turn], abs=1e-6)


def test_thing_that_moved__does_not_count() -> None:
    places = ((-10.0, 0.0), (10.0, 0.0), (0.0, 10.0), (0.0, -10.0), (10.0, 10.0))
    other = [*places[:4], (10.1, 10.0)]
    tie = tie_uprights(posts(*places, sigma_m=0.004), posts(*other, sigma_m=0.004), MIDDLE_M, SIGMA)
    assert tie is not None
    assert tie.place == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert tie.moved_m == pytest.approx(MIDDLE_M + np.array([[10.1, 10.0]]))
    assert len(tie.used_m) == 4
    away = tie.all_moved()
    assert (len(away.used_m), len(away.moved_m)) == (0, 5)
    assert not away.information.any()
    assert not away.place.any()


@pytest.mark.parametrize(
    ("along_m", "across_m", "turned_deg", "matched"),
    [
        (0.39, 0.05, 0.0, True),
        (0.41, 0.05, 0.0, False),
        (0.0, 0.12, 0.0, True),
        (0.0, 0.13, 0.0, False),
        (0.0, 0.05, 11.9, True),
        (0.0, 0.05, -11.9, True),
        (0.0, 0.05, 12.1, False),
        (0.0, 0.05, 191.9, True),
    ],
)
def test_face__is_matched_to_one_of_its_direction_beside_it(
    along_m: float, across_m: float, turned_deg: float, matched: bool
) -> None:
    """40 cm along it, 3 · 0.03 · √2 m across it, 12°; whichever way a normal points."""
    tie = tie_uprights(face(-along_m, -across_m, 0.0), face(0.0, 0.0, turned_deg), MIDDLE_M, SIGMA)
    assert (tie is not None) is matched
    if tie is not None and not turned_deg:
        assert tie.place[1] == pytest.approx(-across_m, abs=1e-6)
        assert np.linalg.matrix_rank(tie.information, tol=1.0) == 1  # along a face nothing shows
    assert tie_uprights(face(0.0, 0.0, 0.0), posts((along_m, across_m)), MIDDLE_M, SIGMA) is None
