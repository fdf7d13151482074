"""The aircraft in space: a path of lines with rounded corners, and what wind and gusts make of it."""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np
from scipy.ndimage import gaussian_filter1d

from furrowmap.core.simulator.drive import AFTER_S, DRIVE_RATE_HZ, LEAD_IN_S
from furrowmap.core.simulator.flight_scenario import Flight
from furrowmap.core.simulator.motion import SimulatedMotion
from furrowmap.core.simulator.noise import FloatArray, band_noise
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.site import lay_round

GRAVITY_MPS2: Final = 9.81
"""Against which the aircraft tilts; the IMU measures the normal gravity of the place."""
TILT_S: Final = 0.15
"""An aircraft follows the acceleration that is asked of it this slowly."""


def lay_out_flight(scenario: Scenario, flight: Flight) -> Scenario:
    """`scenario` with the ground and the start laid round the path where they are not stated.

    Raises:
        InputError: the ground would be too large to hold.
    """
    e, n = _turn(waypoints(flight), flight.heading_deg).T
    size, start = lay_round(scenario.field, flight.start_xy_m, e, n)
    replace = msgspec.structs.replace
    return replace(
        scenario,
        field=replace(scenario.field, size_e_m=size[0], size_n_m=size[1]),
        drive=replace(scenario.drive, start_xy_m=start),  # rows of the soil count from there
        flight=replace(flight, start_xy_m=start),
    )


def waypoints(flight: Flight) -> FloatArray:
    """(n, 2) corners of the path: along the first strip, and to the left of it."""
    if flight.waypoints_m:
        return np.array(((0.0, 0.0), *flight.waypoints_m))
    path: list[tuple[float, float]] = []
    for k in range(flight.strips):
        ends = ((0.0, k * flight.spacing_m), (flight.strip_m, k * flight.spacing_m))
        path += ends if k % 2 == 0 else ends[::-1]
    wide, over = (flight.strips - 1) * flight.spacing_m, 0.5 * flight.spacing_m
    places = flight.strip_m * (np.arange(flight.cross_strips) + 0.5) / max(flight.cross_strips, 1)
    if path[-1][0] > 0.0:
        places = places[::-1]
    for k, along in enumerate(places):
        across = ((float(along), wide + over), (float(along), -over))
        path += across if k % 2 == 0 else across[::-1]
    return np.array(path)


def duration_s(flight: Flight) -> float:
    """From t0 to the end of hovering."""
    length = float(np.hypot(*np.diff(waypoints(flight), axis=0).T).sum())
    return flight.hover_start_s + length / flight.speed_mps + flight.hover_end_s


def fly(scenario: Scenario, flight: Flight, scale: float, rng: np.random.Generator) -> SimulatedMotion:
    """The flight in space, at `RATE_HZ` from `BEFORE_S` before t0 to `AFTER_S` after its end.

    The aircraft tilts so that its thrust carries it along the path against gravity and the air; gusts tilt it further.

    Args:
        scale: map metres for a metre on the ground.
        rng: of wind and pilot.
    """
    count = math.floor((duration_s(flight) + LEAD_IN_S + AFTER_S) * DRIVE_RATE_HZ) + 1
    t_s = np.arange(count) / DRIVE_RATE_HZ - LEAD_IN_S
    en, yaw = _along(t_s, flight)
    en = en + np.array(flight.start_xy_m)
    en += flight.wander_m * np.column_stack([band_noise(rng, count, DRIVE_RATE_HZ, 0.03, 0.3) for _ in range(2)])
    yaw = yaw + np.radians(flight.yaw_wander_deg) * band_noise(rng, count, DRIVE_RATE_HZ, 0.05, 0.5)
    soil, field = scenario.soil, scenario.field
    rise, towards = 0.01 * soil.slope_percent, math.radians(soil.slope_towards_deg)
    ground = 0.5 * rise * (field.size_e_m * math.sin(towards) + field.size_n_m * math.cos(towards))
    height = ground + flight.height_m + flight.heave_m * band_noise(rng, count, DRIVE_RATE_HZ, 0.05, 0.5)
    velocity = np.gradient(en, 1.0 / DRIVE_RATE_HZ, axis=0)
    pushed = np.gradient(velocity, 1.0 / DRIVE_RATE_HZ, axis=0) + flight.drag_per_s * (
        velocity - np.array(flight.wind_mps)
    )
    pushed = gaussian_filter1d(pushed, TILT_S * DRIVE_RATE_HZ, axis=0, mode="nearest")
    ahead = pushed[:, 0] * np.cos(yaw) + pushed[:, 1] * np.sin(yaw)
    left = pushed[:, 1] * np.cos(yaw) - pushed[:, 0] * np.sin(yaw)
    gusts = [np.radians(flight.gust_deg) * band_noise(rng, count, DRIVE_RATE_HZ, 0.2, 2.0) for _ in range(2)]
    still = np.zeros(count)
    return SimulatedMotion(
        t_s,
        np.column_stack([en, height]),
        gusts[0] - np.arctan2(left, np.hypot(ahead, GRAVITY_MPS2)),
        gusts[1] - np.arctan2(ahead, GRAVITY_MPS2),
        yaw,
        still,
        still,
        scale,
    )


def _along(t_s: FloatArray, flight: Flight) -> tuple[FloatArray, FloatArray]:
    """The path (n, 2) from its start, towards east and north, and the heading of the nose (n,) as yaw."""
    corners = _turn(waypoints(flight), flight.heading_deg)
    legs = np.diff(corners, axis=0)
    length = np.hypot(*legs.T)
    legs, length = legs[length > 0.0], length[length > 0.0]
    ends = np.concatenate([[0.0], np.cumsum(length)])
    distance = np.clip((t_s - flight.hover_start_s) * flight.speed_mps, 0.0, ends[-1])
    corner = np.concatenate([np.zeros((1, 2)), np.cumsum(legs, axis=0)]) + corners[0]
    sharp = np.column_stack([np.interp(distance, ends, corner[:, k]) for k in range(2)])
    width = flight.turn_s * DRIVE_RATE_HZ
    smooth = gaussian_filter1d(sharp, width, axis=0, mode="nearest", truncate=6.0)
    if not math.isnan(flight.nose_deg):
        return smooth, np.full(len(t_s), math.radians(90.0 - flight.nose_deg))
    course = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    leg = np.clip(np.searchsorted(ends, distance, side="right") - 1, 0, len(legs) - 1)
    return smooth, gaussian_filter1d(course[leg], width, mode="nearest", truncate=6.0)


def _turn(uv_m: FloatArray, heading_deg: float) -> FloatArray:
    """Along and left of a heading, as east and north."""
    yaw = math.radians(90.0 - heading_deg)
    u, v = uv_m.T
    return np.column_stack([u * math.cos(yaw) - v * math.sin(yaw), u * math.sin(yaw) + v * math.cos(yaw)])
