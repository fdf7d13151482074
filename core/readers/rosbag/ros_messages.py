"""ROS messages as `rosbags` deserialises them; positions, attitudes and inertial measurements collected from them.

An Imu message has specific force in m/s² and angular rate in rad/s, along the axes of its frame (REP-103, REP-145); at
rest the force points up. A covariance that begins with −1 means that its quantity was not measured.

Definitions: the ROS packages sensor_msgs, velodyne_msgs, pandar_msgs (also named hesai_lidar), hesai_ros_driver,
nmea_msgs, livox_ros_driver and livox_ros_driver2 (CustomMsg and CustomPoint), and dji_sdk. DJI's node publishes
attitudes as AttitudeQuaternion (forward, right, down to north, east, down) and positions as GlobalPosition up to
version 3.2, and both as messages of ROS from 3.3 on; its headings are from true north, its heights from the barometer,
above sea level. `rosbags` is imported with the first message, because all readers are imported at each start.
"""

from __future__ import annotations

import math
import struct
from array import array
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.longitudes import signed_deg
from furrowmap.core.readers.inertial_rows import attitude_track, first_beyond, inertial_track
from furrowmap.core.readers.nmea.log import assemble
from furrowmap.core.readers.nmea.sentences import Kind, SentenceCounts, Sentences, are_unchecked, scan_bytes
from furrowmap.core.readers.position_log import LoggedPositions
from furrowmap.core.readers.rosbag.bag_storage import BagMessage, Damage, decompress_message
from furrowmap.core.readers.velodyne.captures import PACKET_BYTES
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import DAY_S, nearest_in_cycle
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.inertial import InertialTrack, StatedUnits
from furrowmap.core.values.pose_track import TRUE_NORTH, UNSTATED_NORTH, AttitudeTrack
from furrowmap.core.values.rotation import quaternion_to_attitude

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


LIVOX_CLOUDS: Final = ("livox_ros_driver2/msg/CustomMsg", "livox_ros_driver/msg/CustomMsg")
_CUSTOM: Final = {
    "offset_time": (6, 0), "x": (7, 4), "y": (7, 8), "z": (7, 12), "reflectivity": (2, 16), "line": (2, 18),
}  # fmt: skip
"""Field → datatype as in PointCloud2, and offset."""
_CUSTOM_BYTES: Final = 19


def livox_cloud(data: bytes, encoding: str) -> Any:
    """The content of a serialised CustomMsg, with the attributes of a PointCloud2.

    Times of points are nanoseconds from the message's stamp, which is that of the first point. Damage if the bytes are
    not such a message.
    """
    ros1 = encoding == "ros1"
    try:
        if ros1:
            _, sec, nanosec, text = struct.unpack_from("<IIII", data, 0)
            at = 16 + text + 8 + 4 + 4  # time of the first point, number of points, lidar
        else:
            if data[:2] != b"\x00\x01":
                raise Damage("not little-endian CDR")
            sec, nanosec, text = struct.unpack_from("<iII", data, 4)
            at = 4 + (12 + text + 7) // 8 * 8 + 8 + 4 + 4  # aligned to 8 bytes from the end of the first four
        (points,) = struct.unpack_from("<I", data, at)
    except struct.error:
        raise Damage(f"{len(data)} bytes are no CustomMsg") from None
    step = _CUSTOM_BYTES + (not ros1)  # CDR aligns each point to 4 bytes, but does not fill up the last
    there = len(data) - at - 4
    if points and not points * step - (step - _CUSTOM_BYTES) <= there <= points * step:
        raise Damage(f"{points} points do not match {there} bytes of data")
    frame = data[16 : 16 + text].rstrip(b"\0").decode("utf-8", "replace")
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=frame),
        height=1,
        width=points,
        point_step=step,
        row_step=points * step,
        is_bigendian=False,
        is_dense=True,
        fields=[SimpleNamespace(name=name, datatype=kind, offset=offset) for name, (kind, offset) in _CUSTOM.items()],
        data=np.frombuffer(data[at + 4 :].ljust(points * step, b"\0"), np.uint8),
    )


NOT_MEASURED: Final = -1.0
"""First value of a covariance whose quantity was not measured (sensor_msgs/Imu)."""

RATE: Final = "angular velocity"
FORCE: Final = "linear acceleration"


class NotMeasured(Exception):
    """A message states that it has no such quantity."""


