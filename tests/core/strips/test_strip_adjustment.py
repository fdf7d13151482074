"""Strips over rolling ground whose poses have a slow error: the ground takes it out, as far as its sigmas say."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.strips.boresight import boresight
from furrowmap.core.strips.strip_adjustment import StripAdjustment, adjust_strips
from furrowmap.core.strips.strips import strip_returns
from furrowmap.core.trajectory.pose_errors import PoseErrors, without_errors
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import Trajectory
from tests.core.strips.test_boresight import LINE_S, T0, Scene, flown

FloatArray = NDArray[np.float64]

STATED = Mounting((0.1, 0.02, -0.3), (-90.0, 34.0, -90.0))
TURNED = Rotation.from_euler("ZYX", [0.4, -0.3, 0.3], degrees=True).as_matrix()
Flown: TypeAlias = tuple[Scene, Trajectory, Trajectory, StripAdjustment]
SLOW_S = 10.0
SIGMA = np.array([0.02, 0.02, 0.03, *np.radians([0.01, 0.01, 0.1])])
"""Of the slow error: more than that of RTK, in a flight that is shorter than it lasts."""


def slow_errors(seed: int) -> PoseErrors:
    """A Gauss-Markov process of each axis at nodes a second apart: what it is, and its covariance."""
    t_s = T0 + np.arange(0.0, 4 * LINE_S + 0.5, 1.0)
    alike = np.exp(-np.abs(t_s[:, None] - t_s) / SLOW_S)
    covariance = np.einsum("ij,a,ab->iajb", alike, SIGMA**2, np.eye(6)).reshape(6 * len(t_s), -1)
    # By the Cholesky factor, which is unique: singular vectors, and with them the errors, differ by processor.
    drawn = np.random.default_rng(seed).multivariate_normal(np.zeros(len(covariance)), covariance, method="cholesky")
    value = drawn.reshape(-1, 6)
    return PoseErrors(t_s, value, covariance)


def left_over(true: Trajectory, found: Trajectory) -> FloatArray:
    """(n, 6) position and rotation vector in the map's axes: found minus true."""
    turn = (
        Rotation.from_quat(found.quaternion, scalar_first=True)
        * Rotation.from_quat(true.quaternion, scalar_first=True).inv()
    )
    return np.column_stack([found.xyz_m - true.xyz_m, turn.as_rotvec()])


def flight(seed: int) -> Flown:
    """The scene, the true poses, those with errors, and what the strips make of these."""
    scene = Scene(Mounting.from_rotation(STATED.xyz_m, TURNED @ STATED.rotation), seed=seed)
    true, slow = flown(), slow_errors(seed)
    # Errors are taken off: poses with errors are those without their negative.
    off = without_errors(true, slow, replace(slow, value=-slow.value))
    off = replace(off, sigma=np.tile(SIGMA * np.where(np.arange(6) < 3, 1.0, 180.0 / np.pi), (len(off), 1)))
    returns = strip_returns(scene.scans(true), off)
    found = boresight(returns, off, STATED)
    assert found is not None
    known = replace(slow, value=np.zeros_like(slow.value))
    return scene, true, off, adjust_strips(returns, off, known, found, STATED)


@pytest.fixture(scope="module")
def flown_once() -> Flown:
    return flight(1)


def test_poses__agree_between_strips_afterwards(
    flown_once: Flown,
) -> None:
    _, true, off, adjusted = flown_once
    before, after = (np.std(left_over(true, one), axis=0) for one in (off, adjusted.trajectory))
    assert (after[:2] < 0.5 * before[:2]).all()
    assert after[2] < 0.15 * before[2]
    assert after[5] < before[5]


def test_sigmas__hold_of_poses_and_of_mounting(
    flown_once: Flown,
) -> None:
    scene, true, _, adjusted = flown_once
    left = left_over(true, adjusted.trajectory)
    error = np.column_stack([np.interp(adjusted.found.t_s, true.t_s, axis) for axis in left.T])
    sigma = np.sqrt(np.diag(adjusted.found.covariance)).reshape(-1, 6)
    assert (np.abs(error) < 4.0 * sigma).all()
    assert 0.2 < np.sqrt(np.mean((error / sigma) ** 2)) < 1.6
    assert (np.abs(scene.off_deg(adjusted.boresight)) < 3.0 * np.array(adjusted.boresight.sigma_deg)).all()


