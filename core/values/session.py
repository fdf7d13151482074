"""The session: what a user states in `session.toml`; docs/reference/session.md describes each key."""

import datetime as dt
import math
from typing import TYPE_CHECKING, Annotated, Final, Literal

import msgspec
from msgspec import Meta

from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.core.values.rotation import Mounting

SESSION_SCHEMA: Final = 1

REPLACE: Final = "replace"
CHECK: Final = "check"
"""Use of external tool states: they replace those detected in the scans, or are compared with them."""

AS_RECORDED: Final = "as-recorded"
CURRENT_EPOCH: Final = "current-epoch"
"""Values of `coordinates`, besides a frame and epoch."""
ELLIPSOIDAL: Final = "ellipsoidal"
"""Value of `heights` without a geoid model."""

Vector3 = tuple[float, float, float]
ORIGIN: Final[Vector3] = (0.0, 0.0, 0.0)
if TYPE_CHECKING:
    Language = str
else:
    Language = Literal[LANGUAGES]  # one of those that are there: no type that is known before
_Positive = Annotated[float, Meta(gt=0.0)]
_OffsetS = Annotated[float, Meta(ge=-4e9, le=4e9)]
_TargetM = Annotated[float, Meta(ge=0.05, le=5.0)]
"""Between two clocks, one of which may begin in 1904, or be a century wrong; times keep a microsecond."""


class TomlTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a TOML file: frozen, and strict about its keys."""


class Recording(TomlTable, frozen=True):
    """`[recording]`: the files, and the offset of their clocks."""

    lidar: tuple[str, ...] = ()
    gnss: tuple[str, ...] = ()
    gnss_topic: str | None = None
    lidar_minus_gnss_s: _OffsetS = 0.0
    date: str | None = None
    task: str | None = None
    begin: Annotated[dt.datetime, Meta(tz=True)] | None = msgspec.field(default=None, name="from")
    end: Annotated[dt.datetime, Meta(tz=True)] | None = msgspec.field(default=None, name="to")

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last UTC to use; infinite where not stated."""
        return (
            self.begin.timestamp() if self.begin is not None else -math.inf,
            self.end.timestamp() if self.end is not None else math.inf,
        )


class Crs(TomlTable, frozen=True):
    """`[crs]`: the map frame."""

    map: str
    heights: str = ELLIPSOIDAL
    coordinates: str = AS_RECORDED
    parameters: str | None = None
    geoid_grid: str | None = None


class Antenna(TomlTable, frozen=True):
    """`[antenna]`: the lever arm, the phase centre of the GNSS antenna in the vehicle frame.

    With `model` and `antex` it is that of the antenna's reference point.
    """

    xyz_m: Vector3
    model: str | None = None
    antex: str | None = None
    phase: Literal["mean", "ionosphere-free"] = "mean"
    baseline_yaw_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    heading_sigma_deg: _Positive | None = None


class Lidar(TomlTable, frozen=True):
    """`[lidar]`: the laser scanner and its mounting, or one of several `[[lidar]]`."""

    name: str = ""
    files: tuple[str, ...] = ()
    source: str | None = None
    minus_gnss_s: _OffsetS | None = None
    xyz_m: Vector3 | None = None
    rpy_deg: Vector3 | None = None
    rpy_walk_deg_rts: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    model: str | None = None

    @property
    def mounting(self) -> Mounting:
        """The mounting (extrinsic calibration) of the scanner; zero where it is not stated."""
        return Mounting(self.xyz_m or ORIGIN, self.rpy_deg or ORIGIN)


MAX_IMPLEMENT_WIDTH_M: Final = 100.0
"""No implement is wider."""


class Implement(TomlTable, frozen=True):
    """`[implement]`: the implement, or one of several `[[implement]]`."""

    width_m: Annotated[float, Meta(gt=0.0, le=MAX_IMPLEMENT_WIDTH_M)]
    xy_m: tuple[float, float]
    kind: str = ""
    working_depth_m: float | None = None
    lift_m: Annotated[float, Meta(ge=0.1, le=1.2)] | None = None
    region_m: tuple[float, float, float, float] | None = None
    learned: str | None = None
    states: tuple[str, ...] = ()
    states_use: Literal["replace", "check"] = REPLACE
    states_minus_gnss_s: _OffsetS = 0.0
    name: str = ""
    moves_soil: bool = False


