"""Messages of IMUs and of NMEA sentences for small bags."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rosbags.typesys import get_types_from_msg

from tests.core.readers.small_bags import ROS1, ROS2, T0_NS, Recorded, header

for _store in (ROS1, ROS2):
    _store.register(get_types_from_msg("std_msgs/Header header\nstring sentence\n", "nmea_msgs/msg/Sentence"))
for _name, _fields in {
    "AttitudeQuaternion": "float32 q0\nfloat32 q1\nfloat32 q2\nfloat32 q3\nfloat32 wx\nfloat32 wy\nfloat32 wz\n",
    "GlobalPosition": "float64 latitude\nfloat64 longitude\nfloat32 altitude\nfloat32 height\nint8 health\n",
}.items():
    ROS1.register(get_types_from_msg(f"std_msgs/Header header\nint32 ts\n{_fields}", f"dji_sdk/msg/{_name}"))


def imu(
    stamp_ns: int,
    rate_radps: Sequence[float] = (0.0, 0.0, 0.0),
    force_mps2: Sequence[float] = (0.0, 0.0, 9.81),
    quaternion: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
    without: str = "",
    store: Any = ROS2,
) -> Any:
    """An Imu message; `quaternion` is x, y, z, w, `without` names the quantity whose covariance begins with −1."""
    vector, turn = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
    covariance = {name: np.zeros(9) for name in ("orientation", "angular_velocity", "linear_acceleration")}
    if without:
        covariance[without][0] = -1.0
    return store.types["sensor_msgs/msg/Imu"](
        header=header(stamp_ns, store),
        orientation=turn(*map(float, quaternion)),
        orientation_covariance=covariance["orientation"],
        angular_velocity=vector(*map(float, rate_radps)),
        angular_velocity_covariance=covariance["angular_velocity"],
        linear_acceleration=vector(*map(float, force_mps2)),
        linear_acceleration_covariance=covariance["linear_acceleration"],
    )


def turning_imu(count: int = 40, store: Any = ROS2, without: str = "") -> list[Recorded]:
    """Measurements every 10 ms, received 2 ms later, each different."""
    return [
        (
            "/imu/data",
            T0_NS + 10_000_000 * k + 2_000_000,
            imu(T0_NS + 10_000_000 * k, (0.01 * k, -0.2, 0.3), (0.5, -0.1 * k, 9.7), without=without, store=store),
        )
        for k in range(count)
    ]


def sentences(log: bytes, store: Any = ROS2, step_ns: int = 25_000_000) -> list[Recorded]:
    """The lines of a log, one message each."""
    kind = store.types["nmea_msgs/msg/Sentence"]
    return [
        ("/nmea_sentence", T0_NS + step_ns * k, kind(header=header(T0_NS + step_ns * k, store), sentence=line.decode()))
        for k, line in enumerate(log.split())
    ]


def dji(kind: str, stamp_ns: int, **values: float) -> Any:
    """A message of DJI's node up to version 3.2 in ROS 1, which publishes its own types; other fields are 0."""
    message = ROS1.types[f"dji_sdk/msg/{kind}"]
    zero = {name: 0 for name in message.__dataclass_fields__ if not name.startswith("__")}
    return message(**{**zero, **values, "header": header(stamp_ns, ROS1)})


def quaternion(stamp_ns: int, turn: Sequence[float], store: Any = ROS2) -> Any:
    """A QuaternionStamped message of x, y, z, w."""
    types = store.types
    stamped = types["geometry_msgs/msg/QuaternionStamped"]
    return stamped(header=header(stamp_ns, store), quaternion=types["geometry_msgs/msg/Quaternion"](*map(float, turn)))
