"""Angles of a flight's sensors from the upward directions that these show, against rotations that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.session.flight_mounting import LOOKS, FlownMounting, levelling_rpy_deg

UP = np.array([0.0, 0.0, 1.0])


def turned(*rpy_deg: float) -> Rotation:
    return Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True)


@pytest.mark.parametrize("seed", range(20))
def test_levelling__gives_roll_and_pitch_of_any_mounting(seed: int) -> None:
    chance = np.random.default_rng(seed)
    rpy_deg = chance.uniform([-180.0, -89.0, -180.0], [180.0, 89.0, 180.0])
    tilted = turned(*chance.normal(0.0, 3.0, 2), 0.0).inv().apply(UP)  # up in the axes of the vehicle
    sensor_up = turned(*rpy_deg).inv().apply(tilted)
    found = levelling_rpy_deg(sensor_up, tilted, rpy_deg[2])
    assert np.allclose(turned(*found).apply(sensor_up), tilted, atol=1e-9)


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize(
    ("forward", "axis"),
    [((-89.6, 34.4, -89.2), "z"), ((-90.0, -12.0, -90.0), "z"), ((4.0, -8.0, 0.0), "x"), ((178.0, 5.0, 0.0), "x")],
)
def test_scanner__its_axis_looks_where_it_is_said_to(look: str, forward: tuple[float, ...], axis: str) -> None:
    heading = Rotation.from_euler("z", 90.0 * LOOKS.index(look), degrees=True)
    mounting = heading * turned(*forward)
    tilted = turned(1.0, 6.0, 0.0).inv().apply(UP)
    flight = FlownMounting(8.0, mounting.inv().apply(tilted), turned(180.0, 0.0, 0.0).inv().apply(tilted))
    found = turned(*flight.lidar_rpy_deg(look))
    assert flight.looking_axis == axis
    pointed = found.apply([0.0, 0.0, 1.0] if axis == "z" else [1.0, 0.0, 0.0])
    wanted = heading.apply([1.0, 0.0, 0.0])
    assert np.degrees(np.arctan2(np.cross(wanted, pointed)[2], wanted @ pointed)) == pytest.approx(0.0, abs=0.2)
    assert np.allclose(found.apply(mounting.inv().apply(tilted)), tilted, atol=0.003)  # rounded to 0.1 degrees


@pytest.mark.parametrize("rpy_deg", [(0.0, 0.0, 0.0), (180.0, 0.0, 0.0), (90.0, 0.0, 0.0), (0.0, -90.0, 0.0)])
def test_imu__quarter_turns_by_gravity(rpy_deg: tuple[float, float, float]) -> None:
    tilted = turned(3.0, 6.0, 0.0).inv().apply(UP)
    flight = FlownMounting(8.0, UP, turned(*rpy_deg).inv().apply(tilted))
    assert flight.imu_rpy_deg == pytest.approx(rpy_deg)