class Field(TomlTable, frozen=True):
    """`[field]`: what is known of the field."""

    boundary: str | None = None
    name: str | None = None
    time_zone: str | None = None
    within: str | None = None
    check_points: str | None = None
    control_points: str | None = None
    control_disc_m: _TargetM | None = None
    control_checkerboard_m: _TargetM | None = None


class TrajectorySource(TomlTable, frozen=True):
    """`[trajectory]`: an external trajectory, used instead of GNSS and scan matching."""

    files: tuple[str, ...]
    time: Literal["utc", "gps"] | None = None
    week: Annotated[int, Meta(ge=0)] | None = None


class ImuNoise(TomlTable, frozen=True):
    """`[imu] noise`: figures of a data sheet; what is left out is that of the class."""

    gyro_deg_s_rthz: _Positive | None = None
    accel_mg_rthz: _Positive | None = None
    gyro_bias_deg_s: _Positive | None = None
    accel_bias_mg: _Positive | None = None
    gyro_walk_deg_s_rts: _Positive | None = None
    accel_walk_mg_rts: _Positive | None = None


class ImuColumn(TomlTable, frozen=True):
    """A column in `[imu] columns`."""

    quantity: str
    unit: str
    scale: float = 1.0


class Imu(TomlTable, frozen=True, rename={"kind": "class"}):
    """`[imu]`: the inertial measurement unit."""

    files: tuple[str, ...]
    topic: str | None = None
    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    kind: str = "industrial"
    noise: ImuNoise = ImuNoise()
    minus_gnss_s: _OffsetS = 0.0
    columns: dict[str, ImuColumn] = {}  # msgspec copies an empty default
    rate_unit: Literal["rad/s", "deg/s", "mrad/s", "mdeg/s"] | None = None
    force_unit: Literal["m/s2", "g", "mg"] | None = None
    rate_scale: _Positive = 1.0
    force_scale: _Positive = 1.0
    on_wheels: bool = False
    heading: Literal["motion", "attitude", "antennas"] = "motion"


class Attitude(TomlTable, frozen=True):
    """`[attitude]`: logs of attitude and heading reference systems (AHRS), where there are no raw measurements."""

    roll_pitch: str
    heading: str
    roll_pitch_topic: str | None = None
    heading_topic: str | None = None
    north: Literal["true", "grid", "magnetic"] | None = None
    declination_deg: Annotated[float, Meta(ge=-180.0, le=180.0)] | None = None
    roll_pitch_rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    heading_rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    roll_pitch_sigma_deg: _Positive | None = None
    heading_sigma_deg: _Positive | None = None


class Mount(TomlTable, frozen=True):
    """`[mount]`: a mount of the scanner that moves against the vehicle."""

    attitude: str
    xyz_m: Vector3 | None = None


class CameraSource(TomlTable, frozen=True):
    """`[camera]`: a camera on the vehicle, and its images."""

    table: str | None = None
    files: tuple[str, ...] = ()
    topic: str | None = None
    every_s: Annotated[float, Meta(ge=0.0)] = 0.0
    width: Annotated[int, Meta(ge=1, le=65_535)] | None = None  # as in JPEG
    height: Annotated[int, Meta(ge=1, le=65_535)] | None = None
    fx: _Positive | None = None
    fy: _Positive | None = None
    cx: float | None = None
    cy: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    model: str | None = None
    params: tuple[float, ...] = ()
    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    shutter_delay_s: _OffsetS = 0.0
    minus_gnss_s: _OffsetS = 0.0
    aid: bool = True
    control_points: str | None = None
    control_pixels: str | None = None

    @property
    def has_intrinsics(self) -> bool:
        """Whether its size or any of its intrinsics is stated."""
        pinhole = (self.fx, self.fy, self.cx, self.cy)
        return any(value is not None for value in (self.width, self.height, *pinhole, self.model))

    @property
    def is_known(self) -> bool:
        """Whether its intrinsics are stated, or may be recorded with the images."""
        return self.has_intrinsics or self.topic is not None

    @property
    def mounting(self) -> Mounting:
        """The mounting (extrinsic calibration) of the camera."""
        return Mounting(self.xyz_m, self.rpy_deg)


class Parcels(TomlTable, frozen=True):
    """`[parcels]`: the parcels of a trial."""

    file: str
    net_inset_m: tuple[Annotated[float, Meta(ge=0.0)], Annotated[float, Meta(ge=0.0)]] = (0.0, 0.0)
    treatments: str | None = None
    method: str | None = None
    soil: str | None = None


