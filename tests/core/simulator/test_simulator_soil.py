"""The ground: its relief is as rough as stated, and changes where and when the tool passes."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import j0

from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, SimulatedTrack
from furrowmap.core.simulator.scenario import (
    SOILS,
    EarlierDrive,
    Scenario,
    ScenarioDrive,
    ScenarioField,
    ScenarioImplement,
    ScenarioSoil,
    as_toml,
    scenario_from,
)
from furrowmap.core.simulator.site import CELL_M
from furrowmap.core.simulator.soil_over_time import (
    FOOTPRINT_M,
    ToolSweep,
    earlier_sweeps,
    find_sweeps,
    ground_height,
    make_ground,
)

QUIET = {"slope_percent": 0.0, "undulation_m": 0.0, "row_amplitude_m": 0.0}


def scenario(soil: ScenarioSoil, size_m: float = 24.0, implement: ScenarioImplement | None = None) -> Scenario:
    return Scenario(
        field=ScenarioField(size_e_m=size_m, size_n_m=size_m),
        drive=ScenarioDrive(start_xy_m=(5.0, 5.0), lane_heading_deg=90.0),
        soil=soil,
        implement=implement or ScenarioImplement(),
    )


def straight(n_m: float, from_m: float, to_m: float, begin_s: float, yaw_rad: float = 0.0) -> ToolSweep:
    """A pass at 1 m/s along the direction `yaw_rad`, from (from_m, n_m)."""
    way = np.arange(0.0, to_m - from_m + 1e-9, 0.01)
    e, n = from_m + way * np.cos(yaw_rad), n_m + way * np.sin(yaw_rad)
    return ToolSweep(begin_s + way, e, n, np.full(len(way), yaw_rad), begin_s, begin_s + float(way[-1]))


def blurred_exponential(distance_m: float, corr_m: float) -> float:
    """exp(-distance / corr) in the plane as its spectrum tells it (a Hankel transform), blurred and cut at the cell."""
    w = np.linspace(0.0, np.pi / CELL_M, 20_001)
    power = (1.0 + (w * corr_m) ** 2) ** -1.5 * np.exp(-((w * FOOTPRINT_M) ** 2)) * w
    return float(np.trapezoid(power * j0(w * distance_m), w) / np.trapezoid(power, w))


def test_blurred_exponential__is_the_exponential_without_blur() -> None:
    assert blurred_exponential(0.60, 0.60) == pytest.approx(np.exp(-1.0), abs=0.03)


@pytest.mark.parametrize("kind", ["stubble", "ploughed", "tilled", "rolled"])
def test_make_ground__roughness_and_correlation_are_those_of_the_kind(kind: str) -> None:
    ground = make_ground(scenario(ScenarioSoil(kind=kind, **QUIET)), [])  # type: ignore[arg-type]
    relief = ground.before.astype(np.float64)
    sigma, corr = SOILS[kind]["sigma"], SOILS[kind]["corr"]
    assert relief.std() == pytest.approx(sigma, rel=0.01)
    lag = round(corr / CELL_M)
    likeness = np.mean(relief[:, lag:] * relief[:, :-lag]) / relief.var()
    assert likeness == pytest.approx(blurred_exponential(lag * CELL_M, corr), abs=0.03)


def test_make_ground__slopes_as_stated() -> None:
    ground = make_ground(scenario(ScenarioSoil(slope_percent=4.0, slope_towards_deg=60.0)), [])
    lower, upper = np.array([4.0, 4.0]), np.array([4.0 + 10.0 * np.sin(np.pi / 3), 4.0 + 10.0 * np.cos(np.pi / 3)])
    rise = (upper - lower) @ np.array([ground.slope_e, ground.slope_n])
    assert rise == pytest.approx(0.4)


def test_make_ground__rows_lie_along_the_lanes() -> None:
    soil = ScenarioSoil(slope_percent=0.0, undulation_m=0.0, clod_sigma_m=0.0, row_amplitude_m=0.02, row_spacing_m=0.4)
    relief = make_ground(scenario(soil), []).before
    assert np.abs(np.diff(relief, axis=1)).max() < 1e-6
    spectrum = np.abs(np.fft.rfft(relief[:, 0]))
    assert 1.0 / np.fft.rfftfreq(len(relief), CELL_M)[spectrum.argmax()] == pytest.approx(0.4, rel=0.02)
    assert relief.max() == pytest.approx(0.02, abs=1e-3)


def worked_area(first_s: NDArray[np.float32]) -> float:
    return float(np.isfinite(first_s).sum()) * CELL_M**2


@pytest.mark.parametrize("yaw_deg", [0.0, 17.0, 90.0, 135.0])
def test_make_ground__a_straight_pass_works_a_rectangle(yaw_deg: float) -> None:
    yaw = np.radians(yaw_deg)
    sweep = straight(11.0, 11.0, 19.0, 3.0, yaw)
    ground = make_ground(scenario(ScenarioSoil(), 24.0), [sweep])
    row, col = np.nonzero(np.isfinite(ground.first_s))
    e, n = (col + 0.5) * CELL_M - 11.0, (row + 0.5) * CELL_M - 11.0
    along, across = e * np.cos(yaw) + n * np.sin(yaw), n * np.cos(yaw) - e * np.sin(yaw)
    assert np.abs(across).max() <= 0.85
    assert along.min() >= -0.01
    assert along.max() <= 8.01
    assert worked_area(ground.first_s) == pytest.approx(8.0 * 1.7, rel=0.015)
    assert np.abs(ground.first_s[row, col] - (3.0 + along)).max() < 0.012
    assert (ground.first_s == ground.last_s).all()
    untouched = ~np.isfinite(ground.first_s)
    assert (ground.before == ground.after)[untouched].all()


def test_make_ground__swells_on_the_mean_and_ridges_at_the_borders() -> None:
    soil = ScenarioSoil(swell_m=0.03, ridge_m=0.04, clod_sigma_m=0.0, tilled_sigma_m=0.0, **QUIET)
    ground = make_ground(scenario(soil), [straight(12.0, 5.0, 19.0, 0.0)])
    change = (ground.after - ground.before)[np.isfinite(ground.first_s)]
    assert change.mean() == pytest.approx(0.03, abs=1e-3)
    profile = (ground.after - ground.before)[:, 480]
    assert profile[np.isfinite(ground.first_s[:, 480])][[0, -1]].min() > 0.05


def test_make_ground__the_worked_relief_is_new_in_every_pass() -> None:
    soil = ScenarioSoil(swell_m=0.0, ridge_m=0.0, **QUIET)
    once, twice = straight(12.0, 5.0, 19.0, 0.0), straight(12.0, 5.0, 19.0, 50.0)
    ground = make_ground(scenario(soil), [once, twice])
    worked = np.isfinite(ground.first_s)
    layers = [layer[worked].astype(np.float64) for layer in (ground.before, ground.middle, ground.after)]
    assert np.abs(np.corrcoef(layers) - np.eye(3)).max() < 0.1
    assert layers[2].std() == pytest.approx(soil_sigma := SOILS["tilled"]["sigma"], rel=0.1)
    assert layers[1].std() == pytest.approx(soil_sigma, rel=0.1)


def test_make_ground__furrows_of_a_plough() -> None:
    soil = ScenarioSoil(
        furrow_m=0.03, furrow_spacing_m=0.34, tilled_sigma_m=0.0, ridge_m=0.0, swell_m=0.0, clod_sigma_m=0.0, **QUIET
    )
    ground = make_ground(scenario(soil, implement=ScenarioImplement(shape="plow")), [straight(12.0, 5.0, 19.0, 0.0)])
    worked = np.isfinite(ground.first_s[:, 480])
    profile = ground.after[worked, 480]
    assert (profile.max(), profile.min()) == (pytest.approx(0.03, abs=2e-3), pytest.approx(-0.03, abs=2e-3))
    assert np.count_nonzero(np.diff(np.sign(profile)) > 0) == 5  # 1.70 m / 0.34 m


def test_make_ground__a_mower_leaves_the_ground() -> None:
    ground = make_ground(
        scenario(ScenarioSoil(), implement=ScenarioImplement(shape="mower")), [straight(12.0, 5.0, 19.0, 0.0)]
    )
    assert (ground.before == ground.after).all()
    assert np.isfinite(ground.first_s).any()


@pytest.mark.parametrize("speed_mps", [0.3, 1.2, 6.0])
def test_find_sweeps__leaves_no_gaps_at_any_speed(speed_mps: float) -> None:
    t_s = np.arange(0.0, 9.0 / speed_mps, 1.0 / DRIVE_RATE_HZ)
    n, zero = len(t_s), np.zeros(len(t_s))
    track = SimulatedTrack(
        t_s, 6.0 + speed_mps * t_s, zero + 12.0, zero, zero + speed_mps, zero, np.ones(n, bool), float(t_s[-1])
    )  # fmt: skip
    (sweep,) = find_sweeps(track, (-1.5, 0.2))
    assert (sweep.e_m[0], sweep.n_m[0]) == (pytest.approx(4.5), pytest.approx(12.2))
    length = float(sweep.e_m[-1] - sweep.e_m[0])
    assert length == pytest.approx(9.0, abs=2.0 * speed_mps / DRIVE_RATE_HZ)
    ground = make_ground(scenario(ScenarioSoil()), [sweep])
    assert worked_area(ground.first_s) == pytest.approx(length * 1.7, rel=0.015)


def test_ground_height__is_of_its_moment() -> None:
    soil = ScenarioSoil(swell_m=0.05, tilled_sigma_m=0.02)
    twice = [straight(12.0, 5.0, 19.0, 10.0), straight(12.4, 5.0, 19.0, 40.0)]
    ground = make_ground(scenario(soil), twice)
    rng = np.random.default_rng(2)
    row, col = rng.integers(450, 520, 200), rng.integers(300, 700, 200)
    e, n = (col + 0.5) * CELL_M, (row + 0.5) * CELL_M  # the middle of a cell: no neighbour counts
    plane = ground.slope_e * e + ground.slope_n * n
    first, last = ground.first_s[row, col].astype(float), ground.last_s[row, col].astype(float)
    for before_s, layer in ((first - 0.01, ground.before), (last - 0.01, ground.middle), (last + 0.01, ground.after)):
        use = np.isfinite(first) & ((first < last) | (layer is not ground.middle))
        assert use.any()
        found = ground_height(ground, e[use], n[use], before_s[use])
        assert np.abs(found - plane[use] - layer[row[use], col[use]]).max() < 1e-6


def test_ground_height__goes_on_beyond_the_edge() -> None:
    ground = make_ground(scenario(ScenarioSoil(slope_percent=2.0, slope_towards_deg=90.0), 8.0), [])
    inside = ground_height(ground, np.array([3.0]), np.array([2.0]), np.array([0.0]))
    beyond = ground_height(ground, np.array([3.0 + 8.0 * 10]), np.array([2.0]), np.array([0.0]))
    assert beyond - inside == pytest.approx(0.02 * 80.0, abs=1e-6)


def test_make_ground__a_later_drive_finds_what_an_earlier_one_left() -> None:
    first = msgspec.structs.replace(scenario(ScenarioSoil(seed=3)), seed=11)
    sweeps = earlier_sweeps(EarlierDrive(seed=11, drive=first.drive, soil=first.soil, implement=first.implement))
    left = make_ground(first, sweeps)
    done = EarlierDrive(seed=11, drive=first.drive, soil=first.soil, implement=first.implement)
    later = scenario_from(as_toml(msgspec.structs.replace(first, seed=12, earlier=(done,))), "later")
    found = make_ground(later, [])
    assert np.array_equal(found.before, left.after)
    assert np.array_equal(found.worked_earlier, np.isfinite(left.first_s))
    assert found.worked_earlier.any()
    other = make_ground(msgspec.structs.replace(first, seed=12), [])
    assert np.array_equal(other.before, left.before)  # errors and soil have seeds of their own
