"""The direction of travel and the place of the axle, by a drive on a circle worked out in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import KNOT_STEP_S, POSE, Chain, Knots, State
from furrowmap.core.adjustment.preintegration import exponential
from furrowmap.core.adjustment.vehicle import AXLE_BEHIND, ON_WHEELS, TRAVEL_YAW, AlongNose
from furrowmap.core.values.rotation import wrap_deg

HELD = 1e12
"""Information on the poses, which are known here."""


@pytest.mark.parametrize(("off_deg", "behind_m"), [(0.0, 0.0), (12.0, 0.4), (-88.0, -0.3)])
def test_constants_of_a_vehicle_that_moves_beside_its_nose__are_found(off_deg: float, behind_m: float) -> None:
    """The axle runs along the direction of travel; the origin is ahead of it, and the nose to the right."""
    t_s = KNOT_STEP_S * np.arange(2000)
    travel = 0.05 * t_s + 2.0 * np.sin(0.5 * t_s)
    ahead = np.column_stack([np.cos(travel), np.sin(travel), 0.0 * t_s])
    axle = np.cumsum(2.0 * KNOT_STEP_S * ahead, axis=0)
    nose = travel - np.radians(off_deg)
    rotation = np.array([exponential(0.0, 0.0, yaw) for yaw in nose])
    added = np.zeros((len(t_s), ON_WHEELS.size - POSE))
    state = State(axle + behind_m * ahead, rotation, added, ON_WHEELS)
    knots = Knots((Chain(0, len(t_s), 0.0),), t_s)
    constants = [ON_WHEELS.column(block) for block in (TRAVEL_YAW, AXLE_BEHIND)]
    held = np.full((len(t_s), ON_WHEELS.size), HELD)
    held[:, constants] = 0.0
    for _ in range(4):
        equations = NormalEquations(len(t_s) * ON_WHEELS.size, 2 * ON_WHEELS.size)
        AlongNose(np.pi).add(equations, knots, state)
        equations.band[0] += held.ravel()
        state = state.moved(equations.solve().values.reshape(held.shape))
    found_deg = float(np.degrees(np.median(state[TRAVEL_YAW])))
    assert wrap_deg(np.array([found_deg - off_deg]))[0] == pytest.approx(0.0, abs=0.5)
    assert float(np.median(state[AXLE_BEHIND])) == pytest.approx(behind_m, abs=0.05)