class FeatureSearch(TomlTable, frozen=True):
    """`[features]`: planes, lines and plants are looked for in the cloud."""

    ground: Literal["class", "smrf"] | None = None
    voxel_m: Annotated[float, Meta(ge=0.02, le=2.0)] | None = None


class Run(TomlTable, frozen=True):
    """`[run]`: processing options."""

    standing: bool = True
    fixes: tuple[str, ...] | None = None
    threads: Annotated[int, Meta(ge=1)] | None = None


class Report(TomlTable, frozen=True):
    """`[report]`: how the report page is written."""

    language: Language | None = None
    area_unit: Literal["ha", "10a", "acre"] = "ha"


class Session(TomlTable, frozen=True):
    """The content of a session file.

    Attributes:
        furrowmap: schema version.
        recording, crs, antenna, lidar, imu, attitude, mount, implement, field, trajectory, camera, parcels, features,
            run, report: the tables; `implement` is the one that moves soil, of several.
        further_implements: the others of several `[[implement]]`, in their order.
        further_lidars: the others of several `[[lidar]]` than the first, from which the trajectory comes.
    """

    furrowmap: int
    recording: Recording
    crs: Crs
    name: str = ""
    antenna: Antenna | None = None
    lidar: Lidar = Lidar()
    imu: Imu | None = None
    attitude: Attitude | None = None
    mount: Mount | None = None
    implement: Implement | None = None
    field: Field = Field()
    trajectory: TrajectorySource | None = None
    parcels: Parcels | None = None
    features: FeatureSearch | None = None
    run: Run = Run()
    report: Report = Report()
    camera: CameraSource | None = None
    further_implements: tuple[Implement, ...] = ()
    further_lidars: tuple[Lidar, ...] = ()

    @property
    def lidars(self) -> tuple[Lidar, ...]:
        """All scanners, that from which the trajectory comes first, each with its files and the offset of its clock."""
        own = (self.lidar, *self.further_lidars)
        return tuple(
            msgspec.structs.replace(
                lidar,
                files=lidar.files or self.recording.lidar,
                minus_gnss_s=self.recording.lidar_minus_gnss_s if lidar.minus_gnss_s is None else lidar.minus_gnss_s,
            )
            for lidar in own
        )

    @property
    def implements(self) -> tuple[Implement, ...]:
        """All implements, the one that moves soil first."""
        return (self.implement, *self.further_implements) if self.implement is not None else ()

    @property
    def unstated(self) -> tuple[str, ...]:
        """Keys of the places that a cloud rests on and that are not stated: zero is then assumed.

        Without a scanner there is no cloud; poses of [trajectory] are those of the vehicle, whatever the antenna.
        """
        if not self.recording.lidar:
            return ()
        known = {
            "antenna.xyz_m": self.antenna is not None or self.trajectory is not None,
            "lidar.xyz_m": all(lidar.xyz_m is not None for lidar in self.lidars),
            "lidar.rpy_deg": all(lidar.rpy_deg is not None for lidar in self.lidars),
        }
        return tuple(key for key, stated in known.items() if not stated)


