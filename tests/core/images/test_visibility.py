"""Which places frames see: closed surfaces of few points, and what nothing is known of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.images.balance import MIN_OBSERVATIONS, balance_frames
from furrowmap.core.images.image_frames import FramePoses, Frames
from furrowmap.core.images.pinhole import project
from furrowmap.core.images.visibility import CELL_PX, SLACK_CELLS, Visibility, VisibilityMaker, widen_depth

from .scenes import CAMERA, HEIGHT_M

DOWN = np.diag([1.0, -1.0, -1.0])
ORIGIN_M = (0.0, 0.0, 0.0)


def above(*east_m: float) -> Frames:
    """Frames that look down from 6 m; there are no files."""
    n = len(east_m)
    centres = np.column_stack([east_m, np.zeros(n), np.full(n, HEIGHT_M)])
    poses = FramePoses(np.arange(float(n)), centres, np.repeat(DOWN[None], n, axis=0))
    return Frames((Path("a.png"),) * n, CAMERA, poses)


def ground(step_m: float) -> np.ndarray:
    axis = np.arange(-5.0, 5.0, step_m)
    x, y = np.meshgrid(axis, axis)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


@pytest.mark.parametrize("pooled", [1, 2, 4])
def test_closed__is_the_least_of_a_pooled_cell_and_its_neighbours(pooled: int) -> None:
    """Against a loop, for a map that the pooled cells do not divide."""
    rng = np.random.default_rng(pooled)
    depth = np.where(rng.random((11, 13)) < 0.2, rng.uniform(1.0, 9.0, (11, 13)), np.inf).astype(np.float32)
    found = widen_depth(depth, pooled)
    for row in range(11):
        for column in range(13):
            low, left = (max((at // pooled - 1) * pooled, 0) for at in (row, column))
            high, right = ((at // pooled + 2) * pooled for at in (row, column))
            assert found[row, column] == depth[low:high, left:right].min()


def test_surfaces_of_few_points__are_closed_with_wider_cells() -> None:
    seen = {}
    for step_m in (0.02, 0.4):
        maker = VisibilityMaker(above(0.0), ORIGIN_M)
        maker.add(ground(step_m))
        found = maker.finish()
        assert found.depth_m[0] == pytest.approx(np.full(found.depth_m[0].shape, HEIGHT_M))
        seen[step_m] = float(found.slack[0])
    assert seen[0.02] == pytest.approx(SLACK_CELLS * CELL_PX / CAMERA.fx)
    assert seen[0.4] / seen[0.02] in (4.0, 8.0, 16.0), "pooled by twos"


def test_places__are_seen_by_the_frames_above_them() -> None:
    """Frames 60 m apart share no ground; the index names for each cell those that see it."""
    frames = above(0.0, 60.0)
    maker = VisibilityMaker(frames, ORIGIN_M)
    maker.add(np.concatenate([ground(0.1), ground(0.1) + np.array([60.0, 0.0, 0.0]), [[0.0, 0.0, 7.0]]]))
    found = maker.finish()
    index = found.places
    for east_m, frames_there in ((0.5, [0]), (60.5, [1]), (30.0, [])):
        column, row = ((np.array([east_m, 0.5]) - index.corner_m) // index.cell_m).astype(int)
        cell = row * index.columns + column
        assert index.frames[index.start[cell] : index.start[cell + 1]].tolist() == frames_there
    assert found.depth_m.min() == pytest.approx(HEIGHT_M), "the point behind the camera is in no frame"
    assert index.start[-1] == len(index.frames)


def seen_by(found: Visibility, place_m: np.ndarray) -> list[int]:
    """The frames that the index names for a place."""
    index = found.places
    column, row = ((place_m[:2] - index.corner_m) // index.cell_m).astype(int)
    cell = row * index.columns + column
    return index.frames[index.start[cell] : index.start[cell + 1]].tolist()


def test_places__are_seen_by_frames_that_look_anywhere() -> None:
    """Against the camera's model, of frames turned any way about the vertical and up to upside down."""
    rng = np.random.default_rng(6)
    count = 150
    turned = Rotation.from_euler(
        "ZX", np.column_stack([rng.uniform(0, 360, count), rng.uniform(0, 180, count)]), degrees=True
    )
    centres = np.column_stack([rng.uniform(-12.0, 12.0, (count, 2)), rng.uniform(4.0, 9.0, count)])
    poses = FramePoses(np.arange(float(count)), centres, (turned * Rotation.from_matrix(DOWN)).as_matrix(), 0.9996)
    frames = Frames((Path("a.png"),) * count, CAMERA, poses)
    east, north = (axis.ravel() for axis in np.meshgrid(np.arange(-9.0, 10.0, 3.0), np.arange(-9.0, 10.0, 3.0)))
    places = np.column_stack([east + 0.0123, north + 0.0234, rng.uniform(0.0, 2.0, len(east))])
    maker = VisibilityMaker(frames, ORIGIN_M)
    maker.add(places)
    found = maker.finish()
    local = np.stack([poses.in_frame(k, places) for k in range(count)])
    pixel = np.nan_to_num(np.stack([project(CAMERA, one) for one in local]), nan=-9.0) + 0.5
    shown = ((pixel >= 0.0) & (pixel < [CAMERA.width, CAMERA.height])).all(axis=2) & (local[:, :, 2] > 0.2)
    for k, place in enumerate(places):
        assert seen_by(found, place) == np.flatnonzero(shown[:, k]).tolist()
    nearest = np.where(shown, local[:, :, 2], np.inf).min(axis=1)
    np.testing.assert_allclose(found.depth_m.min(axis=(1, 2)), nearest, rtol=1e-5)
    assert 100 < shown.sum() < 0.5 * shown.size


