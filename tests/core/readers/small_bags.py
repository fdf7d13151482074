"""Small ROS bags for the tests, written by the library's own writers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
PACKET, SCAN = "velodyne_msgs/msg/VelodynePacket", "velodyne_msgs/msg/VelodyneScan"
ROS2.register(get_types_from_msg("builtin_interfaces/Time stamp\nuint8[1206] data\n", PACKET))
ROS2.register(get_types_from_msg("std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n", SCAN))

LIVOX_POINT, LIVOX = "livox_ros_driver2/msg/CustomPoint", "livox_ros_driver2/msg/CustomMsg"
for store in (ROS1, ROS2):
    point = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
    store.register(get_types_from_msg(point, LIVOX_POINT))
    cloud = "uint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\nlivox_ros_driver2/CustomPoint[] points\n"
    store.register(get_types_from_msg("std_msgs/Header header\n" + cloud, LIVOX))

T0_NS = 1_780_000_000_000_000_000
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}

Recorded = tuple[str, int, Any]
"""Topic, time of reception in ns, message."""


def write_bag1(path: Path, recorded: Sequence[Recorded], compression: str | None = None) -> Path:
    """A ROS 1 bag of the messages."""
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression])
    with writer:
        connections: dict[str, Any] = {}
        for topic, received_ns, message in recorded:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(connections[topic], received_ns, ROS1.serialize_ros1(message, kind))
    return path


def write_bag2(folder: Path, recorded: Sequence[Recorded], plugin: str = "MCAP", mode: str = "NONE") -> Path:
    """The folder of a ROS 2 bag of the messages."""
    writer = Writer2(folder, version=9, storage_plugin=StoragePlugin[plugin])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, received_ns, message in recorded:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS2)
            writer.write(connections[topic], received_ns, ROS2.serialize_cdr(message, kind))
    return folder


def header(stamp_ns: int, store: Any = ROS2) -> Any:
    """A message's header."""
    stamp = store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    extra = {"seq": 0} if store is ROS1 else {}
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="sensor", **extra)


def nav_sat_fix(
    stamp_ns: int,
    status: int = 2,
    sigma_m: float | None = 0.02,
    lat_deg: float = 43.0,
    lon_deg: float = 141.0,
    store: Any = ROS2,
) -> Any:
    """A position; `sigma_m` None: no covariance stated."""
    return store.types["sensor_msgs/msg/NavSatFix"](
        header=header(stamp_ns, store),
        status=store.types["sensor_msgs/msg/NavSatStatus"](status=status, service=1),
        latitude=lat_deg,
        longitude=lon_deg,
        altitude=55.5,
        position_covariance=np.diag([(sigma_m or 0.0) ** 2] * 2 + [4 * (sigma_m or 0.0) ** 2]).ravel(),
        position_covariance_type=0 if sigma_m is None else 2,
    )


def point_cloud(stamp_ns: int, points: NDArray[Any], store: Any = ROS2, pad: int = 0) -> Any:
    """The structured points (n,) or (height, width) as a PointCloud2, in the byte order that their fields have.

    Args:
        stamp_ns: its stamp.
        points: with the fields of the cloud.
        store: ROS1 or ROS2.
        pad: unused bytes at the end of each row.
    """
    rows = np.atleast_2d(points)
    names = rows.dtype.names or ()
    fields = [
        store.types["sensor_msgs/msg/PointField"](
            name=name, offset=rows.dtype.fields[name][1], datatype=DATATYPES[rows.dtype[name].str[1:]], count=1
        )
        for name in names
    ]
    height, width = rows.shape
    plain = np.ascontiguousarray(rows).view(np.uint8).reshape(height, -1)
    return store.types["sensor_msgs/msg/PointCloud2"](
        header=header(stamp_ns, store),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=rows.dtype["x"].str[0] == ">",
        point_step=rows.dtype.itemsize,
        row_step=plain.shape[1] + pad,
        data=np.pad(plain, ((0, 0), (0, pad))).ravel(),
        is_dense=False,
    )


def velodyne_scan(stamp_ns: int, payloads: Sequence[bytes]) -> Any:
    """Data packets that a driver packed together."""
    at = header(stamp_ns)
    packets = [ROS2.types[PACKET](stamp=at.stamp, data=np.frombuffer(data, np.uint8)) for data in payloads]
    return ROS2.types[SCAN](header=at, packets=packets)


def revolution(n: int = 64, seed: int = 0) -> NDArray[Any]:
    """n random returns with x, y, z, intensity, ring and time (0 to 0.1 s)."""
    random = np.random.default_rng(seed)
    points = np.zeros(
        n, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")]
    )
    for axis in "xyz":
        points[axis] = random.uniform(1, 50, n)
    points["intensity"] = random.integers(0, 256, n)
    points["ring"] = np.arange(n) % 16
    points["time"] = np.linspace(0, 0.1, n)
    return points


def mixed(store: Any = ROS2, clouds: int = 3, points: int = 64) -> list[Recorded]:
    """Clouds every 0.1 s, positions every 0.05 s, and an Imu message nobody reads."""
    recorded: list[Recorded] = []
    for k in range(clouds):
        at_ns = T0_NS + k * 100_000_000
        recorded += [
            ("/points", at_ns + 3_000_000, point_cloud(at_ns, revolution(points, k), store)),
            ("/fix", at_ns + 10_000_000, nav_sat_fix(at_ns, store=store)),
            ("/fix", at_ns + 60_000_000, nav_sat_fix(at_ns + 50_000_000, store=store)),
        ]
    imu = store.types["sensor_msgs/msg/Imu"]
    vector, turn = store.types["geometry_msgs/msg/Vector3"](x=0, y=0, z=0), store.types["geometry_msgs/msg/Quaternion"]
    recorded.append(
        (
            "/imu",
            recorded[-1][1] + 1,
            imu(
                header=header(T0_NS, store),
                orientation=turn(x=0, y=0, z=0, w=1),
                orientation_covariance=np.zeros(9),
                angular_velocity=vector,
                angular_velocity_covariance=np.zeros(9),
                linear_acceleration=vector,
                linear_acceleration_covariance=np.zeros(9),
            ),
        )
    )
    return recorded


def livox_cloud(stamp_ns: int, points: NDArray[Any], store: Any = ROS2) -> Any:
    """A CustomMsg of a Livox's driver; `points` has offset_time, x, y, z, reflectivity, tag and line."""
    return store.types[LIVOX](
        header=header(stamp_ns, store),
        timebase=stamp_ns,
        point_num=len(points),
        lidar_id=1,
        rsvd=np.zeros(3, np.uint8),
        points=[store.types[LIVOX_POINT](*point.tolist()) for point in points],
    )
