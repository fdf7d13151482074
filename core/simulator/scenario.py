"""The scenario: field, machine, sensors and their errors, as described by a TOML file."""

import datetime as dt
import difflib
import json
import math
import re
import tomllib
import typing
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import msgspec
from msgspec import Meta

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.plain_reads import read_plain_text

Vector3: TypeAlias = tuple[float, float, float]
Box: TypeAlias = tuple[float, float, float, float, float, float]

BY_KIND: Final = math.nan
"""Placeholder for a default that depends on other values."""


def waits(value: object) -> bool:
    """Whether `value` is, or contains, a placeholder."""
    if isinstance(value, tuple):
        return any(waits(v) for v in value)
    return isinstance(value, float) and math.isnan(value)


class ScenarioTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the scenario: frozen, without unknown keys."""

    def fill(self, **values: object) -> None:
        """Replace placeholders by `values`."""
        for name, value in values.items():
            if waits(getattr(self, name)):
                msgspec.structs.force_setattr(self, name, value)


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


SoilKind: TypeAlias = Literal["stubble", "ploughed", "tilled", "rolled", "asphalt", "lawn", "snow", "maize"]
ToolShape: TypeAlias = Literal["tiller", "mower", "plow", "roller"]

OWN_SEED: Final = 7919
"""Added to the seed of a scenario for the noise of its second scanner."""
OF_SCENARIO: Final = -1
"""Placeholder for the seed of the scenario."""

_SOIL_KEYS: Final = ("sigma", "corr", "row", "spacing", "straw", "height", "hit", "crop", "furrow")
SOILS: Final[Mapping[str, Mapping[str, float]]] = {
    kind: dict(zip(_SOIL_KEYS, values, strict=True))
    for kind, values in {
        "stubble": (0.010, 0.060, 0.012, 0.30, 0.020, 0.15, 0.25, 0.0, 0.0),
        "ploughed": (0.032, 0.100, 0.030, 0.35, 0.002, 0.15, 0.25, 0.0, 0.030),
        "tilled": (0.015, 0.075, 0.000, 0.30, 0.002, 0.15, 0.25, 0.0, 0.0),
        "rolled": (0.006, 0.050, 0.004, 0.12, 0.000, 0.15, 0.25, 0.0, 0.0),
        "asphalt": (0.001, 0.030, 0.000, 0.30, 0.000, 0.15, 0.25, 0.0, 0.0),
        "lawn": (0.006, 0.080, 0.000, 0.30, 0.600, 0.08, 0.50, 0.0, 0.0),
        "snow": (0.002, 0.500, 0.000, 0.30, 0.000, 0.15, 0.25, 0.0, 0.0),
        "maize": (0.012, 0.070, 0.000, 0.30, 0.350, 2.00, 0.30, 0.75, 0.0),
    }.items()
}
"""Random roughness (standard deviation of heights, m), correlation length (m), row amplitude and spacing (m), straw
(share of the ground, highest, chance to stop a beam), distance of the rows in which it stands (0: everywhere), and
amplitude of the furrows a tool leaves. Grass and standing maize are straw of other figures.

