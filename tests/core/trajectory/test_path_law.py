"""The path of a wheeled vehicle against its model, written anew as residuals over standard deviations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.trajectory import kinematic
from furrowmap.core.trajectory.kinematic import EpochMeasurements, PathEpochs, solve_path

FloatArray = NDArray[np.float64]
LEVER_M = (1.2, -0.3, 1.6)
DRIFT_M, WHITE_M, STEP_S, EPOCHS = 0.02, 0.004, 0.1, 14
STANDS = slice(5, 8)
"""Steps between the two stretches of motion."""


def motion(speed_mps: float, turn_radps: float) -> tuple[FloatArray, FloatArray]:
    """Axle (n, 2) and yaw (n,) on a circle, with a stand in between."""
    step_m = np.full(EPOCHS - 1, speed_mps * STEP_S)
    step_m[STANDS] = 0.0
    turn = np.where(step_m > 0.0, turn_radps * STEP_S, 0.0)
    yaw = 0.4 + np.concatenate([[0.0], np.cumsum(turn)])
    course = 0.5 * (yaw[1:] + yaw[:-1])
    steps = np.column_stack([step_m * np.cos(course), step_m * np.sin(course)])
    return np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]), yaw


def residuals(state: FloatArray, known: FloatArray) -> FloatArray:
    """All residuals of the model over their standard deviations.

    Args:
        state: (5 n,) easting, northing, yaw and two slow errors of each epoch.
        known: (n, 3) the same axle and yaw, for standard deviations and weights that depend on them.
    """
    x, y, yaw, *slow = state.reshape(EPOCHS, 5).T
    moves = np.ones(EPOCHS - 1, dtype=bool)
    moves[STANDS] = False
    way = np.hypot(*np.diff(known[:, :2], axis=0).T)
    found: list[FloatArray] = []
    c, s = np.cos(yaw), np.sin(yaw)
    found.append((x + c * LEVER_M[0] - s * LEVER_M[1] + slow[0]) / WHITE_M)
    found.append((y + s * LEVER_M[0] + c * LEVER_M[1] + slow[1]) / WHITE_M)
    kept = np.exp(-STEP_S / 60.0)
    for error in slow:
        found += [error[:1] / DRIFT_M, (error[1:] - kept * error[:-1]) / (DRIFT_M * np.sqrt(1 - kept**2))]
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    sideways = -np.sin(middle) * np.diff(x) + np.cos(middle) * np.diff(y)
    found.append((sideways / np.hypot(kinematic.SLIP * way, 0.001))[moves])
    found += [(np.diff(axis) / 0.0005)[~moves] for axis in (x, y)]
    found.append(np.diff(yaw) / np.where(moves, np.radians(200.0) * STEP_S, np.radians(0.005)))
    inner = moves[1:] & moves[:-1]
    found += [(np.diff(axis, 2) / STEP_S / (1.0 * STEP_S))[inner] for axis in (x, y)]  # 1 m/s²
    # Curvature changes by 0.1 /(m s) and, however slowly the vehicle moves, turns are not better than 0.5 mrad.
    behind, ahead = way[:-1], way[1:]
    mean = 0.5 * (behind + ahead) + 0.0005
    bend = (behind * np.diff(yaw)[1:] - ahead * np.diff(yaw)[:-1]) / mean
    found.append((bend / (0.1 * STEP_S * behind * ahead / mean + 0.0005))[inner])
    return np.concatenate(found)


@settings(max_examples=8, deadline=None)
@given(st.floats(0.5, 2.0), st.floats(-0.3, 0.3))
def test_path__has_the_standard_deviations_of_its_model(speed_mps: float, turn_radps: float) -> None:
    """Slower than that, 1.3 seconds do not tell the heading to a radian, and a linear model has no place."""
    axle, yaw = motion(speed_mps, turn_radps)
    antenna = axle + np.column_stack(
        [
            np.cos(yaw) * LEVER_M[0] - np.sin(yaw) * LEVER_M[1],
            np.sin(yaw) * LEVER_M[0] + np.cos(yaw) * LEVER_M[1],
        ]
    )
    n = EPOCHS
    standing = np.zeros(n - 1, dtype=bool)
    standing[STANDS] = True
    stretch = np.repeat([0, 1], [STANDS.stop, n - STANDS.stop])
    path = solve_path(
        PathEpochs(np.arange(n) * STEP_S, standing, np.zeros(n - 1, dtype=bool), stretch),
        EpochMeasurements(
            en_m=antenna,
            height_m=np.full(n, 50.0),
            white_m=np.full(n, WHITE_M),
            white_h_m=np.full(n, WHITE_M),
            drift_m=np.full(n, DRIFT_M),
            drift_h_m=np.full(n, DRIFT_M),
            drift_run=np.zeros(n, dtype=np.intp),
            yaw_rad=np.full(n, np.nan),
            sigma_yaw_rad=0.01,
            lever_m=LEVER_M,
        ),
        antenna,
        yaw + 0.1,
    )
    known = np.column_stack([path.xyz_m[:, :2], path.yaw_rad])
    at = np.column_stack([known, np.zeros((n, 2))]).ravel()
    step = 1e-6
    derivative = np.column_stack(
        [(residuals(at + h, known) - residuals(at - h, known)) / (2 * step) for h in step * np.eye(len(at))]
    )
    sigma = np.sqrt(np.diag(np.linalg.inv(derivative.T @ derivative))).reshape(n, 5)
    np.testing.assert_allclose(path.sigma[:, [0, 1, 3]], sigma[:, :3], rtol=2e-3)
    assert path.xyz_m[:, 2] == pytest.approx(50.0 - LEVER_M[2])