def unmeasured(content: Any) -> str:
    """Which quantity an Imu message states not to have; empty if it has both."""
    if content.angular_velocity_covariance[0] == NOT_MEASURED:
        return RATE
    return FORCE if content.linear_acceleration_covariance[0] == NOT_MEASURED else ""


class _RowLog:
    """Rows of numbers collected from messages: first the stamp, last the time of reception."""

    _columns: ClassVar[int]

    def __init__(self) -> None:
        self._rows = array("d")

    @property
    def _table(self) -> FloatArray:
        return np.array(self._rows).reshape(-1, self._columns)

    def delay_s(self) -> float:
        """Median of reception minus stamp."""
        table = self._table
        return float(np.median(table[:, -1] - table[:, 0]))


class ImuLog(_RowLog):
    """Stamp, angular rate, specific force and orientation (w, x, y, z) collected from Imu messages."""

    _columns = 12
    frame_id = ""

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message; Damage if its values are no numbers, NotMeasured if it states that it has no such values."""
        if lacking := unmeasured(content):
            raise NotMeasured(lacking)
        rate = content.angular_velocity
        force = content.linear_acceleration
        values = (rate.x, rate.y, rate.z, force.x, force.y, force.z)
        if not np.isfinite(values).all():
            raise Damage(Text("its angular velocity or linear acceleration is not a number"))
        self._rows.extend((stamp_s(content, message), *values, *_orientation(content), message.received_ns * 1e-9))
        self.frame_id = self.frame_id or str(content.header.frame_id)

    def oriented(self) -> int:
        """Number of messages with an orientation."""
        return int(_is_turn(self._table[:, 7:11]).sum())

    def track(self, source: str, units: StatedUnits) -> tuple[InertialTrack, list[Notice]]:
        """All measurements in order; InputError if the stamps do not increase, or no IMU measures such values."""
        table = self._table
        values = units.in_si(table[:, 1:7])
        beyond = first_beyond(values)
        if beyond is not None:
            count, row, first = beyond
            raise InputError(
                "value-out-of-range.sensor-messages",
                source=source,
                count=count,
                table=table[row, 1 + first : 4 + first].tolist(),
                is_first=first == 0,
            )
        return inertial_track(table[:, 0], values, source)


class AttitudeLog(_RowLog):
    """Stamp and orientation (w, x, y, z) collected from Imu, QuaternionStamped or AttitudeQuaternion messages."""

    _columns = 6

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message."""
        self._rows.extend((stamp_s(content, message), *_orientation(content), message.received_ns * 1e-9))

    def attitude(self, source: str, *, true_north: bool) -> tuple[AttitudeTrack, list[Notice]]:
        """The orientations, of the axes of the device against east, north and up (REP-103).

        The messages do not state whether north is the true one. InputError if there are none, or the stamps do not
        increase.
        """
        table = self._table
        known = _is_turn(table[:, 1:5])
        if not known.any():
            raise InputError("no-orientation", source=source, table=len(table))
        angles = np.column_stack(quaternion_to_attitude(table[known, 1:5]))
        return attitude_track(table[known, 0], angles, TRUE_NORTH if true_north else UNSTATED_NORTH, source)


def _orientation(content: Any) -> tuple[float, ...]:
    """The rotation (w, x, y, z) from forward, left, up to east, north, up; nan where it is not measured."""
    if hasattr(content, "q0"):
        w = content.q0
        x = content.q1
        y = content.q2
        z = content.q3
        # (w, x, -y, -z) is the rotation to north, west, up: a quarter turn about up is left
        return tuple(math.sqrt(0.5) * part for part in (w + z, x + y, x - y, w - z))
    if hasattr(content, "orientation_covariance") and content.orientation_covariance[0] == NOT_MEASURED:
        return (math.nan,) * 4
    turn = content.orientation if hasattr(content, "orientation") else content.quaternion
    return turn.w, turn.x, turn.y, turn.z


def _is_turn(quaternion: FloatArray) -> NDArray[np.bool_]:
    """Whether quaternions (n, 4) are rotations: of norm 1."""
    known: NDArray[np.bool_] = np.isclose(np.linalg.norm(quaternion, axis=1), 1.0, atol=0.01)
    return known