Random roughness follows the review of Zobeck and Onstad (1987, Soil & Tillage Research 9, 1-20): about 6 mm where the
ground is smoothed, 7 to 10 mm on untilled or planted ground, 15 mm after rotary tillage or harrowing, 32 mm after a
mouldboard plough. Correlation lengths of 5 to 10 cm with an exponential autocorrelation are those of the single-scale
part in Davidson et al. (2000, IEEE Trans. Geoscience and Remote Sensing 38, 630-640), whose multi-scale part is the
``undulation`` here. Rows and straw are ordinary figures of the field, not taken from these sources.
"""

TILLER: Final[tuple[Box, ...]] = (
    (-0.36, 0.26, -0.86, 0.86, 0.05, 0.72),  # hood over the rotor
    (-0.73, -0.43, -0.845, 0.845, 0.08, 0.58),  # levelling board behind it
    (-0.71, 0.26, -0.87, -0.845, 0.02, 0.80),  # side plates
    (-0.71, 0.26, 0.845, 0.87, 0.02, 0.80),
    (-0.03, 0.39, -0.145, 0.145, 0.72, 1.08),  # gearbox and drive shaft
)
MOWER: Final[tuple[Box, ...]] = (
    (-0.60, 0.60, -0.85, 0.85, 0.10, 0.38),  # deck
    (-0.12, 0.25, -0.20, 0.20, 0.38, 0.62),  # gearbox
)
PLOW: Final[tuple[Box, ...]] = (
    (-0.80, 0.80, -0.06, 0.06, 0.55, 0.68),  # beam
    (0.45, 0.75, -0.65, -0.30, 0.00, 0.62),  # three bodies, one behind the other
    (-0.10, 0.20, -0.18, 0.18, 0.00, 0.62),
    (-0.65, -0.35, 0.30, 0.65, 0.00, 0.62),
    (0.70, 0.80, -0.45, 0.45, 0.35, 1.05),  # headstock
)
ROLLER: Final[tuple[Box, ...]] = (
    (-0.25, 0.25, -0.85, 0.85, 0.00, 0.45),  # roll
    (-0.30, 0.10, -0.85, 0.85, 0.45, 0.85),  # frame
)
TOOL_BOXES: Final[Mapping[str, tuple[Box, ...]]] = {"tiller": TILLER, "mower": MOWER, "plow": PLOW, "roller": ROLLER}

TRACTOR: Final[tuple[Box, ...]] = (
    (-0.95, -0.88, 0.65, 0.79, 2.000, 2.100),  # working lamps
    (-0.95, -0.88, -0.79, -0.65, 2.000, 2.100),
    (-0.51, 1.00, -0.74, 0.74, 2.28, 2.33),  # roof
    (1.05, 2.40, -0.30, 0.30, 0.70, 1.35),  # hood
    (-0.62, 0.62, 0.55, 0.88, 0.00, 1.24),  # rear wheels
    (-0.62, 0.62, -0.88, -0.55, 0.00, 1.24),
)


class ScenarioPlace(ScenarioTable, frozen=True):
    """Location of the field."""

    lon_lat_deg: Annotated[
        tuple[float, float], Meta(description="south-western corner of the ground grid, to the nearest whole metre")
    ] = (140.02, 36.87)
    height_m: Annotated[float, Meta(description="ellipsoidal height of the field")] = 271.4
    geoid_m: Annotated[float, Meta(description="geoid height, constant")] = 41.317
    crs: Annotated[str, Meta(description="projected CRS")] = "EPSG:6677"


class ScenarioField(ScenarioTable, frozen=True):
    """Ground grid and field boundary."""

    size_e_m: Annotated[float, Meta(gt=0, description="size of the grid, west to east")] = BY_KIND
    size_n_m: Annotated[float, Meta(gt=0, description="size of the grid, south to north")] = BY_KIND
    margin_m: Annotated[float, Meta(ge=2, description="margin around the drive, if no size is given")] = 14.0
    boundary_uv_m: Annotated[
        tuple[float, float, float, float],
        Meta(description="[u min, u max, v min, v max]: along (u) and across (v, left) the lanes, from the start"),
    ] = (BY_KIND, BY_KIND, BY_KIND, BY_KIND)


class ScenarioDrive(ScenarioTable, frozen=True):
    """Path and speed."""

    turns: Annotated[Literal["loop", "fishtail"], Meta(description="fishtail turns include reversing")] = "loop"
    lane_heading_deg: Annotated[float, Meta(description="heading of the first pass, clockwise from grid north")] = 81.0
    start_xy_m: Annotated[tuple[float, float], Meta(description="start, from the south-western corner of the grid")] = (
        BY_KIND,
        BY_KIND,
    )
    passes: Annotated[int, Meta(ge=1, le=10_000, description="number of passes, without lanes_m")] = 3
    spacing_m: Annotated[float, Meta(description="distance between lanes, positive to the left, without lanes_m")] = 1.6
    lanes_m: Annotated[tuple[float, ...], Meta(description="offset of each pass to the left of the first")] = ()
    pass_m: Annotated[
        tuple[float, ...],
        Meta(min_length=1, description="length of each pass, from lowering to lifting; one value for all"),
    ] = (8.0,)
    lead_in_m: Annotated[float, Meta(ge=0, description="straight path before a pass")] = 1.0
    run_out_m: Annotated[float, Meta(ge=0, description="straight path after a pass, before the turn")] = 0.8
    radius_m: Annotated[float, Meta(gt=0.5, description="minimum turning radius")] = 2.7
    ramp_m: Annotated[float, Meta(gt=0, description="distance of steering from straight to radius_m")] = 1.3
    speed_work_mps: Annotated[float, Meta(gt=0, description="speed on passes")] = 1.18
    speed_turn_mps: Annotated[float, Meta(gt=0, description="speed in turns; 85 % of it in reverse")] = 1.05
    speed_factors: Annotated[tuple[float, ...], Meta(description="factor on speed_work_mps by pass; empty: 1")] = ()
    accel_mps2: Annotated[float, Meta(gt=0, description="acceleration and deceleration")] = 0.6
    stand_start_s: Annotated[float, Meta(ge=0, description="time at standstill before the start")] = 1.0
    stand_end_s: Annotated[float, Meta(ge=0, description="time at standstill at the end")] = 0.6
    gear_s: Annotated[float, Meta(ge=0, description="time at standstill at a change of direction")] = 1.0
    stops: Annotated[
        tuple[tuple[int, float, float], ...],
        Meta(description="stops while working: [pass (from 0), metres into the pass, seconds]"),
    ] = ()
    wander_m: Annotated[float, Meta(ge=0, description="lateral deviation of the driver, standard deviation")] = 0.02

    def __post_init__(self) -> None:
        if not self.lanes_m:
            lanes = tuple(round(i * self.spacing_m, 6) for i in range(self.passes))
            msgspec.structs.force_setattr(self, "lanes_m", lanes)
        passes = len(self.lanes_m)
        msgspec.structs.force_setattr(self, "passes", passes)
        if len(self.pass_m) == 1:
            msgspec.structs.force_setattr(self, "pass_m", self.pass_m * passes)
        if not self.speed_factors:
            msgspec.structs.force_setattr(self, "speed_factors", (1.0,) * passes)
        for name in ("pass_m", "speed_factors"):
            if len(getattr(self, name)) != passes:
                raise ValueError(f"`{name}` has {len(getattr(self, name))} entries for {passes} passes")
        if self.ramp_m > 1.5 * self.radius_m:
            raise ValueError("`ramp_m` must not exceed 1.5 times `radius_m`; otherwise no turn reaches `radius_m`")
        if min(self.pass_m) <= 0 or min(self.speed_factors) <= 0:
            raise ValueError("`pass_m` and `speed_factors` must be positive")
        for number, at_m, stand_s in self.stops:
            if not 0 <= number < passes or not 0 <= at_m <= self.pass_m[number] or stand_s < 0:
                raise ValueError(f"the stop [{number}, {at_m}, {stand_s}] is on none of the {passes} passes")


class ScenarioSoil(ScenarioTable, frozen=True):
    """The ground before and after the pass of the implement."""

    seed: Annotated[
        int, Meta(ge=0, description="of the ground as the first drive found it; one for all drives on a field")
    ] = OF_SCENARIO
    kind: Annotated[SoilKind, Meta(description="ground before the pass; sets the defaults of the next eight keys")] = (
        "stubble"
    )
    clod_sigma_m: Annotated[float, Meta(ge=0, description="random roughness, standard deviation")] = BY_KIND
    clod_corr_m: Annotated[float, Meta(gt=0, description="correlation length of the random roughness")] = BY_KIND
    row_amplitude_m: Annotated[float, Meta(ge=0, description="amplitude of the rows along the lanes")] = BY_KIND
    row_spacing_m: Annotated[float, Meta(gt=0, description="spacing of the rows")] = BY_KIND
    straw_share: Annotated[float, Meta(ge=0, le=1, description="share of the ground with straw")] = BY_KIND
    straw_hit: Annotated[float, Meta(ge=0, le=1, description="probability that straw stops a passing ray")] = BY_KIND
    straw_height_m: Annotated[float, Meta(ge=0, description="maximum height of the straw")] = BY_KIND
    crop_rows_m: Annotated[
        float, Meta(ge=0, description="distance of the rows, along the lanes, in which straw stands; 0: everywhere")
    ] = BY_KIND
    slope_percent: Annotated[float, Meta(ge=0, le=60, description="slope of the field")] = 1.3
    slope_towards_deg: Annotated[float, Meta(description="upslope direction, clockwise from north")] = 200.0
    undulation_m: Annotated[float, Meta(ge=0, description="amplitude of waves of 5 to 40 m length")] = 0.05
    worked: Annotated[
        SoilKind | Literal["", "same"],
        Meta(description='ground after the pass; "": usual for the implement; "same": as before, without straw'),
    ] = ""
    tilled_sigma_m: Annotated[float, Meta(ge=0, description="random roughness after the pass")] = BY_KIND
    tilled_corr_m: Annotated[float, Meta(gt=0, description="correlation length after the pass")] = BY_KIND
    swell_m: Annotated[float, Meta(description="mean rise of the ground by the pass")] = 0.026
    ridge_m: Annotated[float, Meta(description="height of the ridges at both edges of a pass")] = 0.022
    furrow_m: Annotated[float, Meta(ge=0, description="amplitude of furrows after the pass")] = BY_KIND
    furrow_spacing_m: Annotated[float, Meta(gt=0, description="spacing of the furrows")] = 0.35

    def __post_init__(self) -> None:
        found = SOILS[self.kind]
        self.fill(
            clod_sigma_m=found["sigma"],
            clod_corr_m=found["corr"],
            row_amplitude_m=found["row"],
            row_spacing_m=found["spacing"],
            straw_share=found["straw"],
            straw_hit=found["hit"],
            straw_height_m=found["height"],
            crop_rows_m=found["crop"],
        )


class Sway(ScenarioTable, frozen=True):
    """Motion of the machine on its tyres, in addition to that from the ground."""

    sway_deg: Annotated[float, Meta(ge=0, description="roll and pitch, 1 to 3 Hz, while driving")] = 0.25
    heave_m: Annotated[float, Meta(ge=0, description="vertical motion, 1 to 3 Hz, while driving")] = 0.004
    vibration_deg: Annotated[float, Meta(ge=0, description="roll and pitch from the engine, 12 to 18 Hz")] = 0.005


class Tractor(ScenarioTable, frozen=True):
    """Wheels and body. Boxes are [x min, x max, y min, y max, z min, z max] in the vehicle frame."""

    wheelbase_m: Annotated[float, Meta(gt=0.5, description="distance between the axles")] = 1.95
    track_rear_m: Annotated[float, Meta(gt=0.3, description="distance between the centres of the rear wheels")] = 1.43
    track_front_m: Annotated[float, Meta(gt=0.3, description="distance between the centres of the front wheels")] = 1.35
    tyre_m: Annotated[float, Meta(gt=0, description="side of the square contact area of a tyre")] = 0.26
    body_boxes_m: Annotated[tuple[Box, ...], Meta(description="parts of the tractor that the sensor may see")] = TRACTOR


class ScenarioImplement(ScenarioTable, frozen=True):
    """The implement."""

    shape: Annotated[ToolShape, Meta(description="body, and effect on the ground")] = "tiller"
    kind: Annotated[str, Meta(description="kind in session.toml")] = "rotary tiller"
    width_m: Annotated[float, Meta(gt=0.1, description="working width")] = 1.70
    xy_m: Annotated[tuple[float, float], Meta(description="middle of the working line in the vehicle frame")] = (
        -1.62,
        0.0,
    )
    working_depth_m: Annotated[float, Meta(gt=0, description="height below which the implement works")] = 0.12
    lift_m: Annotated[float, Meta(gt=0, description="height of the lifted implement above working position")] = 0.45
    move_s: Annotated[float, Meta(gt=0, description="duration of lifting or lowering")] = 1.2
    jitter_m: Annotated[float, Meta(ge=0, description="vertical motion at work, standard deviation")] = 0.012
    boxes_m: Annotated[
        tuple[Box, ...],
        Meta(description="body, relative to the middle of the working line, in working position; empty: by shape"),
    ] = ()

    def __post_init__(self) -> None:
        if self.lift_m <= self.working_depth_m:
            raise ValueError("`lift_m` must be more than `working_depth_m`: the implement would never leave the ground")
        if not self.boxes_m:
            wide = self.width_m / 1.70
            shaped = tuple((a, b, c * wide, d * wide, e, f) for a, b, c, d, e, f in TOOL_BOXES[self.shape])
            msgspec.structs.force_setattr(self, "boxes_m", shaped)


class FrontImplement(ScenarioImplement, frozen=True):
    """A second implement, in front; it leaves the ground as it is."""

    shape: Annotated[ToolShape, Meta(description="body")] = "roller"
    name: Annotated[str, Meta(description="name in session.toml")] = "front roller"
    kind: Annotated[str, Meta(description="kind in session.toml")] = "roller"
    xy_m: Annotated[tuple[float, float], Meta(description="middle of the working line in the vehicle frame")] = (
        3.0,
        0.0,
    )
    ahead_m: Annotated[
        float, Meta(description="way by which it is lowered and lifted before the implement behind; negative: after it")
    ] = 0.0
    passes: Annotated[tuple[int, ...], Meta(description="passes in which it works, from 0; empty: all")] = ()
    rear_name: Annotated[str, Meta(description="name in session.toml of the implement behind")] = "rear tool"


class ScenarioAntenna(ScenarioTable, frozen=True):
    """The GNSS antenna."""

    xyz_m: Annotated[Vector3, Meta(description="phase centre in the vehicle frame")] = (1.847, -0.052, 1.624)


class ScenarioLidar(ScenarioTable, frozen=True):
    """The scanner and its mounting."""

    model: Annotated[
        Literal["VLP-16", "Puck Hi-Res", "OS1-32", "PandarXT-32", "Mid-360"],
        Meta(description="an OS1-32 has 32 beams and 1024 columns; a Mid-360 has no rings and is recorded in a bag"),
    ] = "VLP-16"
    xyz_m: Annotated[Vector3, Meta(description="sensor origin in the vehicle frame, as stated in the session")] = (
        -0.632,
        0.041,
        2.416,
    )
    rpy_deg: Annotated[Vector3, Meta(description="roll, pitch, yaw of the mounting, as stated in the session")] = (
        0.8,
        40.6,
        179.3,
    )
    true_xyz_m: Annotated[Vector3, Meta(description="actual sensor origin")] = (BY_KIND, BY_KIND, BY_KIND)
    true_rpy_deg: Annotated[Vector3, Meta(description="actual mounting angles")] = (BY_KIND, BY_KIND, BY_KIND)
    rpm: Annotated[Literal[300, 600, 1200], Meta(description="revolutions per minute")] = 600
    rpm_wander: Annotated[float, Meta(ge=0, le=0.01, description="slow relative variation of the speed")] = 2e-5
    return_mode: Annotated[Literal["strongest", "last", "dual"], Meta(description="as in the packets")] = "strongest"
    start_s: Annotated[float, Meta(ge=0, description="first firing after t0")] = 0.62
    stop_s: Annotated[float, Meta(ge=0, le=0.7, description="last firing after the end of the drive")] = 0.3
    laser_bias_m: Annotated[float, Meta(ge=0, description="range bias of each laser, standard deviation")] = 0.003
    min_range_m: Annotated[float, Meta(ge=0, description="minimum range")] = 0.5
    max_range_m: Annotated[float, Meta(gt=1, le=130, description="maximum range")] = 100.0
    position_packets: Annotated[bool, Meta(description="clock synchronised by GNSS (GPRMC and PPS)")] = True
    gzip: Annotated[bool, Meta(description="compress the recording (.gz)")] = False

    def __post_init__(self) -> None:
        self.fill(true_xyz_m=self.xyz_m, true_rpy_deg=self.rpy_deg)


class SecondLidar(ScenarioLidar, frozen=True):
    """A second scanner, recorded in a file of its own."""

    name: Annotated[str, Meta(description="name in session.toml")] = "front"
    first_name: Annotated[str, Meta(description="name in session.toml of the scanner of `[lidar]`")] = "rear"
    minus_gnss_s: Annotated[float, Meta(description="its clock minus GNSS clock, as stated in the session")] = 0.0
    true_minus_gnss_s: Annotated[float, Meta(description="actual offset")] = BY_KIND

    def __post_init__(self) -> None:
        super().__post_init__()
        self.fill(true_minus_gnss_s=self.minus_gnss_s)


class Noise(ScenarioTable, frozen=True):
    """Measurement errors."""

    range_m: Annotated[float, Meta(ge=0, description="range noise at normal incidence, standard deviation")] = 0.010
    grazing: Annotated[
        float,
        Meta(
            ge=0, le=2, description="noise grows with cos(incidence) to the power of minus this value, at most fivefold"
        ),
    ] = 0.25
    dropout: Annotated[
        float, Meta(ge=0, lt=1, description="share of pulses lost, more at long range and grazing angles; 0: none")
    ] = 0.010
    dust: Annotated[float, Meta(ge=0, description="dust returns at the working implement, per metre")] = 0.030


class ScenarioClock(ScenarioTable, frozen=True):
    """Clock errors."""

    computer_minus_utc_s: Annotated[float, Meta(description="offset of the recording computer")] = 0.83
    jitter_s: Annotated[float, Meta(ge=0, description="jitter of its time stamps, always late")] = 0.00025
    lidar_minus_gnss_s: Annotated[float, Meta(description="LiDAR clock minus GNSS clock, as stated in the session")] = (
        0.0
    )
    true_lidar_minus_gnss_s: Annotated[float, Meta(description="actual offset")] = BY_KIND

    def __post_init__(self) -> None:
        self.fill(true_lidar_minus_gnss_s=self.lidar_minus_gnss_s)


class Receiver(ScenarioTable, frozen=True):
    """Errors of a GNSS receiver: white noise, first-order Gauss-Markov process, and bias."""

    white_m: Annotated[float, Meta(ge=0, description="white noise on each horizontal axis")] = BY_KIND
    gm_m: Annotated[float, Meta(ge=0, description="Gauss-Markov process on each horizontal axis")] = BY_KIND
    tau_s: Annotated[float, Meta(gt=0, description="correlation time")] = BY_KIND
    white_h_m: Annotated[float, Meta(ge=0, description="white noise of the height")] = BY_KIND
    gm_h_m: Annotated[float, Meta(ge=0, description="Gauss-Markov process of the height")] = BY_KIND
    tau_h_s: Annotated[float, Meta(gt=0, description="correlation time")] = BY_KIND
    bias_h_m: Annotated[float, Meta(ge=0, description="standard deviation of the height bias")] = BY_KIND
    outage_s: Annotated[tuple[tuple[float, float], ...], Meta(description="outages, [from, to] after t0")] = ()
    float_s: Annotated[tuple[tuple[float, float], ...], Meta(description="float solutions, [from, to] after t0")] = ()
    float_error_m: Annotated[float, Meta(ge=0, description="constant horizontal error while float")] = 0.2
    rate_hz: Annotated[Literal[1, 2, 5, 10, 20], Meta(description="positions per second")] = 10


_CLAS: Final = {"white_m": 0.004, "gm_m": 0.010, "tau_s": 80.0, "white_h_m": 0.006, "gm_h_m": 0.030, "tau_h_s": 100.0}
_RTK: Final = {"white_m": 0.003, "gm_m": 0.003, "tau_s": 60.0, "white_h_m": 0.005, "gm_h_m": 0.005, "tau_h_s": 60.0}


class Gnss(ScenarioTable, frozen=True):
    """The receiver of the recording (`clas`) and a more accurate one on the same antenna (`rtk`)."""

    clas: Receiver = Receiver()
    rtk: Receiver = Receiver()

    def __post_init__(self) -> None:
        for name, usual in (("clas", {**_CLAS, "bias_h_m": 0.030}), ("rtk", {**_RTK, "bias_h_m": 0.0})):
            receiver = msgspec.structs.replace(getattr(self, name))
            receiver.fill(**usual)
            msgspec.structs.force_setattr(self, name, receiver)


def left_by(implement: ScenarioImplement, soil: ScenarioSoil, seed: int) -> ScenarioSoil:
    """`soil` with what `implement` leaves behind it, and the seed, where they are not stated."""
    left = soil.worked or {"tiller": "tilled", "plow": "ploughed", "mower": "same", "roller": "rolled"}[implement.shape]
    worked = SOILS[soil.kind if left == "same" else left]
    soil = msgspec.structs.replace(soil, worked=left, seed=seed if soil.seed == OF_SCENARIO else soil.seed)
    soil.fill(tilled_sigma_m=worked["sigma"], tilled_corr_m=worked["corr"], furrow_m=worked["furrow"])
    return soil


class EarlierDrive(ScenarioTable, frozen=True):
    """A drive that worked the ground before; tables as above.

    Its path is exactly that of a scenario with the same `seed`, `[drive]` and `[implement]`. Of its `[soil]` only what
    the tool leaves counts.
    """

    seed: Annotated[int, Meta(ge=0, description="of the drive and of the soil that it leaves")] = 1
    drive: ScenarioDrive = ScenarioDrive()
    soil: ScenarioSoil = ScenarioSoil()
    implement: ScenarioImplement = ScenarioImplement()

    def __post_init__(self) -> None:
        if any(math.isnan(value) for value in self.drive.start_xy_m):
            raise ValueError("an earlier drive needs its `drive.start_xy_m`: the ground is laid round the present one")
        msgspec.structs.force_setattr(self, "soil", left_by(self.implement, self.soil, self.seed))


class Scenario(ScenarioTable, frozen=True):
    """A recording to simulate; by default a session of about a minute."""

    name: Annotated[str, Meta(description="name of the recording")] = "simulated"
    title: Annotated[str, Meta(description="title of the session")] = "A simulated session"
    seed: Annotated[int, Meta(ge=0, description="the same scenario and seed give identical files")] = 1
    t0: Annotated[str, Meta(description="start, ISO 8601 with offset from UTC")] = "2026-06-11T01:23:40.300+00:00"
    posts: Annotated[
        tuple[tuple[float, float, float, float], ...],
        Meta(description="[east, north of the corner of the grid, radius, height]"),
    ] = ()
    walls: Annotated[
        tuple[tuple[float, float, float, float, float, float, float], ...],
        Meta(
            description="[east, north of the middle, direction in degrees counter-clockwise from east, length, "
            "thickness, height, brightness (1 to 19)]"
        ),
    ] = ()
    discs: Annotated[
        tuple[tuple[float, float, float, float], ...],
        Meta(description="flat targets: [east, north of the middle, diameter, reflectivity (1 to 255)]"),
    ] = ()
    checkerboards: Annotated[
        tuple[tuple[float, float, float, float, float], ...],
        Meta(
            description="flat targets of two bright and two dark quarters: [east, north of the middle, side, azimuth "
            "of an edge in degrees, reflectivity of the bright quarters (1 to 255)]"
        ),
    ] = ()
    earlier: tuple[EarlierDrive, ...] = ()
    place: ScenarioPlace = ScenarioPlace()
    flight: Flight | None = None
    imu: ScenarioImu | None = None
    mount: MovingMount | None = None
    line: ScenarioLineScanner | None = None
    field: ScenarioField = ScenarioField()
    drive: ScenarioDrive = ScenarioDrive()
    soil: ScenarioSoil = ScenarioSoil()
    sway: Sway = Sway()
    tractor: Tractor = Tractor()
    implement: ScenarioImplement = ScenarioImplement()
    front: FrontImplement | None = None
    antenna: ScenarioAntenna = ScenarioAntenna()
    lidar: ScenarioLidar = ScenarioLidar()
    second_lidar: SecondLidar | None = None
    noise: Noise = Noise()
    clock: ScenarioClock = ScenarioClock()
    gnss: Gnss = Gnss()

    def __post_init__(self) -> None:
        if dt.datetime.fromisoformat(self.t0).tzinfo is None:
            raise ValueError("`t0` has no UTC offset")
        if self.line is not None and self.flight is None:
            raise ValueError("`line` needs a `flight`: the scanner of a tractor turns about its axis")
        if self.second_lidar is not None and self.flight is not None:
            raise ValueError("`second_lidar` needs a drive: a `flight` has one scanner")
        msgspec.structs.force_setattr(self, "soil", left_by(self.implement, self.soil, self.seed))

    @property
    def by_second_lidar(self) -> "Scenario":
        """The same drive as the second scanner records it, with noise of its own."""
        assert self.second_lidar is not None
        clock = msgspec.structs.replace(self.clock, true_lidar_minus_gnss_s=self.second_lidar.true_minus_gnss_s)
        return msgspec.structs.replace(self, seed=self.seed + OWN_SEED, lidar=self.second_lidar, clock=clock)

    @property
    def t0_us(self) -> int:
        """Start in microseconds of UTC since 1970."""
        since = dt.datetime.fromisoformat(self.t0) - dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
        return since // dt.timedelta(microseconds=1)


PACKAGED: Final = ("demo", "road", "flight")
"""Scenarios that come with furrowmap: three passes of a tractor; a tractor on a road; a flight."""


def load_scenario(path: Path) -> Scenario:
    """Load a scenario file; InputError if it cannot be read, is not TOML, or has an unknown key or an invalid value."""
    try:
        text = read_plain_text(path)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError("scenario-unreadable", path=path, why=why) from None
    return scenario_from(text, str(path))


def demo_scenario(name: str = "demo") -> Scenario:
    """One of :data:`PACKAGED`; ``make demo`` runs the first."""
    text = resources.files("furrowmap.core.simulator").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return scenario_from(text, f"{name}.toml")


def scenario_from(text: str, name: str) -> Scenario:
    """The scenario in the TOML `text`; `name` is the file name in messages, errors are as of :func:`load_scenario`."""
    try:
        return msgspec.convert(tomllib.loads(text), Scenario)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError("scenario-toml", name=name, error=error) from error
    except (msgspec.ValidationError, ValueError) as error:
        raise _value_error(error, name) from error


def as_toml(scenario: Scenario) -> str:
    """`scenario` as TOML with every key that has a value, such that loading it gives the same scenario."""
    whole = _as_builtins(scenario)
    top = {key: value for key, value in whole.items() if not isinstance(value, dict)}
    return toml_keys(top) + "".join(f"\n[{table}]\n{toml_keys(keys)}" for table, keys in _tables(whole, ""))


def _tables(whole: Mapping[str, Any], above: str) -> list[tuple[str, dict[str, Any]]]:
    found: list[tuple[str, dict[str, Any]]] = []
    for name, value in whole.items():
        if isinstance(value, dict):
            keys = {k: v for k, v in value.items() if not isinstance(v, dict)}
            if keys:
                found.append((above + name, keys))
            found += _tables(value, f"{above}{name}.")
    return found


def toml_keys(keys: Mapping[str, Any]) -> str:
    """The lines of the keys of a table in TOML."""
    return "".join(f"{key} = {_value(value)}\n" for key, value in keys.items())


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(v)}" for key, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return repr(value)


def _as_builtins(scenario: Scenario) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        if isinstance(value, msgspec.Struct):
            fields = {name: getattr(value, name) for name in value.__struct_fields__}
            return {name: plain(field) for name, field in fields.items() if field is not None and not waits(field)}
        return [plain(v) for v in value] if isinstance(value, tuple) else value

    whole: dict[str, Any] = plain(scenario)
    return whole


def _value_error(error: Exception, name: str) -> InputError:
    """Convert an error of msgspec; suggests the nearest key for an unknown one."""
    text = str(error)
    place = re.search(r" - at `\$\.?(.*?)`", text)
    table = place.group(1) if place else ""
    unknown = re.search(r"unknown field `(.*?)`", text)
    if not unknown:
        what = re.sub(r" - at `.*`", "", text)
        return InputError("scenario-value", name=name, table=table or None, what=what[:1].lower() + what[1:])
    key = unknown.group(1)
    kind: Any = Scenario
    for part in filter(None, table.split(".")):
        hint = typing.get_type_hints(kind)[part]
        kind = next((k for k in typing.get_args(hint) if k is not type(None)), hint)
    known = list(kind.__struct_fields__)
    near = difflib.get_close_matches(key, known, 1, 0.5)
    return InputError(
        "scenario-unknown-key",
        name=name,
        table=table + "." if table else "",
        key=key,
        near_first=near[0] if near else None,
        known=", ".join(sorted(known)) if not (near) else None,
    )
