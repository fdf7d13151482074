"""Eigenfeatures against jakteristics and against shapes whose eigenvalues are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.features.classification import voxels
from furrowmap.core.features.eigenfeatures import Eigenfeatures, neighbourhoods

FloatArray = NDArray[np.float64]


def eigenfeatures(xyz_m: FloatArray, radius_m: float) -> Eigenfeatures:
    """Of the points within a radius of each point."""
    (found,) = neighbourhoods(xyz_m, xyz_m, (radius_m,))
    return found


def sphericity(found: Eigenfeatures) -> NDArray[np.float32]:
    out: NDArray[np.float32] = found.eigenvalue_m2[:, 2] / found.eigenvalue_m2[:, 0]
    return out


def test_eigenfeatures__are_those_of_jakteristics() -> None:
    jakteristics = pytest.importorskip("jakteristics")
    rng = np.random.default_rng(1)
    xyz = np.concatenate([rng.uniform(0.0, 3.0, (3000, 3)), rng.uniform(0.0, 3.0, (3000, 3)) * [1.0, 1.0, 0.01]])
    names = ["linearity", "planarity", "sphericity", "verticality", "nx", "ny", "nz", "number_of_neighbors"]
    theirs = jakteristics.compute_features(xyz, 0.3, num_threads=1, feature_names=names)
    ours = eigenfeatures(xyz, 0.3)
    np.testing.assert_array_equal(ours.count, theirs[:, 7])
    told = ours.count >= 4
    shapes = (ours.linearity, ours.planarity, sphericity(ours), 1.0 - np.abs(ours.normal[:, 2]))
    for k, shape in enumerate(shapes):
        np.testing.assert_allclose(shape[told], theirs[told, k], atol=1e-4)
    alike = np.abs(np.sum(ours.normal * theirs[:, 4:7], axis=1))
    apart = told & (ours.eigenvalue_m2[:, 1] > 1.05 * ours.eigenvalue_m2[:, 2])
    assert alike[apart].min() > 0.999


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.0, 1.0, 1e5]))
def test_eigenfeatures__of_a_line_and_a_plane_in_any_direction(seed: int, far_m: float) -> None:
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed)
    flat = np.column_stack([rng.uniform(-1.0, 1.0, (200, 2)), np.zeros(200)])
    plane = eigenfeatures(turn.apply(flat) + far_m, 4.0)
    across = turn.apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(np.abs(plane.normal @ across), 1.0, atol=1e-6)
    assert sphericity(plane).max() < 1e-6
    line = eigenfeatures(turn.apply(flat * [1.0, 0.0, 0.0]) + far_m, 4.0)
    np.testing.assert_allclose(np.abs(line.direction @ turn.apply([1.0, 0.0, 0.0])), 1.0, atol=1e-6)
    assert line.linearity.min() > 1.0 - 1e-6
    np.testing.assert_allclose(np.sum(line.normal * line.direction, axis=1), 0.0, atol=1e-4)
    assert (plane.normal[:, 2] >= 0.0).all()


def test_eigenfeatures__of_points_alone_or_in_one_place_are_unknown() -> None:
    xyz = np.random.default_rng(2).uniform(0.0, 1.0, (50, 3))
    with_gaps = np.concatenate([xyz, [[90.0, 0.0, 0.0]]])
    whole, gaps = eigenfeatures(xyz, 0.5), eigenfeatures(with_gaps, 0.5)
    np.testing.assert_array_equal(whole.eigenvalue_m2, gaps.eigenvalue_m2[:50])
    assert gaps.count[50:].tolist() == [1]
    assert np.isnan(gaps.linearity[50:]).all()
    assert len(eigenfeatures(np.zeros((0, 3)), 0.5).count) == 0
    same = eigenfeatures(np.zeros((5, 3)), 0.5)
    assert same.count.tolist() == [5] * 5
    assert np.isnan(same.eigenvalue_m2).all()


def test_eigenfeatures__of_a_cube_have_no_direction() -> None:
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    found = eigenfeatures(corners, 3.0)
    np.testing.assert_allclose(sphericity(found), 1.0)
    np.testing.assert_allclose(found.eigenvalue_m2, 0.25)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.05, 3.0), st.sampled_from([0.0, -4e5]))
def test_voxels__hold_each_point_once_with_the_mean_of_their_points(seed: int, cell_m: float, far_m: float) -> None:
    xyz = np.random.default_rng(seed).normal(far_m, 3.0, (500, 3))
    found = voxels(xyz, cell_m)
    cell = np.floor(xyz / cell_m)
    there, number = np.unique(cell, axis=0, return_inverse=True)
    assert len(found) == len(there)
    assert len({*zip(found.of_point.tolist(), number.ravel().tolist(), strict=True)}) == len(there)
    np.testing.assert_array_equal(found.count, np.bincount(found.of_point))
    for k in range(3):
        np.testing.assert_allclose(found.mean_of(xyz[:, k]), found.mean_m[:, k], atol=1e-9 + 1e-15 * abs(far_m))


def test_voxels__refuse_what_cannot_be() -> None:
    assert len(voxels(np.zeros((0, 3)), 0.1)) == 0
    with pytest.raises(ValueError, match="voxels of 0"):
        voxels(np.zeros((1, 3)), 0.0)
    with pytest.raises(ValueError, match="too many voxels"):
        voxels(np.array([[0.0, 0.0, 0.0], [1e9, 1e9, 1e9]]), 0.05)