@pytest.mark.parametrize(("below_m", "seen"), [(0.19, False), (0.21, True), (149.0, True), (151.0, False)])
def test_points__are_seen_from_20_cm_to_150_m(below_m: float, seen: bool) -> None:
    place = np.array([0.0, 0.0, HEIGHT_M - below_m])
    maker = VisibilityMaker(above(0.0), ORIGIN_M)
    maker.add(place[None])
    found = maker.finish()
    assert seen_by(found, place) == [0] * seen
    assert found.depth_m.min() == (pytest.approx(below_m, rel=1e-6) if seen else np.inf)


def test_without_points__nothing_is_hidden_and_nothing_seen() -> None:
    found = VisibilityMaker(above(0.0), ORIGIN_M).finish()
    assert np.isinf(found.depth_m).all()
    assert len(found.places.frames) == 0


def test_selected_frames__keep_their_poses() -> None:
    frames = above(0.0, 1.0, 2.0)
    frames = replace(frames, paths=(Path("a"), Path("b"), Path("c")))
    for which in ([0, 2], np.array([True, False, True])):
        some = frames.selected(which)
        assert some.paths == (Path("a"), Path("c"))
        assert some.poses.xyz_m[:, 0].tolist() == [0.0, 2.0]
        assert some.poses.t_s.tolist() == [0.0, 2.0]


def views(points: int) -> tuple[np.ndarray, ...]:
    """Each point seen by two frames, the second of which is brighter by a fifth."""
    rng = np.random.default_rng(1)
    point = np.repeat(np.arange(points, dtype=np.int32), 2)
    frame = np.tile(np.array([0, 1], np.int32), points)
    levels = np.repeat(rng.uniform(40.0, 150.0, (points, 3)), 2, axis=0) * np.where(frame, 1.2, 1.0)[:, None]
    return point, frame, rng.uniform(0.0, 1.0, 2 * points), levels


def test_balance__of_too_few_views_is_none() -> None:
    point, frame, radius, levels = views(MIN_OBSERVATIONS // 2)
    known = balance_frames(2, point, frame, radius, levels).gain
    assert known[1] - known[0] == pytest.approx(np.full(3, np.log(1.2)), abs=0.01)
    few = balance_frames(2, point[2:], frame[2:], radius[2:], levels[2:])
    assert not few.gain.any()
    assert few.corner == 0.0
    for cut_off in (3.0, 252.0):  # levels that are mostly noise or saturated do not count
        spoiled = levels.copy()
        spoiled[0] = cut_off
        assert not balance_frames(2, point, frame, radius, spoiled).gain.any()
    alone = point.copy()
    alone[-1] += 1  # seen once
    assert not balance_frames(2, alone, frame, radius, levels).gain.any()
