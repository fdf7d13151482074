"""Control points that contradict the poses or each other: those that agree are kept, the others take no part."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.images.block_adjustment import AdjustedBlock, adjust_block, adjusted_poses, place_by_images
from furrowmap.core.images.control_agreement import agreement_of
from furrowmap.core.images.control_points import ControlPoints
from furrowmap.core.images.image_aiding import ControlledBlock, with_control
from furrowmap.core.images.image_frames import frame_poses
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.images import Images
from tests.core.images.test_block_adjustment import NOISE_PX, SCALE, T_S, Flight, true_camera

FloatArray = NDArray[np.float64]

SURVEY_M = 0.005
PATHS = [Path(f"{k}.jpg") for k in range(len(T_S))]


@cache
def flown(seed: int) -> tuple[Flight, AdjustedBlock]:
    """A flight whose positions err by 0.3 m together, adjusted without control points."""
    flight = Flight(seed)
    return flight, adjust_block(flight.block, flight.ties)


def surveyed(seed: int, points: int = 5) -> ControlPoints:
    """Points that many images show, with the noise of a survey."""
    flight, _ = flown(seed)
    rng = np.random.default_rng(seed)
    most_seen = np.argsort(-np.bincount(flight.ties.point))[:40]
    chosen = np.sort(rng.choice(most_seen, points, replace=False))
    seen = [
        (PATHS[flight.ties.frame[k]].name, number, *flight.ties.pixel[k].tolist())
        for number, point in enumerate(chosen.tolist())
        for k in np.flatnonzero(flight.ties.point == point).tolist()
    ]
    xyz_m = flight.soil[chosen] + rng.normal(0.0, SURVEY_M, (points, 3))
    return ControlPoints(tuple("ABCDE"[:points]), xyz_m, np.full((points, 3), SURVEY_M), tuple(seen))


def moved(control: ControlPoints, by_m: dict[int, tuple[float, float, float]]) -> ControlPoints:
    xyz_m = control.xyz_m.copy()
    for number, off_m in by_m.items():
        xyz_m[number] += off_m
    return replace(control, xyz_m=xyz_m)


def controlled(seed: int, control: ControlPoints) -> tuple[ControlledBlock, tuple[Notice, ...]]:
    flight, adjusted = flown(seed)
    block = with_control(flight.block, adjusted, control, Images.sorted(PATHS, T_S))
    return block, block.notices


def error_m(seed: int, block: ControlledBlock) -> float:
    """Mean error of the camera's places."""
    flight, _ = flown(seed)
    truth = frame_poses(flight.truth, true_camera(), T_S, SCALE).xyz_m
    return float(np.linalg.norm((adjusted_poses(flight.block, block.adjusted).xyz_m - truth).mean(axis=0)))


def test_places_that_images_show__scatter_as_their_covariance_says() -> None:
    squares = []
    for seed in range(1, 5):
        flight = flown(seed)[0]
        chosen = np.isin(flight.ties.point, np.argsort(-np.bincount(flight.ties.point))[:5])
        views = flight.ties.chosen(chosen)
        views = replace(views, sigma_px=np.full(len(views), NOISE_PX))
        adjusted = adjust_block(flight.block, flight.ties.chosen(~chosen))
        places_m, covariance = place_by_images(flight.block, adjusted, views)
        off_m = (places_m - flight.soil[np.unique(flight.ties.point[chosen])]).ravel()
        squares.append(off_m @ np.linalg.solve(covariance, off_m))
    assert np.mean(squares) == pytest.approx(15.0, rel=0.4)


@pytest.mark.parametrize("seed", range(1, 7))
def test_right_points__all_take_part(seed: int) -> None:
    block, notices = controlled(seed, surveyed(seed))
    assert notices == ()
    assert (block.known.name, block.left_out) == (tuple("ABCDE"), ())
    assert error_m(seed, block) < 0.02


@pytest.mark.parametrize(
    ("by_m", "wrong"),
    [
        ({0: (0.0, 0.0, 0.3), 1: (0.0, 0.0, -0.3)}, "AB"),
        ({2: (0.0, 0.0, 0.1)}, "C"),
        ({3: (0.12, 0.0, 0.0)}, "D"),
        ({4: (0.0, 250_000.0, -36.0)}, "E"),
        ({1: (0.0, 0.15, 0.0), 2: (0.0, 0.15, 0.0)}, "BC"),
    ],
)
def test_points_that_contradict_the_others__are_named_and_take_no_part(
    by_m: dict[int, tuple[float, float, float]], wrong: str
) -> None:
    block, (notice,) = controlled(1, moved(surveyed(1), by_m))
    assert notice.code == "control-points-off"
    assert f"{len(wrong)} of 5 control points" in notice.text
    assert {one.name for one in block.left_out} == set(wrong)
    assert not set(wrong) & set(block.known.name)
    for one in block.left_out:
        assert one.off_m == pytest.approx(-np.array(by_m["ABCDE".index(one.name)]), abs=0.03)
    assert error_m(1, block) < 0.02


def test_points_of_another_datum__do_not_move_the_block() -> None:
    shift_m = (3.0, -2.0, 40.0)
    block, (notice,) = controlled(1, moved(surveyed(1), dict.fromkeys(range(5), shift_m)))
    assert (notice.key, block.known.name) == ("control-points-contradict.all-shifted", ())
    assert "5 of 5 control points" in notice.text
    assert block.control_shift_m == pytest.approx(shift_m, abs=1.0)
    assert block.adjusted is flown(1)[1]
    alone, (notice,) = controlled(1, moved(surveyed(1, points=1), {0: shift_m}))
    assert (notice.key, alone.known.name) == ("control-points-contradict.all-shifted", ())


@pytest.mark.parametrize("points", [2, 3])
def test_where_nobody_can_tell_which_point_is_right__none_takes_part(points: int) -> None:
    by_m = {k: (0.0, 0.0, 0.2 * k) for k in range(points)}
    block, (notice,) = controlled(1, moved(surveyed(1, points), by_m))
    assert notice.key == "control-points-contradict"
    assert all(name in notice.text for name in "ABC"[:points])
    assert (block.known.name, block.control_shift_m) == ((), None)


def test_many_contradictions__are_named_in_part() -> None:
    off_m = np.zeros((20, 3))
    off_m[:8, 2] = np.arange(1.0, 9.0)
    found = agreement_of(off_m, 1e-4 * np.eye(60))
    assert found.kept.tolist() == [False] * 8 + [True] * 12
    assert found.off_m == pytest.approx(off_m)


def test_a_point_that_images_should_show__is_named_if_they_do_not() -> None:
    control = surveyed(1)
    unseen = replace(control, seen=tuple(one for one in control.seen if one[1] != 2))
    block, (notice,) = controlled(1, unseen)
    assert (notice.key, block.known.name) == ("control-points-unseen.no-plate", tuple("ABDE"))
    assert "control points C have" in notice.text
