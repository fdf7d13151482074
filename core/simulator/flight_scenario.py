"""The tables of a scenario that flies, or carries an IMU, a mount that moves or a line scanner."""

from typing import Annotated, Literal

from msgspec import Meta

from furrowmap.core.simulator.table import BY_KIND, Box, ScenarioTable, Vector3


class Flight(ScenarioTable, frozen=True):
    """Path and motion of an aircraft; with this table the scenario is a flight, and nothing drives."""

    strips: Annotated[int, Meta(ge=1, le=10_000, description="parallel lines, flown to and fro")] = 4
    strip_m: Annotated[float, Meta(gt=0, description="length of a strip")] = 40.0
    spacing_m: Annotated[float, Meta(gt=0, description="distance between strips, to the left of the first")] = 8.0
    cross_strips: Annotated[int, Meta(ge=0, le=10_000, description="lines across all strips, flown after them")] = 2
    waypoints_m: Annotated[
        tuple[tuple[float, float], ...],
        Meta(description="path instead of strips: [along, to the left of the first line]"),
    ] = ()
    heading_deg: Annotated[float, Meta(description="direction of the first strip, clockwise from grid north")] = 81.0
    start_xy_m: Annotated[tuple[float, float], Meta(description="start, from the south-western corner of the grid")] = (
        BY_KIND,
        BY_KIND,
    )
    height_m: Annotated[float, Meta(gt=0.5, description="above the mean ground in the middle of the grid")] = 15.0
    speed_mps: Annotated[float, Meta(gt=0, description="speed on strips")] = 4.0
    turn_s: Annotated[
        float, Meta(ge=0.2, description="standard deviation of the time by which corners are rounded")
    ] = 1.0
    hover_start_s: Annotated[float, Meta(ge=0, description="hovering before the start")] = 3.0
    hover_end_s: Annotated[float, Meta(ge=0, description="hovering at the end")] = 1.0
    nose_deg: Annotated[float, Meta(description="constant heading of the nose, clockwise from grid north")] = BY_KIND
    wind_mps: Annotated[tuple[float, float], Meta(description="wind, towards east and north")] = (1.6, 0.9)
    drag_per_s: Annotated[float, Meta(ge=0, description="drag: deceleration for each m/s through the air")] = 0.15
    gust_deg: Annotated[float, Meta(ge=0, description="roll and pitch by gusts, 0.2 to 2 Hz")] = 0.8
    yaw_wander_deg: Annotated[float, Meta(ge=0, description="heading of the nose, 0.05 to 0.5 Hz")] = 1.0
    wander_m: Annotated[float, Meta(ge=0, description="deviation from the path, 0.03 to 0.3 Hz, on each axis")] = 0.10
    heave_m: Annotated[float, Meta(ge=0, description="vertical motion, 0.05 to 0.5 Hz")] = 0.05
    body_boxes_m: Annotated[
        tuple[Box, ...], Meta(description="parts of the aircraft that the sensor may see, in the vehicle frame")
    ] = ((-0.25, 0.25, 0.28, 0.30, -0.55, -0.53), (-0.25, 0.25, -0.30, -0.28, -0.55, -0.53))
    plots_m: Annotated[
        tuple[tuple[float, float, float, float, float, float], ...],
        Meta(
            description="plots of crop: [east, north of the middle, direction in degrees counter-clockwise from east, "
            "length, width, height of the crop]"
        ),
    ] = ()
    extinction_per_m: Annotated[float, Meta(gt=0, description="density of the crop as beams see it")] = 15.0


class ScenarioImu(ScenarioTable, frozen=True):
    """An IMU on the vehicle; noise as in data sheets."""

    kind: Annotated[str, Meta(description="class in session.toml")] = "industrial"
    xyz_m: Annotated[Vector3, Meta(description="in the vehicle frame")] = (-0.039, -0.008, -0.294)
    rpy_deg: Annotated[Vector3, Meta(description="roll, pitch, yaw of its axes in the vehicle frame")] = (
        180.0,
        0.0,
        0.0,
    )
    rate_hz: Annotated[Literal[100, 125, 200, 250, 400], Meta(description="measurements per second")] = 200
    gyro_noise_deg_s_rthz: Annotated[float, Meta(ge=0, description="noise density of the angular rate")] = 0.0035
    accel_noise_mg_rthz: Annotated[float, Meta(ge=0, description="noise density of the specific force")] = 0.14
    gyro_bias_deg_s: Annotated[float, Meta(ge=0, description="standard deviation of the bias at turn-on")] = 0.05
    accel_bias_mg: Annotated[float, Meta(ge=0, description="the same of the specific force")] = 8.0
    gyro_walk_deg_s_rts: Annotated[float, Meta(ge=0, description="random walk of the bias")] = 0.0004
    accel_walk_mg_rts: Annotated[float, Meta(ge=0, description="the same of the specific force")] = 0.01
    gyro_instability_deg_s: Annotated[
        float, Meta(ge=0, description="Gauss-Markov part of the bias, standard deviation; it is not stated")
    ] = 0.0
    accel_instability_mg: Annotated[float, Meta(ge=0, description="the same of the specific force")] = 0.0
    instability_s: Annotated[float, Meta(gt=0, description="correlation time of both")] = 200.0
    gyro_scale: Annotated[float, Meta(ge=0, description="scale error of each axis, standard deviation")] = 0.0
    accel_scale: Annotated[float, Meta(ge=0, description="the same of the specific force")] = 0.0
    time_offset_s: Annotated[float, Meta(description="stamped minus true time")] = 0.0


class MovingMount(ScenarioTable, frozen=True):
    """A mount that turns about the scanner's origin against the vehicle; `mount.csv` says how."""

    amplitude_deg: Annotated[Vector3, Meta(description="of roll, pitch, yaw")] = (2.0, 1.0, 0.5)
    frequency_hz: Annotated[Vector3, Meta(description="of each")] = (0.3, 0.21, 0.13)
    rate_hz: Annotated[Literal[10, 20, 50, 100, 200], Meta(description="rows per second in mount.csv")] = 50
    noise_deg: Annotated[float, Meta(ge=0, description="noise of mount.csv")] = 0.0


class ScenarioLineScanner(ScenarioTable, frozen=True):
    """A scanner with one beam that sweeps in a plane, instead of the VLP-16; it writes `scans.csv`."""

    rate_hz: Annotated[float, Meta(gt=0, le=200, description="sweeps per second")] = 25.0
    field_deg: Annotated[float, Meta(gt=0, le=360, description="angle of a sweep, about the x axis")] = 100.0
    beams: Annotated[int, Meta(ge=2, le=10_000, description="beams in a sweep")] = 401