POINT_CLOUD: Final = "sensor_msgs/msg/PointCloud2"
PACKET_SCANS: Final = {
    "velodyne_msgs/msg/VelodyneScan": "Velodyne",
    "pandar_msgs/msg/PandarScan": "Hesai",
    "hesai_lidar/msg/PandarScan": "Hesai",
    "hesai_ros_driver/msg/UdpFrame": "Hesai",
    "ouster_ros/msg/PacketMsg": "Ouster",
    "ouster_msgs/msg/PacketMsg": "Ouster",
    "ouster_sensor_msgs/msg/PacketMsg": "Ouster",
}
"""Type of messages of packets → maker of the scanner."""
TEXT: Final = "std_msgs/msg/String"
LASER_SCAN: Final = "sensor_msgs/msg/LaserScan"
NAV_SAT_FIX: Final = "sensor_msgs/msg/NavSatFix"
SENTENCE: Final = "nmea_msgs/msg/Sentence"
IMU: Final = "sensor_msgs/msg/Imu"
QUATERNION: Final = "geometry_msgs/msg/QuaternionStamped"
DJI_ATTITUDE: Final = "dji_sdk/msg/AttitudeQuaternion"
DJI_POSITION: Final = "dji_sdk/msg/GlobalPosition"
IMAGE: Final = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE: Final = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO: Final = "sensor_msgs/msg/CameraInfo"

FIXED_SIGMA_M: Final = 0.10
"""Largest horizontal standard deviation of an RTK fix in a NavSatFix with ground-based augmentation: integer
ambiguities give centimetres, float ones decimetres."""

_DEFINITIONS: Final = {
    "velodyne_msgs/msg/VelodynePacket": f"builtin_interfaces/Time stamp\nuint8[{PACKET_BYTES}] data\n",
    "velodyne_msgs/msg/VelodyneScan": "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n",
    "pandar_msgs/msg/PandarPacket": "builtin_interfaces/Time stamp\nuint8[1500] data\nuint32 size\n",
    "pandar_msgs/msg/PandarScan": "std_msgs/Header header\npandar_msgs/PandarPacket[] packets\n",
    "hesai_lidar/msg/PandarPacket": "builtin_interfaces/Time stamp\nuint8[] data\nuint32 size\n",
    "hesai_lidar/msg/PandarScan": "std_msgs/Header header\nhesai_lidar/PandarPacket[] packets\n",
    "hesai_ros_driver/msg/UdpPacket": "builtin_interfaces/Time stamp\nuint8[] data\nuint32 size\n",
    "hesai_ros_driver/msg/UdpFrame": "std_msgs/Header header\nhesai_ros_driver/UdpPacket[] packets\n",
    **{name: "uint8[] buf\n" for name, maker in PACKET_SCANS.items() if maker == "Ouster"},
    SENTENCE: "std_msgs/Header header\nstring sentence\n",
    DJI_ATTITUDE: "std_msgs/Header header\nint32 ts\n"
    + "".join(f"float32 {name}\n" for name in ("q0", "q1", "q2", "q3", "wx", "wy", "wz")),
    DJI_POSITION: "std_msgs/Header header\nint32 ts\nfloat64 latitude\nfloat64 longitude\n"
    "float32 altitude\nfloat32 height\nint8 health\n",
}
"""Those that the stores of `rosbags` do not have."""


def deserialize(message: BagMessage) -> Any:
    """The message as `rosbags` deserialises it, with the fields of its definition.

    Damage if it is none of this type.
    """
    if message.encoding not in ("ros1", "cdr"):
        raise Damage(Text("unsupported encoding {encoding!r}", encoding=message.encoding))
    if message.type in LIVOX_CLOUDS:
        return livox_cloud(decompress_message(message.data), message.encoding)
    store = _typestore(message.encoding)
    try:
        if message.encoding == "ros1":
            return store.deserialize_ros1(message.data, message.type)
        return store.deserialize_cdr(decompress_message(message.data), message.type)
    except Exception as error:  # noqa: BLE001 (the one boundary: on damage rosbags raises whatever comes)
        raise Damage(str(error) or type(error).__name__) from None


@cache
def _typestore(encoding: str) -> Typestore:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    for name, definition in _DEFINITIONS.items():
        store.register(get_types_from_msg(definition, name))
    return store


def stamp_s(content: Any, message: BagMessage) -> float:
    """The stamp in a message's header as UTC; the time of reception if the driver left it at 0."""
    return seconds(content.header.stamp) or message.received_ns * 1e-9


