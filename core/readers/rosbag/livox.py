"""CustomMsg of Livox's drivers as the PointCloud2 with the same points.

Definition: livox_ros_driver and livox_ros_driver2, msg/CustomMsg and msg/CustomPoint. `rosbags` would make an object of
each point, of which a second has 200,000.
"""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from furrowmap.core.readers.rosbag.storage import Damage

LIVOX_CLOUDS: Final = ("livox_ros_driver2/msg/CustomMsg", "livox_ros_driver/msg/CustomMsg")
_CUSTOM: Final = {
    "offset_time": (6, 0),
    "x": (7, 4),
    "y": (7, 8),
    "z": (7, 12),
    "reflectivity": (2, 16),
    "line": (2, 18),
}
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
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec)),
        height=1,
        width=points,
        point_step=step,
        row_step=points * step,
        is_bigendian=False,
        is_dense=True,
        fields=[SimpleNamespace(name=name, datatype=kind, offset=offset) for name, (kind, offset) in _CUSTOM.items()],
        data=np.frombuffer(data[at + 4 :].ljust(points * step, b"\0"), np.uint8),
    )
