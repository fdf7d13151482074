"""The scenario: a field, a machine, its sensors and their errors, as a TOML file describes them."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Mapping
from typing import Annotated, Final, Literal, TypeAlias

import msgspec
from msgspec import Meta

Vector3: TypeAlias = tuple[float, float, float]
Box: TypeAlias = tuple[float, float, float, float, float, float]
SoilKind: TypeAlias = Literal["stubble", "ploughed", "tilled", "rolled"]

_BY_KIND: Final = math.nan
"""Stands for "as usual for the kind", "as stated elsewhere" or "laid round the drive" until it is filled in."""

SOILS: Final[Mapping[str, Mapping[str, float]]] = {
    "stubble": {"sigma": 0.010, "corr": 0.060, "row": 0.012, "spacing": 0.30, "straw": 0.020, "furrow": 0.0},
    "ploughed": {"sigma": 0.032, "corr": 0.100, "row": 0.030, "spacing": 0.35, "straw": 0.002, "furrow": 0.030},
    "tilled": {"sigma": 0.015, "corr": 0.075, "row": 0.000, "spacing": 0.30, "straw": 0.002, "furrow": 0.0},
    "rolled": {"sigma": 0.006, "corr": 0.050, "row": 0.004, "spacing": 0.12, "straw": 0.000, "furrow": 0.0},
}
"""Random roughness (standard deviation of heights, m), correlation length (m), row amplitude and spacing (m), share of
the ground with straw, and amplitude of the furrows a tool leaves.

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
TOOL_BOXES: Final[Mapping[str, tuple[Box, ...]]] = {"tiller": TILLER, "mower": MOWER, "plow": PLOW}

TRACTOR: Final[tuple[Box, ...]] = (
    (-0.95, -0.88, 0.65, 0.79, 2.000, 2.100),  # working lamps
    (-0.95, -0.88, -0.79, -0.65, 2.000, 2.100),
    (-0.51, 1.00, -0.74, 0.74, 2.28, 2.33),  # roof
    (1.05, 2.40, -0.30, 0.30, 0.70, 1.35),  # hood
    (-0.62, 0.62, 0.55, 0.88, 0.00, 1.24),  # rear wheels
    (-0.62, 0.62, -0.88, -0.55, 0.00, 1.24),
)


