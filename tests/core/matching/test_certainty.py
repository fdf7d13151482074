"""Standard deviations against dense covariances."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.coarse import CoarseKnots, fine_step
from furrowmap.core.adjustment.covariance import Considered
from furrowmap.core.adjustment.knots import KNOT_STEP_S, VEHICLE, State, knots_over
from furrowmap.core.matching.ground_registration import CORRELATED
from furrowmap.core.matching.matched import AROUND_S, information_of, sigmas, sources_of
from furrowmap.core.matching.problem import Linearised

SIZE = VEHICLE.size


def random_chain(count: int, seed: int, scale: float) -> NormalEquations:
    """Well-posed equations of a chain of knots."""
    random = np.random.default_rng(seed)
    equations = NormalEquations(count * SIZE, 2 * SIZE)
    for _ in range(3 * SIZE):
        first = np.arange(0, (count - 1) * SIZE, SIZE)
        design = random.normal(size=(len(first), 2 * SIZE))
        equations.add(first, design, random.normal(size=len(first)), np.full(len(first), scale))
    return equations


@pytest.mark.parametrize(("held_by_returns", "independent"), [(0.0, 1.0), (1e12, CORRELATED)])
def test_sigmas__are_of_slow_and_quick_errors_together(held_by_returns: float, independent: float) -> None:
    knots = knots_over(np.array([0.0, 0.9]))
    s = knots.t_s
    rotation = Rotation.from_euler("ZYX", np.column_stack([0.5 + s, 0.05 * np.sin(s), 0.04 * np.cos(s)]))
    state = State(np.column_stack([np.sin(s), s, 0.1 * s]), rotation.as_matrix(), np.zeros((len(s), 3)))
    coarse = CoarseKnots.over(knots, 10, 1.0)
    centre = coarse.centres(knots, state)
    quick, slow = random_chain(len(knots), 1, 0.01), random_chain(coarse.count, 2, 0.02)
    bow = Considered(*np.random.default_rng(3).normal(size=(2, coarse.count * SIZE)))
    normal = np.tile(held_by_returns * np.eye(6)[np.triu_indices(6)], (len(knots), 1))
    found = sigmas(state, Linearised(quick, coarse, centre, slow, slow.solve(), state), bow, normal)

    def covariance(equations: NormalEquations) -> np.ndarray:
        n = equations.band.shape[1]
        whole = np.zeros((n, n))
        for offset, diagonal in enumerate(equations.band):
            index = np.arange(n - offset)
            whole[index + offset, index] = whole[index, index + offset] = diagonal[: n - offset]
        return np.linalg.inv(whole)

    ones = np.eye(coarse.count * SIZE)
    projection = np.column_stack([fine_step(coarse, centre, state, one).reshape(-1) for one in ones])
    bent = bow.mode - covariance(slow) @ bow.right
    of_slow = projection @ (covariance(slow) + np.outer(bent, bent)) @ projection.T
    # Where returns hold it, the quick part of a heading is that of independent ones.
    of_quick = np.diag(covariance(quick)).reshape(-1, SIZE) / np.array(
        [1.0, 1.0, 1.0, 1.0, 1.0, independent, 1.0, 1.0, 1.0]
    )
    for k in range(len(knots)):
        pose = slice(k * SIZE, k * SIZE + 6)
        both = of_slow[pose, pose] + np.diag(of_quick[k, :6])
        np.testing.assert_allclose(found[k, :3], np.sqrt(np.diag(both)[:3]), rtol=1e-8)
        turn = both[3:, 3:]
        # Roll turns about the vehicle's x axis, pitch about its y axis, heading about the map's up.
        axes = [state.rotation[k, :, 0], state.rotation[k, :, 1], np.array([0.0, 0.0, 1.0])]
        expected = np.degrees([np.sqrt(axis @ turn @ axis) for axis in axes])
        np.testing.assert_allclose(found[k, 3:], expected, rtol=1e-8)


def some_normals(n: int, first: int, last: int, seed: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Random normal matrices of the slices from `first` to `last`, square and as upper triangles."""
    random = np.random.default_rng(seed)
    matrices, upper = np.zeros((n, 6, 6)), np.zeros((n, 21))
    for k in range(first, last):
        root = scale * random.normal(size=(8, 6))
        matrices[k] = root.T @ root
        upper[k] = matrices[k][np.triu_indices(6)]
    return matrices, upper


