"""Imu messages to inertial measurements.

The message has specific force in m/s² and angular rate in rad/s, along the axes of its frame (REP-103, REP-145); at
rest the force points up. A covariance that begins with −1 means that its quantity was not measured.
"""

from __future__ import annotations

from array import array
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.inertial_rows import attitude_track, first_beyond, inertial_track
from furrowmap.core.readers.rosbag.messages import stamp_s
from furrowmap.core.readers.rosbag.storage import BagMessage, Damage
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import UNSTATED_NORTH, AttitudeTrack
from furrowmap.core.values.rotation import quaternion_to_attitude

NOT_MEASURED: Final = -1.0


class ImuLog:
    """Measurements collected from Imu messages."""

    def __init__(self) -> None:
        self._rows = array("d")
        self.frame_id = ""

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message.

        Raises:
            Damage: if its values are no numbers, or it states that a quantity was not measured.
        """
        for name, covariance in (
            ("angular velocity", content.angular_velocity_covariance),
            ("linear acceleration", content.linear_acceleration_covariance),
        ):
            if covariance[0] == NOT_MEASURED:
                raise Damage(f"its covariance states that it has no {name}")
        rate, force, turn = content.angular_velocity, content.linear_acceleration, content.orientation
        values = (rate.x, rate.y, rate.z, force.x, force.y, force.z)
        if not np.isfinite(values).all():
            raise Damage("its angular velocity or linear acceleration is not a number")
        has_turn = content.orientation_covariance[0] != NOT_MEASURED
        turned = (turn.w, turn.x, turn.y, turn.z) if has_turn else (np.nan,) * 4
        self._rows.extend((stamp_s(content, message), *values, *turned, message.received_ns * 1e-9))
        self.frame_id = self.frame_id or str(content.header.frame_id)

    @property
    def _table(self) -> NDArray[np.float64]:
        """Stamp, angular rate, specific force, orientation (w, x, y, z), time of reception."""
        return np.array(self._rows).reshape(-1, 12)

    def delay_s(self) -> float:
        """Median of reception minus stamp."""
        table = self._table
        return float(np.median(table[:, -1] - table[:, 0]))

    def oriented(self) -> int:
        """Number of messages with an orientation."""
        return int(np.isclose(np.linalg.norm(self._table[:, 7:11], axis=1), 1.0, atol=0.01).sum())

    def attitude(self, source: str, notices: list[Notice]) -> AttitudeTrack:
        """The orientations, of the axes of the IMU against east, north and up (REP-103).

        The message does not state whether north is true or magnetic.

        Raises:
            InputError: if there are none, or the stamps do not increase.
        """
        table = self._table
        known = np.isclose(np.linalg.norm(table[:, 7:11], axis=1), 1.0, atol=0.01)
        if not known.any():
            raise InputError("no-orientation", source=source, table=len(table))
        angles = np.column_stack(quaternion_to_attitude(table[known, 7:11]))
        return attitude_track(table[known, 0], angles, UNSTATED_NORTH, source, notices)

    def track(self, source: str, notices: list[Notice]) -> InertialTrack:
        """All measurements in the order of recording.

        Args:
            source: file and topic, for messages.
            notices: those about dropped measurements are added.

        Raises:
            InputError: if the stamps do not increase, or no IMU measures such values.
        """
        table = self._table
        beyond = first_beyond(table[:, 1:7])
        if beyond is not None:
            count, row, first = beyond
            raise InputError(
                "value-out-of-range.track",
                source=source,
                count=count,
                table=table[row, 1 + first : 4 + first].tolist(),
                is_first=first == 0,
            )
        return inertial_track(table[:, 0], table[:, 1:7], source, notices)
