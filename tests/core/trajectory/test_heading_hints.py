"""The course of a vehicle on wheels as a hint of its heading, against a drive whose heading is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import KNOT_STEP_S
from furrowmap.core.adjustment.position_observations import RecordedHeadings
from furrowmap.core.trajectory.heading_hints import HEADING_CHANGE_CORRELATION_S, Course, RecordedHeading

FloatArray = NDArray[np.float64]
LEVER_M = np.array([0.8, 0.3, 1.0])


@dataclass(frozen=True)
class Drive:
    """A minute in curves at 1 m/s, with turns by the gyroscopes and the antenna of noisy positions."""

    turned: FloatArray
    swept_s: FloatArray
    antenna_m: FloatArray
    begin: int = 0

    @classmethod
    def of(cls, heading_rad: float, reverse: float, white_m: float) -> Drive:
        t_s = KNOT_STEP_S * np.arange(2400)
        yaw = 0.8 * np.sin(0.2 * t_s)
        turned = Rotation.from_euler("z", yaw[:, None]).as_matrix()
        speed = np.where(t_s < reverse * t_s[-1], -1.0, 1.0)
        nose = np.column_stack([np.cos(heading_rad + yaw), np.sin(heading_rad + yaw), 0.0 * t_s])
        rotation = Rotation.from_euler("z", heading_rad).as_matrix()
        way = np.cumsum(speed[:, None] * nose * KNOT_STEP_S, axis=0) + turned @ LEVER_M @ rotation.T
        noise = np.random.default_rng(5).normal(0.0, white_m, (len(t_s) // 10 + 1, 3))  # four positions a second
        at_s = 0.25 * np.arange(len(noise))
        seen = way + np.column_stack([np.interp(t_s, at_s, noise[:, k]) for k in range(3)])
        return cls(turned, np.cumsum(turned, axis=0) * KNOT_STEP_S, seen)


@settings(deadline=None, max_examples=20)
@given(heading=st.floats(-3.1, 3.1), reverse=st.floats(0.0, 0.25), white_m=st.floats(0.0, 0.5))
def test_course__shows_the_heading(heading: float, reverse: float, white_m: float) -> None:
    drive = Drive.of(heading, reverse, white_m)
    course = Course.from_antenna(drive.antenna_m, max(white_m, 0.01), 0.1, LEVER_M)
    rotation = course.starts(Rotation.from_euler("z", 1.0).as_matrix(), drive)[0]
    for _ in range(3):
        rows = course.rows(rotation, np.zeros(6), drive)
        weighted = rows.weight * rows.design[:, 2]
        variance = 1.0 / (weighted @ rows.design[:, 2])
        rotation = Rotation.from_euler("z", variance * (weighted @ rows.residual)).as_matrix() @ rotation
    off = (Rotation.from_matrix(rotation) * Rotation.from_euler("z", -heading)).magnitude()
    assert off < 4.0 * np.sqrt(variance)
    assert np.degrees(np.sqrt(variance)) < 5.0


def test_as_much_in_reverse_as_forward__shows_no_nose() -> None:
    drive = Drive.of(0.5, 0.5, 0.05)
    assert Course.from_antenna(drive.antenna_m, 0.05, 0.1, LEVER_M).starts(np.eye(3), drive) == []


def test_derivatives__are_those_of_the_residuals() -> None:
    drive = Drive.of(0.5, 0.1, 0.05)
    course = Course.from_antenna(drive.antenna_m, 0.05, 0.1, LEVER_M)
    rotation, bias = Rotation.from_euler("ZYX", [0.55, 0.02, -0.03]).as_matrix(), np.full(6, 0.001)
    rows = course.rows(rotation, bias, drive)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        turned = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        after = course.rows(turned, bias + np.append(step[3:], np.zeros(3)), drive)
        change = -(after.residual - rows.residual) / 1e-6
        assert change == pytest.approx(rows.design[:, k], abs=2e-3 * max(1.0, np.abs(rows.design[:, k]).max()))


@pytest.mark.parametrize("known", [2400, 1000, 0])
def test_recorded_headings__have_a_mean_whose_error_stays_and_changes_that_show_the_gyroscopes(known: int) -> None:
    """The mean is known to the sigma of one heading, however many there are."""
    drive = Drive.of(0.5, 0.0, 0.0)
    yaw = np.arctan2(drive.turned[:, 1, 0], drive.turned[:, 0, 0]) + 0.3
    yaw[known:] = np.nan
    hint = RecordedHeading(yaw, 0.02)
    rows = hint.rows(np.eye(3), np.zeros(6), drive)
    if not known:
        assert (rows.design.shape, len(rows.residual), len(rows.weight)) == ((0, 9), 0, 0)
        assert hint.starts(np.eye(3), drive) == []
        return
    assert len(rows.design) == len(rows.residual) == len(rows.weight) == known + 1
    about_z = rows.weight * rows.design[:, 2]
    assert 1.0 / (about_z @ rows.design[:, 2]) == pytest.approx(0.02**2)
    assert about_z @ rows.residual / (about_z @ rows.design[:, 2]) == pytest.approx(0.3)
    assert rows.weight[1:] == pytest.approx(np.full(known, KNOT_STEP_S / HEADING_CHANGE_CORRELATION_S / 0.02**2))
    (start,) = hint.starts(np.eye(3), drive)
    assert Rotation.from_matrix(start).as_euler("ZYX")[0] == pytest.approx(0.3)
    step = np.append(np.zeros(3), [1e-6, -2e-6, 3e-6])
    change = hint.rows(np.eye(3), np.append(step[3:], np.zeros(3)), drive).residual - rows.residual
    assert change == pytest.approx(-(rows.design[:, 3:6] @ step[3:]), abs=1e-8)


def circle(radius_m: float, speed_mps: float = 1.0) -> Drive:
    """Forward on a circle to the left, about which an antenna above the origin goes; a minute long."""
    yaw = speed_mps / radius_m * KNOT_STEP_S * np.arange(2400)
    turned = Rotation.from_euler("z", yaw[:, None]).as_matrix()
    antenna = radius_m * np.column_stack([np.sin(yaw), 1.0 - np.cos(yaw), 0.0 * yaw])
    return Drive(turned, np.cumsum(turned, axis=0) * KNOT_STEP_S, antenna)


@pytest.mark.parametrize(
    ("way_m", "length_s"),
    [(1.9, 2.0), (2.1, 3.0), (2.9, 3.0), (3.1, 5.0), (4.9, 5.0), (5.1, 8.0), (7.9, 8.0), (8.1, 12.0), (19.0, 20.0)],
)
def test_course__is_taken_over_the_shortest_time_whose_way_is_five_times_its_sigma(
    way_m: float, length_s: float
) -> None:
    """At 1 m/s; the sigma is that of the difference between two positions, which creep by 5 cm in a second."""
    white_m = way_m / 5.0 / np.sqrt(2.0)
    course = Course.from_antenna(circle(1e9).antenna_m, white_m, 0.0, np.zeros(3))
    assert course.knots * KNOT_STEP_S == pytest.approx(length_s)
    assert course.sigma_m == pytest.approx(np.hypot(way_m / 5.0, 0.05 * np.sqrt(length_s)))


@pytest.mark.parametrize("radius_m", [1e9, 20.0, 6.0])
def test_course__is_certain_but_for_noise_slip_and_turns(radius_m: float) -> None:
    """A twentieth of the way aside, and three tenths of the turn within it; the ways are chords of two seconds."""
    turn = 2.0 / radius_m
    chord_m = 2.0 * radius_m * np.sin(0.5 * turn)
    course = Course.from_antenna(circle(radius_m).antenna_m, 0.01, 0.0, np.zeros(3))
    rows = course.rows(np.eye(3), np.zeros(6), circle(radius_m))
    variance = 2.0 * 0.01**2 + 2.0 * 0.05**2 + (0.05**2 + (0.3 * turn) ** 2) * chord_m**2
    assert rows.weight == pytest.approx(np.full(len(rows.weight), 1.0 / variance), rel=1e-4)


@pytest.mark.parametrize(("reverse", "is_shown"), [(0.3, True), (0.38, False), (0.62, False), (0.7, True)])
def test_nose__is_shown_by_three_tenths_more_of_the_way_in_one_direction(reverse: float, is_shown: bool) -> None:
    """More in reverse than forward turns the likelier start round."""
    drive = Drive.of(0.5, reverse, 0.01)
    found = Course.from_antenna(drive.antenna_m, 0.05, 0.1, LEVER_M).starts(np.eye(3), drive)
    assert len(found) == (2 if is_shown else 0)
    if is_shown:
        off = Rotation.from_matrix(found[0]) * Rotation.from_euler("z", -0.5)
        assert abs(off.magnitude() - (np.pi if reverse > 0.5 else 0.0)) < 0.3


def test_heading_log__has_headings_within_its_times_and_gaps_of_a_second() -> None:
    """From 3 to -3 rad is a turn to the left through half a circle; the axis is square to the left of the nose."""
    log = RecordedHeadings(np.array([10.0, 11.0, 12.5]), np.array([3.0, -3.0, -2.9]), 0.01, axis_rad=0.5 * np.pi)
    found = log.at(np.array([9.99, 10.0, 10.5, 11.0, 11.7, 12.51]))
    assert np.isfinite(found).tolist() == [False, True, True, True, False, False]
    assert found[1:4] == pytest.approx(np.array([3.0, np.pi, 2.0 * np.pi - 3.0]) - 0.5 * np.pi)
    assert np.isnan(RecordedHeadings(np.array([10.0]), np.array([3.0]), 0.01).at(np.array([10.0]))).all()
