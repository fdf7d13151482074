"""The stated sigma of areas, against closed forms and against areas of many disturbed drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from furrowmap.core.coverage.worked_ground import AreaFigure, WorkedGround, worked_ground
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import Trajectory
from tests.core.implement.drives_with_tool import FRAME, Sample, disturbed, sample, states_of, thinned, trajectory_of
from tests.core.trajectory.drives import drive

TILLER = Implement(width_m=1.7, xy_m=(0.0, 0.0))
STRAIGHT = drive((40.0, 1.2, 0.0), yaw_deg=20.0)
EXACT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def ground_of(trajectory: Trajectory, sigma_s: float, *down_s: tuple[float, float]) -> WorkedGround:
    return worked_ground(trajectory, states_of(trajectory, *down_s, sigma_s=sigma_s), TILLER, FRAME)


def test_times_of_transitions__move_the_flat_ends() -> None:
    ground = ground_of(trajectory_of(STRAIGHT, EXACT), 0.1, (5.0, 35.0))
    expected = 1.7 * 1.2 * 0.1 * np.sqrt(2.0)
    assert ground.passes[0].area.sigma_m2 == pytest.approx(expected, rel=1e-3)
    assert ground.figures.worked.sigma_m2 == pytest.approx(expected, rel=1e-3)


def test_tool_lowered_at_a_stand__has_no_error_from_when() -> None:
    truth = drive((5.0, 0.0, 0.0), (30.0, 1.2, 0.0), (5.0, 0.0, 0.0))
    ground = ground_of(trajectory_of(truth, EXACT), 0.1, (3.0, 37.0))
    assert ground.passes[0].area.sigma_m2 == pytest.approx(0.0, abs=1e-3)


def test_positions__change_a_passes_area_only_by_how_its_ends_differ() -> None:
    ground = ground_of(trajectory_of(STRAIGHT, (0.03, 0.03, 0.0, 0.0, 0.0, 0.0)), 0.0, (5.0, 35.0))
    expected = 1.7 * 0.03 * np.sqrt(2.0 * (1.0 - np.exp(-30.0 / 60.0)))
    assert ground.passes[0].area.sigma_m2 == pytest.approx(expected, rel=0.01)


def test_overlap__is_uncertain_by_how_two_lanes_differ_and_so_is_the_union() -> None:
    """Two lanes in opposite directions, minutes after each other: their errors are as good as independent."""
    truth = drive((30.0, 1.2, 0.0), (600.0, 0.0, 0.0), (13.0, 0.4, 15.0), (30.0, 1.2, 0.0))
    trajectory = trajectory_of(truth, (0.03, 0.03, 0.0, 0.0, 0.0, 0.0))
    tool = Implement(width_m=4.0, xy_m=(0.0, 0.0))
    states = states_of(trajectory, (3.0, 27.0), (646.0, 670.0))
    ground = worked_ground(trajectory, states, tool, FRAME)
    (overlap,) = ground.overlaps
    length_m = ground.passes[0].length_m - 1.0  # nearly all of it
    along = np.linspace(0.0, 24.0, 500)
    kept = np.sqrt(np.exp(-np.abs(along[:, None] - along) / 60.0).mean())  # mean of one lane's error against its sigma
    assert overlap.area.sigma_m2 == pytest.approx(length_m * 0.03 * np.sqrt(2.0) * kept, rel=0.1)
    assert ground.figures.worked.sigma_m2 == pytest.approx(overlap.area.sigma_m2, rel=0.1)


@pytest.mark.parametrize("times_known", [False, True])
def test_unknown_sigma__leaves_the_areas_unknown(times_known: bool) -> None:
    trajectory = trajectory_of(STRAIGHT, EXACT if not times_known else None)
    ground = ground_of(trajectory, 0.1 if times_known else np.nan, (5.0, 35.0))
    assert np.isnan(ground.passes[0].area.sigma_m2)
    assert np.isnan(ground.figures.worked.sigma_m2)
    assert np.isfinite(ground.figures.worked.grid_m2)


def gauss_markov(rng: np.random.Generator, count: int, step_s: float, correlation_s: float) -> NDArray[np.float64]:
    kept = np.exp(-step_s / correlation_s)
    noise = rng.normal(0.0, np.sqrt(1.0 - kept**2), count)
    noise[0] = rng.normal()
    return lfilter([1.0], [1.0, -kept], noise)


def later(states: ToolStates, by_s: NDArray[np.float64], sigma_s: float) -> ToolStates:
    """The transitions moved by `by_s`."""
    ends, sigma = np.concatenate([[0.0], by_s, [0.0]]), np.array([0.0, *[sigma_s] * len(by_s), 0.0])
    return replace(
        states,
        begin_s=states.begin_s + ends[:-1],
        end_s=states.end_s + ends[1:],
        begin_sigma_s=sigma[:-1],
        end_sigma_s=sigma[1:],
    )


@pytest.mark.parametrize("name", ["tractor_loop", "tractor_fishtail"])
@pytest.mark.parametrize(
    ("position_m", "heading_deg", "time_s"), [(0.02, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.08), (0.02, 0.3, 0.08)]
)
def test_sample__errors_of_many_drives_are_as_large_as_their_sigma(
    shared_data: Path, name: str, position_m: float, heading_deg: float, time_s: float
) -> None:
    truth: Sample = sample(shared_data / name)
    path = thinned(truth.trajectory, 10)

    def areas(ground: WorkedGround) -> list[AreaFigure]:
        return [ground.figures.worked, ground.figures.overlap, *(p.area for p in ground.passes)]

    tool = truth.session.implement
    true = np.array([a.grid_m2 for a in areas(worked_ground(path, truth.states, tool, truth.frame))])
    errors, sigmas = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        en = position_m * np.column_stack([gauss_markov(rng, len(path), 0.1, 60.0) for _ in range(2)])
        heading = heading_deg * gauss_markov(rng, len(path), 0.1, 3.0)
        said = (position_m, position_m, 0.0, 0.0, 0.0, heading_deg)
        states = later(truth.states, rng.normal(0.0, time_s, len(truth.states) - 1), time_s)
        found = areas(worked_ground(disturbed(path, en, heading, said), states, tool, truth.frame))
        errors.append([a.grid_m2 for a in found] - true)
        sigmas.append([a.sigma_m2 for a in found])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(sigmas), axis=0))
    felt = np.mean(sigmas, axis=0) > 0.005  # less than 50 cm² is beside the point
    assert np.all(ratio[felt] > 0.7)
    assert np.all(ratio[felt] < 1.4)
    assert np.all(np.abs(np.mean(errors, axis=0)) < 0.002 * true + 0.5 * np.mean(sigmas, axis=0))