def test_sigmas__of_the_trajectory_are_those_of_its_nodes(
    flown_once: Flown,
) -> None:
    _, _, off, adjusted = flown_once
    k = np.searchsorted(off.t_s, adjusted.found.t_s[:-1])
    own = np.sqrt(np.diag(adjusted.found.covariance)).reshape(-1, 6)[:-1]
    np.testing.assert_allclose(adjusted.trajectory.sigma[k, :3], own[:, :3], rtol=1e-6)
    np.testing.assert_allclose(adjusted.trajectory.sigma[k, 5], np.degrees(own[:, 5]), rtol=1e-6)
    assert (adjusted.trajectory.sigma > 0.0).all()


def test_report__has_rms_and_medians_to_hundredths_of_a_millimetre(flown_once: Flown) -> None:
    _, _, _, adjusted = flown_once
    at_nodes = adjusted.trajectory.at(np.clip(adjusted.found.t_s, *adjusted.trajectory.t_s[[0, -1]])).quaternion
    rotation = Rotation.from_quat(at_nodes, scalar_first=True).as_matrix()
    before, after = (
        np.median(errors.sigma(rotation), axis=0) * [*3 * [1.0], *3 * [180.0 / np.pi]]
        for errors in (adjusted.before, adjusted.found)
    )
    moved = np.linalg.norm(adjusted.found.value[:, :3], axis=0) / np.sqrt(len(adjusted.found.t_s))
    plain = adjusted.plain()
    found = {"moved_rms_m": moved, "sigma_before_m": before[:3], "sigma_after_m": after[:3]}
    found |= {"sigma_before_deg": before[3:], "sigma_after_deg": after[3:]}
    assert plain.keys() == found.keys()
    for name, values in found.items():
        assert [f"{value:.5f}" for value in plain[name]] == [f"{value:.5f}" for value in values], name
        assert plain[name] == [float(f"{value:.5f}") for value in plain[name]], name


def test_mounting_that_changes__is_found_apart_from_the_poses_and_within_its_sigmas() -> None:
    """A tenth of a degree over the flight about x and y, a fifth about z; the scanner rides on what turns."""
    left = []
    for seed in (1, 2, 3):
        scene = Scene(Mounting.from_rotation(STATED.xyz_m, TURNED @ STATED.rotation), seed=seed)
        true, slow = flown(), slow_errors(seed)
        share = (true.t_s - T0) / (4 * LINE_S) - 0.5
        angle_deg = np.outer(share, [0.1, -0.1, 0.2])
        vehicle, turned = (
            Rotation.from_quat(true.quaternion, scalar_first=True),
            Rotation.from_rotvec(np.radians(angle_deg)),
        )
        place = np.array(STATED.xyz_m)
        carried = replace(
            true,
            xyz_m=true.xyz_m + vehicle.apply(place - turned.apply(place)),
            quaternion=(vehicle * turned).as_quat(scalar_first=True),
        )
        off = without_errors(true, slow, replace(slow, value=-slow.value))
        off = replace(off, sigma=np.tile(SIGMA * np.where(np.arange(6) < 3, 1.0, 180.0 / np.pi), (len(off), 1)))
        returns = strip_returns(scene.scans(carried), off)
        found = boresight(returns, off, STATED)
        assert found is not None
        known = replace(slow, value=np.zeros_like(slow.value))
        rigid = adjust_strips(returns, off, known, found, STATED)
        adjusted = adjust_strips(returns, off, known, found, STATED, walk_deg_rts=0.02)
        walk = adjusted.turned
        assert walk is not None
        truth = np.column_stack([np.interp(walk.t_s, true.t_s, axis) for axis in angle_deg.T])
        truth -= truth.mean(axis=0)
        ratio = (walk.angle_deg - truth) / walk.sigma_deg
        assert np.sqrt(np.mean(ratio**2)) < 1.6
        left.append(np.std(walk.angle_deg - truth, axis=0) / np.std(truth, axis=0))
        before, after = (
            np.degrees(np.std(left_over(carried, one), axis=0)[3:5]) for one in (rigid.trajectory, walk.carrier)
        )
        assert (after < before).all()
        held, freed = (np.std(left_over(true, one.trajectory), axis=0)[3:5] for one in (rigid, adjusted))
        assert (freed < held).all()
        assert "mounting_walk" in adjusted.plain()
    assert (np.sqrt(np.mean(np.square(left), axis=0))[:2] < 0.4).all()
