"""Lines in voxels whose course is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.features.lines import DetectedLine, find_lines


def length_m(line: DetectedLine) -> float:
    return float(np.linalg.norm(np.diff(line.path_m, axis=0), axis=1).sum())


@pytest.mark.parametrize(
    "along", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.6, 0.0, 0.8), (0.0, -0.8, 0.6)]
)
def test_a_line__takes_what_lies_on_its_axis_and_no_more(along: tuple[float, float, float]) -> None:
    """Where another line crosses, a voxel has no direction of its own; it belongs to the line whose axis it is on."""
    s = np.arange(0.0, 6.0, 0.1)
    axis = np.array(along)
    beside = np.cross(axis, [0.36, 0.48, 0.8])
    beside /= np.linalg.norm(beside)
    crossing = np.abs(s - 3.0) < 0.15
    off = 3.0 * axis + 0.22 * beside
    xyz = np.concatenate([s[:, None] * axis, [off]])
    linearity = np.append(np.where(crossing, 0.2, 0.95), 0.2)
    direction = np.tile(axis, (len(xyz), 1))
    direction[: len(s)][crossing] = beside
    found = find_lines(xyz, linearity, direction, 0.1, 0.04)
    assert len(found) == 1
    assert sorted(found[0].members.tolist()) == list(range(len(s)))
    assert np.abs(found[0].direction @ axis) == pytest.approx(1.0, abs=1e-6)
    assert length_m(found[0]) == pytest.approx(5.9, abs=0.01)
    assert found[0].upright == (along == (0.0, 0.0, 1.0))


@pytest.mark.parametrize("seed", range(3))
def test_crossing_lines__are_two_in_any_direction(seed: int) -> None:
    turn = Rotation.random(random_state=seed)
    s = np.arange(-3.0, 3.0, 0.1) + 0.05
    axes = turn.apply(np.eye(3)[:2])
    xyz = np.concatenate([s[:, None] * axes[0], s[:, None] * axes[1]])
    direction = np.repeat(axes, len(s), axis=0)
    linearity = np.where(np.abs(np.tile(s, 2)) < 0.2, 0.3, 0.95)
    found = find_lines(xyz, linearity, direction, 0.1, 0.04)
    assert len(found) == 2
    shares = sorted(np.abs(np.array([one.direction for one in found]) @ axes.T).max(axis=1))
    assert shares[0] > 1.0 - 1e-3
    for one in found:
        own = int(np.argmax(np.abs(axes @ one.direction)))
        away = xyz[one.members] - np.outer(xyz[one.members] @ axes[own], axes[own])
        assert np.linalg.norm(away, axis=1).max() <= 0.12
        assert length_m(one) == pytest.approx(5.9, abs=0.2)


@pytest.mark.parametrize("slope", [0.32, 0.45, 0.58, 0.7])
@pytest.mark.parametrize("seed", range(4))
def test_directions__of_lines_that_are_not_level_point_upwards(slope: float, seed: int) -> None:
    turn = Rotation.from_euler("z", 90.0 * seed + 20.0, degrees=True)
    axis = turn.apply([np.sqrt(1.0 - slope**2), 0.0, slope])
    xyz = np.arange(-3.0, 3.0, 0.1)[:, None] * axis
    (found,) = find_lines(xyz, np.full(len(xyz), 0.95), np.tile(axis, (len(xyz), 1)), 0.1, 0.04)
    assert found.direction == pytest.approx(axis, abs=1e-6)


@pytest.mark.parametrize(("slope", "seed"), [(0.0, 0), (0.25, 1), (-0.25, 2), (0.28, 3)])
def test_directions__of_lines_that_are_nearly_level_point_to_the_east(slope: float, seed: int) -> None:
    turn = Rotation.from_euler("z", 90.0 * seed + 20.0, degrees=True)
    axis = turn.apply([np.sqrt(1.0 - slope**2), 0.0, slope])
    xyz = np.arange(-3.0, 3.0, 0.1)[:, None] * axis
    (found,) = find_lines(xyz, np.full(len(xyz), 0.95), np.tile(axis, (len(xyz), 1)), 0.1, 0.04)
    assert found.direction == pytest.approx(axis if axis[0] > 0.0 else -axis, abs=1e-6)