EXAMPLES: Final = {
    "name": '"North field"',
    "recording.lidar": '["recording.pcap"]',
    "recording.gnss": '["gnss.nmea"]',
    "recording.gnss_topic": '"/gps/fix"',
    "recording.lidar_minus_gnss_s": "0.0",
    "recording.date": '"2026-06-11"',
    "recording.task": '"TSK1"',
    "recording.from": '"2026-06-11T14:00:00+09:00"',
    "recording.to": '"2026-06-11T14:35:00+09:00"',
    "crs.map": '"EPSG:6677"',
    "crs.heights": '"EGM2008"',
    "crs.coordinates": '"current-epoch"',
    "crs.parameters": '"SemiDyna2026.par"',
    "crs.geoid_grid": '"us_nga_egm08_25.tif"',
    "antenna.xyz_m": "[1.85, 0.0, 1.62]",
    "antenna.model": '"TRM57971.00 NONE"',
    "antenna.antex": '"igs20.atx"',
    "antenna.phase": '"ionosphere-free"',
    "antenna.baseline_yaw_deg": "90.0",
    "antenna.heading_sigma_deg": "0.3",
    "lidar.name": '"rear"',
    "lidar.files": '["recording.pcap"]',
    "lidar.source": '"192.168.1.202"',
    "lidar.minus_gnss_s": "0.0",
    "lidar.model": '"VLP-16"',
    "lidar.xyz_m": "[-0.55, 0.0, 2.35]",
    "lidar.rpy_deg": "[0.0, 40.0, 180.0]",
    "lidar.rpy_walk_deg_rts": "0.0",
    "imu.files": '["imu.csv"]',
    "imu.topic": '"/imu/data"',
    "imu.xyz_m": "[-0.04, -0.01, -0.29]",
    "imu.rpy_deg": "[180.0, 0.0, 0.0]",
    "imu.class": '"VN-200"',
    "imu.minus_gnss_s": "0.0",
    "imu.on_wheels": "true",
    "imu.heading": '"attitude"',
    "imu.columns": '{ gyroX = { quantity = "gyro_x", unit = "deg/s" } }',
    "imu.rate_unit": '"deg/s"',
    "imu.force_unit": '"g"',
    "imu.rate_scale": "1.0",
    "imu.force_scale": "1.0",
    "imu.noise": "{ gyro_deg_s_rthz = 0.0035, accel_mg_rthz = 0.14 }",
    "attitude.roll_pitch": '"ahrs_imu.csv"',
    "attitude.heading": '"ahrs_aircraft.csv"',
    "attitude.roll_pitch_topic": '"/vectornav/IMU"',
    "attitude.heading_topic": '"/dji_sdk/attitude"',
    "attitude.north": '"true"',
    "attitude.declination_deg": "4.2",
    "attitude.roll_pitch_rpy_deg": "[180.0, 0.0, 0.0]",
    "attitude.heading_rpy_deg": "[0.0, 0.0, 90.0]",
    "attitude.roll_pitch_sigma_deg": "0.4",
    "attitude.heading_sigma_deg": "1.0",
    "mount.attitude": '"mount.csv"',
    "mount.xyz_m": "[0.0, 0.0, -0.2]",
    "implement.kind": '"rotary tiller"',
    "implement.width_m": "1.70",
    "implement.xy_m": "[-1.45, 0.0]",
    "implement.working_depth_m": "0.12",
    "implement.lift_m": "0.45",
    "implement.region_m": "[-3.5, -0.9, -1.2, 1.2]",
    "implement.learned": '"implement.npz"',
    "implement.states": '["states.csv"]',
    "implement.states_use": '"replace"',
    "implement.states_minus_gnss_s": "0.0",
    "implement.name": '"front roller"',
    "implement.moves_soil": "true",
    "field.boundary": '"boundary.geojson"',
    "field.name": '"North field"',
    "field.time_zone": '"Asia/Tokyo"',
    "field.within": '"part.geojson"',
    "field.check_points": '"check_points.csv"',
    "field.control_points": '"points.csv"',
    "field.control_disc_m": "0.4",
    "field.control_checkerboard_m": "0.5",
    "trajectory.files": '["trajectory.csv"]',
    "trajectory.time": '"utc"',
    "trajectory.week": "2422",
    "camera.table": '"images.csv"',
    "camera.files": '["images/*.jpg"]',
    "camera.topic": '"/camera/image_raw"',
    "camera.every_s": "0.5",
    "camera.width": "800",
    "camera.height": "600",
    "camera.fx": "661.4",
    "camera.fy": "661.9",
    "camera.cx": "402.7",
    "camera.cy": "296.1",
    "camera.k1": "-0.082",
    "camera.k2": "0.011",
    "camera.k3": "0.0",
    "camera.p1": "0.0",
    "camera.p2": "0.0",
    "camera.model": '"OPENCV"',
    "camera.params": "[661.4, 661.9, 403.2, 296.6, -0.082, 0.011, 0.0, 0.0]",
    "camera.xyz_m": "[-0.05, 0.0, -0.42]",
    "camera.rpy_deg": "[180.0, 0.0, -90.0]",
    "camera.shutter_delay_s": "0.0",
    "camera.minus_gnss_s": "0.0",
    "camera.aid": "true",
    "camera.control_points": '"control_points.csv"',
    "camera.control_pixels": '"control_pixels.csv"',
    "parcels.file": '"parcels.geojson"',
    "parcels.net_inset_m": "[1.00, 0.11]",
    "parcels.treatments": '"treatments.csv"',
    "parcels.method": '"christiansen2017"',
    "parcels.soil": '"plane"',
    "features.ground": '"smrf"',
    "features.voxel_m": "0.05",
    "run.standing": "true",
    "run.fixes": '["fixed", "float"]',
    "run.threads": "2",
    "report.language": '"ja"',
    "report.area_unit": '"10a"',
}
"""An example value for every key."""
