"""A gyroscope as one more observation: what the interface takes to add a sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots, turns
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import POSE, ROTATION, VEHICLE, Block, State
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]

GYRO_BIAS = Block("gyro_bias_radps", 3)
WITH_GYRO = replace(VEHICLE, blocks=(*VEHICLE.blocks, GYRO_BIAS))
WALK = np.radians(0.2) / 60.0
"""Angular random walk in rad per √s: 0.2°/√h is a good MEMS gyroscope."""
BIAS_SIGMA = np.radians(0.5)
"""Of the bias in rad/s before anything is known."""
BIAS_WALK = np.radians(0.001)
"""In rad/s per √s."""


@dataclass(frozen=True)
class GyroIncrements(Observation):
    """Rotation vectors from knot to knot in the earlier knot's vehicle frame, with a slowly varying bias.

    Attributes:
        turn_rad: (n, 3) of each knot that has a next one in its chain, as `knots.linked` has them.
    """

    turn_rad: FloatArray

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Three equations of the increments and three of the bias for each two knots, and its start in each chain."""
        linked, size, column = knots.linked, state.layout.size, state.layout.column(GYRO_BIAS)
        bias, every = state[GYRO_BIAS], np.ones(len(linked))
        computed = turns(np.ascontiguousarray(state.rotation))[linked] + STEP_S * bias[linked]
        first = np.array([chain.first for chain in knots.chains])
        for axis in range(3):
            along = state.rotation[linked, :, axis]
            design = np.zeros((len(linked), size + POSE - ROTATION))
            design[:, : POSE - ROTATION], design[:, size:] = -along, along
            design[:, column - ROTATION + axis] = STEP_S
            residual = self.turn_rad[:, axis] - computed[:, axis]
            equations.add(linked * size + ROTATION, design, residual, WALK * np.sqrt(STEP_S) * every)
            pair = np.zeros((len(linked), size + 1))
            pair[:, 0], pair[:, size] = -1.0, 1.0
            step = bias[linked, axis] - bias[linked + 1, axis]
            equations.add(linked * size + column + axis, pair, step, BIAS_WALK * np.sqrt(STEP_S) * every)
            start = np.full(len(first), BIAS_SIGMA)
            equations.add(first * size + column + axis, np.ones((len(first), 1)), -bias[first, axis], start)


def gyro_on(truth: Trajectory, knots: Knots, bias_radps: FloatArray, seed: int) -> GyroIncrements:
    """What a gyroscope with a bias measures on a true drive, between knots inside it."""
    poses = truth.at(np.clip(knots.t_s, *truth.span_s))
    rotation = Rotation.from_quat(poses.quaternion, scalar_first=True).as_matrix()
    noise = WALK * np.sqrt(STEP_S) * np.random.default_rng(seed).standard_normal((len(knots.linked), 3))
    return GyroIncrements(turns(rotation)[knots.linked] + STEP_S * bias_radps + noise)