def test_information_of__is_what_the_returns_within_a_second_know() -> None:
    matrices, upper = some_normals(120, 20, 90, 6, 100.0)
    found = information_of(upper)
    half = round(AROUND_S / KNOT_STEP_S)
    for k in (0, 15, 60, 100):
        near = matrices[max(0, k - half) : k + half + 1].sum(axis=0)
        if not near.any():
            assert found.heading[k] == found.place[k] == 0.0
            assert not found.level[k]
        else:
            known = np.linalg.inv(near)
            assert found.heading[k] == pytest.approx(1.0 / known[5, 5], rel=1e-6)
            assert found.place[k] == pytest.approx(1.0 / np.linalg.eigvalsh(known[:2, :2])[-1], rel=1e-6)
            assert found.level[k]
    assert found.heading[119] == 0.0


def test_held_by__names_what_holds_most_firmly() -> None:
    n = 200
    _, relief = some_normals(n, 0, 200, 1, 10.0)
    _, walls = some_normals(n, 80, 200, 2, 100.0)
    has_position = np.arange(n) < 150
    unsure, sure = (np.full(n, sigma_deg) for sigma_deg in (20.0, 1e-4))
    held = sources_of(relief, walls, unsure, np.full(n, "gnss"), has_position)
    assert set(held.heading[:50]) == {"relief"}
    assert set(held.heading[110:]) == {"walls"}
    assert set(held.position[:150]) == {"gnss"}
    assert set(held.position[150:]) == {"walls"}
    assert set(held.height[:150]) == {"gnss"}
    assert set(held.height[150:]) == {"ground"}
    assert set(held.level) == {"ground"}
    assert set(sources_of(relief, walls, sure, np.full(n, "antennas"), has_position).heading) == {"antennas"}
    blind = sources_of(0 * relief, 0 * walls, unsure, np.full(n, "gnss"), has_position)
    assert set(blind.heading) == {"gnss"}
    assert set(blind.position[150:]) == set(blind.height[150:]) == {"carried"}
    assert set(blind.level) == {"assumed"}


@settings(max_examples=25, deadline=None)
@given(st.floats(0.5, 2.0).filter(lambda ratio: abs(ratio - 1.0) > 0.01), st.floats(0.01, 5.0))
def test_held_by__changes_where_the_returns_know_more_than_what_was_known_before(
    ratio: float, sigma_deg: float
) -> None:
    """The returns' own standard deviation is `ratio` of that of the heading before, and of 5 cm in place."""
    n = 60
    within = 2 * round(AROUND_S / KNOT_STEP_S) + 1  # slices about a knot in the middle
    known = np.diag([(ratio * 0.05) ** -2, (ratio * 0.05) ** -2, 1e6, 1e9, 1e9, (ratio * np.radians(sigma_deg)) ** -2])
    normals = np.tile(known[np.triu_indices(6)] / within, (n, 1))
    middle = slice(within // 2, n - within // 2)
    sigma, before, nowhere = np.full(n, sigma_deg), np.full(n, "course"), np.zeros(n, dtype=bool)
    firmer = ratio < 1.0
    for ground, walls, name in ((normals, 0 * normals, "relief"), (1e-6 * normals, normals, "walls")):
        held = sources_of(ground, walls, sigma, before, nowhere)
        assert set(held.heading[middle]) == {name if firmer else "course"}
        assert set(held.position[middle]) == {name if firmer else "carried"}