def waits(value: object) -> bool:
    """Whether `value` still stands for something to be filled in."""
    if isinstance(value, tuple):
        return any(waits(v) for v in value)
    return isinstance(value, float) and math.isnan(value)


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the scenario: frozen, and strict about its keys."""

    def _fill(self, **values: object) -> None:
        """Put `values` in the place of those that still wait to be filled in."""
        for name, value in values.items():
            if waits(getattr(self, name)):
                msgspec.structs.force_setattr(self, name, value)


class Place(_Table, frozen=True):
    """Where the field lies."""

    lon_lat_deg: Annotated[
        tuple[float, float], Meta(description="south-western corner of the ground grid, to the nearest whole metre")
    ] = (140.02, 36.87)
    height_m: Annotated[float, Meta(description="of the place above the ellipsoid")] = 271.4
    geoid_m: Annotated[float, Meta(description="geoid above the ellipsoid, a constant")] = 41.317
    crs: Annotated[str, Meta(description="projected CRS of the map frame")] = "EPSG:6677"


class Field(_Table, frozen=True):
    """The ground grid, and the parcel on it."""

    size_e_m: Annotated[float, Meta(gt=0, description="of the grid, west to east")] = _BY_KIND
    size_n_m: Annotated[float, Meta(gt=0, description="of the grid, south to north")] = _BY_KIND
    margin_m: Annotated[float, Meta(ge=2, description="round the drive, where no size is stated")] = 14.0
    boundary_uv_m: Annotated[
        tuple[float, float, float, float],
        Meta(description="from, to along the lanes (u) and from, to across them (v, left), seen from the start"),
    ] = (_BY_KIND, _BY_KIND, _BY_KIND, _BY_KIND)


class Drive(_Table, frozen=True):
    """The line driven, and how fast."""

    turns: Annotated[Literal["loop", "fishtail"], Meta(description="fishtail turns reverse")] = "loop"
    lane_heading_deg: Annotated[float, Meta(description="of the first pass, clockwise from grid north")] = 81.0
    start_xy_m: Annotated[tuple[float, float], Meta(description="start, from the grid's south-western corner")] = (
        _BY_KIND,
        _BY_KIND,
    )
    passes: Annotated[int, Meta(ge=1, description="how many, where lanes_m is not stated")] = 3
    spacing_m: Annotated[float, Meta(description="from lane to lane, left positive, where lanes_m is not stated")] = 1.6
    lanes_m: Annotated[tuple[float, ...], Meta(description="offset of each pass to the left of the first")] = ()
    pass_m: Annotated[
        tuple[float, ...],
        Meta(min_length=1, description="each pass, from where the tool is lowered to where it is lifted; one for all"),
    ] = (8.0,)
    lead_in_m: Annotated[float, Meta(ge=0, description="straight before a pass")] = 1.0
    run_out_m: Annotated[float, Meta(ge=0, description="straight behind a pass, before the turn")] = 0.8
    radius_m: Annotated[float, Meta(gt=0.5, description="smallest radius of the turns")] = 2.7
    ramp_m: Annotated[float, Meta(gt=0, description="way on which the steering goes from straight to radius_m")] = 1.3
    speed_work_mps: Annotated[float, Meta(gt=0, description="on the passes")] = 1.18
    speed_turn_mps: Annotated[float, Meta(gt=0, description="in the turns; 85 % of it in reverse")] = 1.05
    speed_factors: Annotated[tuple[float, ...], Meta(description="of speed_work_mps, one a pass; empty: 1")] = ()
    accel_mps2: Annotated[float, Meta(gt=0, description="speeding up and braking")] = 0.6
    stand_start_s: Annotated[float, Meta(ge=0, description="standing before the start")] = 1.0
    stand_end_s: Annotated[float, Meta(ge=0, description="standing at the end")] = 0.6
    gear_s: Annotated[float, Meta(ge=0, description="standing at a change of direction")] = 1.0
    stops: Annotated[
        tuple[tuple[int, float, float], ...],
        Meta(description="[pass (from 0), metres into it, seconds]: stops while working"),
    ] = ()
    wander_m: Annotated[float, Meta(ge=0, description="of the driver to the sides, standard deviation")] = 0.02

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
            raise ValueError("`ramp_m` must not be more than 1.5 times `radius_m`, or no turn is as tight as that")
        if min(self.pass_m) <= 0 or min(self.speed_factors) <= 0:
            raise ValueError("`pass_m` and `speed_factors` must be positive")
        for number, at_m, stand_s in self.stops:
            if not 0 <= number < passes or not 0 <= at_m <= self.pass_m[number] or stand_s < 0:
                raise ValueError(f"the stop [{number}, {at_m}, {stand_s}] is on none of the {passes} passes")


class Soil(_Table, frozen=True):
    """The ground as it is found, and as the tool leaves it."""

    kind: Annotated[SoilKind, Meta(description="what the ground is before the tool; sets the next five keys")] = (
        "stubble"
    )
    clod_sigma_m: Annotated[float, Meta(ge=0, description="random roughness, standard deviation")] = _BY_KIND
    clod_corr_m: Annotated[float, Meta(gt=0, description="correlation length of the random roughness")] = _BY_KIND
    row_amplitude_m: Annotated[float, Meta(ge=0, description="of the rows along the lanes")] = _BY_KIND
    row_spacing_m: Annotated[float, Meta(gt=0, description="of the rows")] = _BY_KIND
    straw_share: Annotated[float, Meta(ge=0, le=1, description="of the ground that bears straw")] = _BY_KIND
    straw_hit: Annotated[float, Meta(ge=0, le=1, description="chance that straw stops a ray passing it")] = 0.25
    straw_height_m: Annotated[float, Meta(ge=0, description="highest straw")] = 0.15
    slope_percent: Annotated[float, Meta(ge=0, le=60, description="of the field")] = 1.3
    slope_towards_deg: Annotated[float, Meta(description="compass direction in which the field rises")] = 200.0
    undulation_m: Annotated[float, Meta(ge=0, description="amplitude of waves 5 to 40 m long")] = 0.05
    worked: Annotated[
        SoilKind | Literal["", "same"],
        Meta(description='what the tool leaves; "": what it usually leaves; "same": ground as before, straw gone'),
    ] = ""
    tilled_sigma_m: Annotated[float, Meta(ge=0, description="random roughness behind the tool")] = _BY_KIND
    tilled_corr_m: Annotated[float, Meta(gt=0, description="correlation length behind the tool")] = _BY_KIND
    swell_m: Annotated[float, Meta(description="how much higher the ground lies behind the tool, mean")] = 0.026
    ridge_m: Annotated[float, Meta(description="height of the ridges at both borders of a pass")] = 0.022
    furrow_m: Annotated[float, Meta(ge=0, description="amplitude of furrows behind the tool")] = _BY_KIND
    furrow_spacing_m: Annotated[float, Meta(gt=0, description="of the furrows behind the tool")] = 0.35

    def __post_init__(self) -> None:
        found = SOILS[self.kind]
        self._fill(
            clod_sigma_m=found["sigma"],
            clod_corr_m=found["corr"],
            row_amplitude_m=found["row"],
            row_spacing_m=found["spacing"],
            straw_share=found["straw"],
        )


class Sway(_Table, frozen=True):
    """How the machine moves on its tyres, beside what the ground does."""

    sway_deg: Annotated[float, Meta(ge=0, description="roll and pitch, 1 to 3 Hz, while driving")] = 0.25
    heave_m: Annotated[float, Meta(ge=0, description="up and down, 1 to 3 Hz, while driving")] = 0.004
    vibration_deg: Annotated[float, Meta(ge=0, description="roll and pitch of the running engine, 12 to 18 Hz")] = 0.005


class Tractor(_Table, frozen=True):
    """Wheels and body. Boxes are [x from, to, y from, to, z from, to] in the vehicle frame."""

    wheelbase_m: Annotated[float, Meta(gt=0.5, description="rear axle to front axle")] = 1.95
    track_rear_m: Annotated[float, Meta(gt=0.3, description="between the rear wheels' middles")] = 1.43
    track_front_m: Annotated[float, Meta(gt=0.3, description="between the front wheels' middles")] = 1.35
    tyre_m: Annotated[float, Meta(gt=0, description="edge of the square on which a tyre rests")] = 0.26
    body_boxes_m: Annotated[tuple[Box, ...], Meta(description="what of the tractor the sensor may see")] = TRACTOR


class Implement(_Table, frozen=True):
    """The tool."""

    shape: Annotated[Literal["tiller", "mower", "plow"], Meta(description="its body, and what it leaves")] = "tiller"
    kind: Annotated[str, Meta(description="as session.toml names it")] = "rotary tiller"
    width_m: Annotated[float, Meta(gt=0.1, description="working width")] = 1.70
    xy_m: Annotated[tuple[float, float], Meta(description="middle of the tool's line in the vehicle frame")] = (
        -1.62,
        0.0,
    )
    working_depth_m: Annotated[float, Meta(gt=0, description="the tool is in the ground below this height")] = 0.12
    lift_m: Annotated[float, Meta(gt=0, description="of the lifted tool above its working position")] = 0.45
    move_s: Annotated[float, Meta(gt=0, description="lifting or lowering")] = 1.2
    jitter_m: Annotated[float, Meta(ge=0, description="of the tool at work, standard deviation")] = 0.012
    boxes_m: Annotated[
        tuple[Box, ...],
        Meta(description="its body about the tool's line at working position; empty: that of the shape"),
    ] = ()

    def __post_init__(self) -> None:
        if self.lift_m <= self.working_depth_m:
            raise ValueError("`lift_m` must be more than `working_depth_m`: the tool would never leave the ground")
        if not self.boxes_m:
            wide = self.width_m / 1.70
            shaped = tuple((a, b, c * wide, d * wide, e, f) for a, b, c, d, e, f in TOOL_BOXES[self.shape])
            msgspec.structs.force_setattr(self, "boxes_m", shaped)


class Antenna(_Table, frozen=True):
    """The GNSS antenna."""

    xyz_m: Annotated[Vector3, Meta(description="phase centre in the vehicle frame")] = (1.847, -0.052, 1.624)


class Lidar(_Table, frozen=True):
    """The VLP-16 and its mounting."""

    xyz_m: Annotated[Vector3, Meta(description="its origin in the vehicle frame, as the session states it")] = (
        -0.632,
        0.041,
        2.416,
    )
    rpy_deg: Annotated[Vector3, Meta(description="its roll, pitch, yaw, as the session states them")] = (
        0.8,
        40.6,
        179.3,
    )
    true_xyz_m: Annotated[Vector3, Meta(description="where it really is")] = (_BY_KIND, _BY_KIND, _BY_KIND)
    true_rpy_deg: Annotated[Vector3, Meta(description="how it really looks")] = (_BY_KIND, _BY_KIND, _BY_KIND)
    rpm: Annotated[Literal[300, 600, 1200], Meta(description="turns a minute")] = 600
    rpm_wander: Annotated[float, Meta(ge=0, le=0.01, description="slow variation of the speed, share")] = 2e-5
    return_mode: Annotated[Literal["strongest", "last", "dual"], Meta(description="as in the packets")] = "strongest"
    start_s: Annotated[float, Meta(ge=0, description="first firing after t0")] = 0.62
    stop_s: Annotated[float, Meta(ge=0, le=0.7, description="last firing after the end of the drive")] = 0.3
    laser_bias_m: Annotated[float, Meta(ge=0, description="constant range error a laser, standard deviation")] = 0.003
    min_range_m: Annotated[float, Meta(ge=0, description="nothing nearer is measured")] = 0.5
    max_range_m: Annotated[float, Meta(gt=1, le=130, description="nothing farther is measured")] = 100.0
    position_packets: Annotated[bool, Meta(description="a receiver disciplines the sensor (GPRMC and PPS)")] = True
    gzip: Annotated[bool, Meta(description="write recording.pcap.gz")] = False

    def __post_init__(self) -> None:
        self._fill(true_xyz_m=self.xyz_m, true_rpy_deg=self.rpy_deg)


class Noise(_Table, frozen=True):
    """What goes wrong on the way of a pulse."""

    range_m: Annotated[float, Meta(ge=0, description="of a range at right angles, standard deviation")] = 0.010
    grazing: Annotated[
        float,
        Meta(
            ge=0, le=2, description="the noise grows with cos(incidence) to minus this power, at most fivefold; 0: not"
        ),
    ] = 0.25
    dropout: Annotated[
        float, Meta(ge=0, lt=1, description="share of pulses lost, more far away and at grazing angles; 0: none at all")
    ] = 0.010
    dust: Annotated[float, Meta(ge=0, description="returns from dust at the working tool, a metre of way")] = 0.030


class Clock(_Table, frozen=True):
    """Clocks beside UTC."""

    computer_minus_utc_s: Annotated[float, Meta(description="the recording computer's clock")] = 0.83
    jitter_s: Annotated[float, Meta(ge=0, description="of its time stamps, always late")] = 0.00025
    lidar_minus_gnss_s: Annotated[float, Meta(description="lidar clock minus GNSS clock, as the session states it")] = (
        0.0
    )
    true_lidar_minus_gnss_s: Annotated[float, Meta(description="what it really is")] = _BY_KIND

    def __post_init__(self) -> None:
        self._fill(true_lidar_minus_gnss_s=self.lidar_minus_gnss_s)


class Receiver(_Table, frozen=True):
    """Errors of a GNSS receiver: white, Gauss-Markov of first order, and constant."""

    white_m: Annotated[float, Meta(ge=0, description="white, each horizontal axis")] = _BY_KIND
    gm_m: Annotated[float, Meta(ge=0, description="Gauss-Markov, each horizontal axis")] = _BY_KIND
    tau_s: Annotated[float, Meta(gt=0, description="its correlation time")] = _BY_KIND
    white_h_m: Annotated[float, Meta(ge=0, description="white, height")] = _BY_KIND
    gm_h_m: Annotated[float, Meta(ge=0, description="Gauss-Markov, height")] = _BY_KIND
    tau_h_s: Annotated[float, Meta(gt=0, description="its correlation time")] = _BY_KIND
    bias_h_m: Annotated[float, Meta(ge=0, description="standard deviation of the constant height error")] = _BY_KIND
    outage_s: Annotated[tuple[tuple[float, float], ...], Meta(description="[from, to] after t0: no sentences")] = ()
    float_s: Annotated[
        tuple[tuple[float, float], ...], Meta(description="[from, to] after t0: ambiguities not fixed")
    ] = ()
    float_error_m: Annotated[float, Meta(ge=0, description="constant horizontal error while float")] = 0.2
    rate_hz: Annotated[Literal[1, 2, 5, 10, 20], Meta(description="positions a second")] = 10


_CLAS: Final = {"white_m": 0.004, "gm_m": 0.010, "tau_s": 80.0, "white_h_m": 0.006, "gm_h_m": 0.030, "tau_h_s": 100.0}
_RTK: Final = {"white_m": 0.003, "gm_m": 0.003, "tau_s": 60.0, "white_h_m": 0.005, "gm_h_m": 0.005, "tau_h_s": 60.0}


class Gnss(_Table, frozen=True):
    """The receiver of the recording (`clas`) and the better one beside it (`rtk`), on the same antenna."""

    clas: Receiver = Receiver()
    rtk: Receiver = Receiver()

    def __post_init__(self) -> None:
        for name, usual in (("clas", {**_CLAS, "bias_h_m": 0.030}), ("rtk", {**_RTK, "bias_h_m": 0.0})):
            receiver = msgspec.structs.replace(getattr(self, name))
            receiver._fill(**usual)
            msgspec.structs.force_setattr(self, name, receiver)


class Scenario(_Table, frozen=True):
    """A recording to be simulated. Without any key it is a tidy session of about a minute."""

    name: Annotated[str, Meta(description="of the recording")] = "simulated"
    title: Annotated[str, Meta(description="of the session")] = "A simulated session"
    seed: Annotated[int, Meta(ge=0, description="the same scenario and seed give the same bytes")] = 1
    t0: Annotated[str, Meta(description="start, ISO 8601 with offset from UTC")] = "2026-06-11T01:23:40.300+00:00"
    posts: Annotated[
        tuple[tuple[float, float, float, float], ...],
        Meta(description="[east, north from the grid's corner, radius, height]"),
    ] = ()
    walls: Annotated[
        tuple[tuple[float, float, float, float, float, float, float], ...],
        Meta(
            description="[east, north of the middle, direction in degrees counter-clockwise from east, length, "
            "thickness, height, brightness (1 to 19)]"
        ),
    ] = ()
    place: Place = Place()
    field: Field = Field()
    drive: Drive = Drive()
    soil: Soil = Soil()
    sway: Sway = Sway()
    tractor: Tractor = Tractor()
    implement: Implement = Implement()
    antenna: Antenna = Antenna()
    lidar: Lidar = Lidar()
    noise: Noise = Noise()
    clock: Clock = Clock()
    gnss: Gnss = Gnss()

    def __post_init__(self) -> None:
        if dt.datetime.fromisoformat(self.t0).tzinfo is None:
            raise ValueError("`t0` has no offset from UTC")
        left = self.soil.worked or {"tiller": "tilled", "plow": "ploughed", "mower": "same"}[self.implement.shape]
        worked = SOILS[self.soil.kind if left == "same" else left]
        soil = msgspec.structs.replace(self.soil, worked=left)
        soil._fill(tilled_sigma_m=worked["sigma"], tilled_corr_m=worked["corr"], furrow_m=worked["furrow"])
        msgspec.structs.force_setattr(self, "soil", soil)

    @property
    def t0_us(self) -> int:
        """Start in microseconds of UTC since 1970."""
        since = dt.datetime.fromisoformat(self.t0) - dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
        return since // dt.timedelta(microseconds=1)
