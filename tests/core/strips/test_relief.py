"""Strips over rough ground, shifted in plan: relief tells by how much, and nothing where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.strips.relief import PlanShifts, SeenRelief, plan_shifts, relief, relief_equations
from furrowmap.core.strips.strips import StripReturns
from furrowmap.core.values.rotation import Mounting

FloatArray = NDArray[np.float64]

SIDE_M = 6.0
HEIGHT_M = 8.0
NOISE_M = 0.012
LEVEL = Mounting()


def ground_m(e_m: FloatArray, n_m: FloatArray, size_m: float) -> FloatArray:
    """Clods of a size, and a slope of 2 %."""
    chance = np.random.default_rng(5)
    height = 0.02 * e_m
    for turn in chance.uniform(0.0, np.pi, 12):
        along = np.cos(turn) * e_m + np.sin(turn) * n_m
        height = height + size_m / 3.0 * np.sin(
            2.0 * np.pi * along / chance.uniform(0.4, 0.9) + chance.uniform(0.0, 6.0)
        )
    return np.asarray(height, np.float64)


def strips(
    shifts_m: FloatArray, size_m: float, seed: int, *, per_strip: int = 60_000, tall_m: float = 0.0
) -> tuple[StripReturns, NDArray[np.int64]]:
    """Returns of strips above different lines, each put where it is not by a shift; and their numbers from 1.

    A crop of a height lets beams in: what they meet is lower by some of it where they come from above.
    """
    chance = np.random.default_rng(seed)
    rows = []
    numbers = []
    for k in range(len(shifts_m)):
        place = chance.uniform(0.0, SIDE_M, (per_strip, 2))
        # Strips to the east and to the north by turns; the scanner looks ahead and back.
        line = place + chance.uniform(-1.5, 1.5, (per_strip, 1))
        line[:, 1 - k % 2] = 2.0 + k
        origin = np.column_stack([line, np.full(per_strip, HEIGHT_M)])
        height = ground_m(*place.T, size_m) + NOISE_M * chance.standard_normal(per_strip)
        met = np.column_stack([place, height])
        if tall_m:
            plot = (np.abs(place - SIDE_M / 2.0) < 1.3).all(axis=1)
            # The face that the scanner sees adds returns before the edge, and shadow hides the soil behind it.
            seen = place - tall_m * (place - line) / HEIGHT_M
            met[plot, 2] += tall_m
            met[plot, :2] = seen[plot]
        rows.append((met - origin, origin + np.append(shifts_m[k], 0.0)))
        numbers.append(np.full(per_strip, k + 1))
    sensor, origin = (np.concatenate([row[i] for row in rows]) for i in (0, 1))
    n = len(sensor)
    still = np.zeros((n, 3), np.float32)
    level = np.tile(np.float32([1.0, 0.0, 0.0, 0.0]), (n, 1))
    whole = StripReturns(
        np.arange(n) * 1e-3, sensor.astype(np.float32), np.zeros(n, np.int64), origin.astype(np.float32), level, still,
        still, np.zeros(3),
    )  # fmt: skip
    return whole, np.concatenate(numbers).astype(np.int64)


def shifts_of(moved_m: list[tuple[float, float]], size_m: float, seed: int, tall_m: float = 0.0) -> PlanShifts | None:
    returns, number = strips(np.array(moved_m), size_m, seed, tall_m=tall_m)
    return plan_shifts(returns, number, LEVEL, LEVEL)


def test_shifts__are_found_within_their_sigmas() -> None:
    true = np.array([(0.0, 0.0), (0.012, -0.007), (-0.004, 0.009)])
    ratios = []
    for seed in range(6):
        found = shifts_of(true.tolist(), 0.015, seed)
        assert found is not None
        assert (found.sigma_m < 0.004).all()
        ratios.append((found.after_m - (true - true.mean(axis=0))) / found.sigma_m)
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_shifts__by_a_stated_mounting_are_those_of_its_turn() -> None:
    """Strips to the east and to the north: with a roll of half a degree each is put to its left by height and turn."""
    returns, number = strips(np.zeros((2, 2)), 0.015, 1)
    north = np.float32([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    there = replace(returns, rotation=np.where((number == 2)[:, None], north, returns.rotation))
    along = number == 2
    turned = there.sensor_m.copy()
    turned[along] = there.sensor_m[along][:, [1, 0, 2]] * np.float32([1.0, -1.0, 1.0])
    there = replace(there, sensor_m=turned)
    found = plan_shifts(there, number, Mounting(rpy_deg=(0.5, 0.0, 0.0)), LEVEL)
    assert found is not None
    put = HEIGHT_M * np.tan(np.radians(0.5))
    right = np.array([[0.0, put], [-put, 0.0]])
    np.testing.assert_allclose(found.before_m - found.after_m, right - right.mean(axis=0), rtol=0, atol=0.002)
    assert found.rms_m[0] > 5.0 * found.rms_m[1]


@pytest.mark.parametrize("size_m", [0.0, 0.0003])
def test_smooth_ground__claims_no_shift(size_m: float) -> None:
    """Slopes of noise would say that strips are not shifted, whatever they are."""
    found = shifts_of([(0.0, 0.0), (0.03, 0.0), (0.0, 0.03)], size_m, 2)
    assert found is None or (found.sigma_m > 0.01).all()


def test_faces_of_plots__that_are_seen_from_either_side_are_no_shift() -> None:
    """Strips see the face that looks at them: the plot seems to be shifted away from each."""
    found = shifts_of(3 * [(0.0, 0.0)], 0.01, 3, tall_m=0.4)
    assert found is not None
    assert (np.abs(found.after_m) < 4.0 * found.sigma_m).all()


def test_figures__are_those_of_the_report() -> None:
    found = shifts_of([(0.0, 0.0), (0.02, 0.0), (0.0, 0.0)], 0.015, 4)
    assert found is not None
    plain = found.plain()
    assert plain["before_rms_m"] == round(found.rms_m[0], 4)
    assert [row["strip"] for row in plain["strips"]] == [1, 2, 3]
    assert plain["strips"][1]["after_m"] == np.round(found.after_m[1], 4).tolist()


def test_equations__are_those_of_dense_matrices() -> None:
    """Each window has two unknowns of its own, and all share one that shifts them by some direction."""
    returns, number = strips(np.array([(0.0, 0.0), (0.01, 0.0), (0.0, 0.01)]), 0.015, 7)
    seen = relief(returns, number - 1, np.eye(3), np.zeros(3), 0.125)
    chance = np.random.default_rng(1)
    by = chance.standard_normal((len(seen.groups.cell), 3, 3))

    def design(groups: object) -> FloatArray:
        slope = np.asarray(groups.slope)  # type: ignore[attr-defined]
        return np.einsum("ra,rac->rc", np.column_stack([-slope, np.ones(len(slope))]), by)

    begin = 1 + 2 * seen.groups.window
    normal, right = relief_equations(seen, design, begin, 1, 7)
    dense, wanted = by_dense(seen, by[:, :2], begin)
    np.testing.assert_allclose(normal, dense, rtol=1e-9, atol=1e-9 * np.abs(dense).max())
    np.testing.assert_allclose(right, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    assert np.linalg.eigvalsh(normal)[0] > -1e-6 * np.abs(dense).max()


def by_dense(seen: SeenRelief, by: FloatArray, begin: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Normal matrix (7, 7) and right side, block after block."""
    normal = np.zeros((7, 7))
    right = np.zeros(7)
    at = 0
    for first, end in zip(seen.first[:-1], seen.first[1:], strict=True):
        size = 2 * (end - first)
        own = seen.normal[at : at + size**2].reshape(size, size)
        at += size**2
        moved = np.zeros((size, 7))
        for r in range(first, end):
            for axis in range(2):
                moved[2 * (r - first) + axis, 0] += by[r, axis, 0]
                moved[2 * (r - first) + axis, begin[r] : begin[r] + 2] += by[r, axis, 1:]
        normal += moved.T @ own @ moved
        right += moved.T @ seen.right[2 * first : 2 * end]
    return normal, right
