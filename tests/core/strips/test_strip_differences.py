"""Two strips over the same plane: what sets them apart comes out, by cells and pairs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.strips.boresight import held_against_strips, positions_creep_mps
from furrowmap.core.strips.strip_differences import strip_differences
from furrowmap.core.strips.strips import StripReturns
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import trajectory_from_attitude

HEIGHT_M = 10.0
LIFT_M = 0.02
ROLL_DEG = 0.5
MOST = 1_000


@dataclass(frozen=True)
class Span:
    begin_s: float
    end_s: float


STRIPS = [Span(0.0, 10.0), Span(20.0, 30.0)]


def two_strips(
    wide_m: float, long_m: float, returns: int, *, waves_m: float = 0.0, creep_mps: tuple[float, float] = (0.0, 0.0)
) -> StripReturns:
    """Strips along y, there and back, over level ground or waves; the second one believes itself LIFT_M too high."""
    random = np.random.default_rng(0)
    parts: list[dict[str, NDArray[np.float64]]] = []
    for strip, lift in zip(STRIPS, (0.0, LIFT_M), strict=True):
        n = returns // 2
        t = np.sort(random.uniform(strip.begin_s, strip.end_s, n))
        forth = strip.begin_s == 0.0
        y = (t - strip.begin_s) / 10.0 * long_m * (1.0 if forth else -1.0) + (0.0 if forth else long_m)
        turned = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)] if forth else [np.sqrt(0.5), 0.0, 0.0, -np.sqrt(0.5)]
        left = random.uniform(-wide_m, wide_m, n)
        ground_m = waves_m * (np.sin(1.7 * (-left if forth else left)) + np.sin(1.3 * y))
        sensor = np.column_stack([np.zeros(n), left, ground_m - HEIGHT_M + random.normal(0.0, 0.002, n)])
        parts.append(
            {
                "t_s": t,
                "sensor_m": sensor,
                "origin_m": np.column_stack([creep_mps[0] * t, y + creep_mps[1] * t, np.full(n, HEIGHT_M + lift)]),
                "rotation": np.tile(turned, (n, 1)),
            }
        )
    times = np.concatenate([part.pop("t_s") for part in parts])
    joined = {name: np.concatenate([part[name] for part in parts]).astype(np.float32) for name in parts[0]}
    nothing = np.zeros((len(times), 3), np.float32)
    return StripReturns(
        times,
        **joined,
        laser=np.zeros(len(nothing), np.int64),
        velocity_mps=nothing,
        rate_radps=nothing,
        local_m=np.zeros(3),
    )


def test_differences__are_the_lift_after_and_the_roll_before() -> None:
    returns = two_strips(5.0, 20.0, 200_000)
    stated, used = Mounting((0.0, 0.0, 0.0), (ROLL_DEG, 0.0, 0.0)), Mounting()
    found = strip_differences(returns, STRIPS, stated, used)
    assert found is not None
    assert found.pairs == [(1, 2)]
    assert len(found) * found.cell_m**2 == pytest.approx(200.0, rel=0.1)
    assert np.median(found.after_m) == pytest.approx(LIFT_M, abs=2e-4)
    assert np.std((found.after_m - LIFT_M) / found.sigma_m) == pytest.approx(1.0, abs=0.2)
    # A roll raises the left of each strip by its distance; flown back, left is the other side.
    x = found.centre_m[:, 0]
    expected = LIFT_M + 2.0 * np.tan(np.radians(ROLL_DEG)) * x
    known = np.isfinite(found.before_m)
    assert known.mean() > 0.9
    # The height of a cell is that of the plane in its middle; at the edge of a strip the returns are on one side.
    assert np.quantile(np.abs(found.before_m[known] - expected[known]), 0.95) < 0.004
    before, after = found.figures()
    assert before is not None
    assert after is not None
    assert before.rms_m > 2.0 * after.rms_m
    (row,) = found.plain()["pairs"]
    assert row["after_mean_m"] == pytest.approx(LIFT_M, abs=3e-4)


def test_many_cells__are_joined_with_the_same_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("furrowmap.core.strips.strip_differences.MAX_DIFFERENCES", MOST)
    found = strip_differences(two_strips(5.0, 20.0, 200_000), STRIPS, Mounting(), Mounting())
    assert found is not None
    assert found.cell_m == 0.5
    assert 0.5 * MOST < len(found) <= MOST
    assert np.mean(found.after_m) == pytest.approx(LIFT_M, abs=2e-4)


def test_one_strip__has_no_differences() -> None:
    assert strip_differences(two_strips(5.0, 20.0, 20_000), STRIPS[:1], Mounting(), Mounting()) is None


@pytest.mark.parametrize(
    ("waves_m", "creep_mps", "shown"),
    [(0.02, (0.01, -0.006), True), (0.02, (0.0, 0.0), False), (0.0, (0.01, -0.006), False)],
)
def test_positions_that_creep__show_on_ground_that_is_not_level(
    waves_m: float, creep_mps: tuple[float, float], shown: bool
) -> None:
    returns = two_strips(5.0, 20.0, 200_000, waves_m=waves_m, creep_mps=creep_mps)
    found_mps = positions_creep_mps(returns, STRIPS, Mounting())
    assert found_mps == pytest.approx(creep_mps if shown else (0.0, 0.0), abs=3e-4)
    t_s = np.array([0.0, 30.0])
    stated = replace(
        trajectory_from_attitude(t_s, np.zeros((2, 3)), 0.0, 0.0, 0.0, max_gap_s=60.0), sigma=np.full((2, 6), 0.005)
    )
    doubted, notice = held_against_strips(stated, returns, STRIPS, Mounting())
    assert (notice is not None and notice.key == "contradiction.creep") == shown
    # Over 30 s, from a begin at which they were right.
    expected_m = np.hypot(0.005, np.abs(creep_mps) * 30.0 / np.sqrt(3.0)) if shown else 0.005
    assert doubted.sigma[:, :2] == pytest.approx(np.broadcast_to(expected_m, (2, 2)), rel=0.1)
    # Positions of a metre may creep so far.
    loose = replace(stated, sigma=np.ones((2, 6)))
    assert held_against_strips(loose, returns, STRIPS, Mounting())[1] is None