def seconds(stamp: Any) -> float:
    """A time of a message in seconds."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


class FixLog(_RowLog):
    """A track collected from NavSatFix or GlobalPosition messages.

    The status of a NavSatFix is a fix (0), one with satellite-based augmentation (1) or with ground-based augmentation
    (2). These become single, dgps, and fixed or float by the stated standard deviation. Its altitude is above the
    ellipsoid by definition. A GlobalPosition is single, and none at health 0.
    """

    _columns = 9

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message; Damage if its coordinates are out of range."""
        lat = float(content.latitude)
        lon = float(content.longitude)
        height = float(content.altitude)
        if abs(lat) > 90.0 or abs(lon) > 360.0:
            raise Damage(
                Text("latitude {lat_deg:g} or longitude {lon_deg:g} is out of range", lat_deg=lat, lon_deg=lon)
            )
        lon = float(signed_deg(np.array([lon]))[0])
        sigma = np.full(3, np.nan)
        if hasattr(content, "health"):
            fix = Fix.SINGLE if content.health else Fix.NONE
        else:
            fix = {0: Fix.SINGLE, 1: Fix.DGPS, 2: Fix.FLOAT}.get(int(content.status.status), Fix.NONE)
            if int(content.position_covariance_type) > 0:
                with np.errstate(invalid="ignore"):
                    sigma = np.sqrt(np.asarray(content.position_covariance, np.float64)[::4])
        if fix is Fix.FLOAT and np.hypot(sigma[0], sigma[1]) <= FIXED_SIGMA_M:
            fix = Fix.FIXED
        if not np.isfinite((lat, lon)).all():
            fix = Fix.NONE
        at_s = stamp_s(content, message)
        received_s = message.received_ns * 1e-9
        self._rows.extend((at_s, lon, lat, height, float(fix), *map(float, sigma), received_s))

    def track(self, source: str) -> tuple[GnssTrack, list[Notice]]:
        """All positions in the order of their stamps, and what is unusual about them."""
        table = self._table[:, :-1]
        notices = []
        back = int((np.diff(table[:, 0]) <= 0).sum())
        if back:
            notices.append(Notice("gnss-time-back", source=source, back=back))
            table = table[np.unique(table[:, 0], return_index=True)[1]]
        columns = dict(zip(("lon_deg", "lat_deg", "height_m", "fix"), table[:, 1:5].T, strict=True))
        sigmas = dict(zip(("sigma_e_m", "sigma_n_m", "sigma_h_m"), table[:, 5:].T, strict=True))
        ground = {Fix(code).label: int((table[:, 4] == code).sum()) for code in (Fix.FIXED, Fix.FLOAT)}
        if any(ground.values()):
            notices.append(
                Notice(
                    "gnss-fix-guessed",
                    source=source,
                    ground=ground["fixed"],
                    fixed_sigma_m=FIXED_SIGMA_M,
                    assumed_float=ground["float"],
                )
            )
        return GnssTrack.build(table[:, 0], source=source, **columns, **sigmas), notices


class SentenceLog:
    """Positions collected from the sentences of one topic.

    They are assembled as those of logs of NMEA 0183. Times are those of the sentences; a log without dates has the date
    of the stamps.
    """

    def __init__(self) -> None:
        self._lines: list[bytes] = []
        self._received_s: list[float] = []
        self._first_s = 0.0

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message."""
        if not self._lines:
            self._first_s = stamp_s(content, message)
        self._lines.append(content.sentence.encode("latin-1", "replace").strip() + b"\r\n")
        self._received_s.append(message.received_ns * 1e-9)

    def positions(self, source: str, date: str | None) -> LoggedPositions:
        """The positions of the receiver; see :func:`~furrowmap.core.readers.nmea.log.assemble`, also for errors."""

        def place(at: int) -> str:
            return f"{source}, message {self._message(np.array([at]))[0]}"

        return assemble(self._sentences(), source, date=date, near_s=self._first_s, place=place)

    def delay_s(self) -> float:
        """Median of the reception of sentences minus the times in them."""
        sentences = self._sentences()
        timed = sentences[(sentences.kind == Kind.GGA) | (sentences.kind == Kind.GNS)]
        received = np.array(self._received_s)[self._message(timed.at)]
        return float(np.nanmedian(received - nearest_in_cycle(timed.values[:, 0], received, DAY_S)))

    def _sentences(self) -> Sentences:
        data = b"".join(self._lines)
        return scan_bytes(data, SentenceCounts(), unchecked=are_unchecked(data))[0]

    def _message(self, at: NDArray[np.int64]) -> NDArray[np.intp]:
        """Index of the message with each byte (n,) of the stream."""
        ends = np.cumsum([len(line) for line in self._lines])
        return np.searchsorted(ends, at, side="right")
