"""What the topics of a bag hold: scanners and IMUs are told by their first messages, not by type and number alone.

Drivers publish other things under the same types: an Ouster's inertial packets beside its data packets, the tracks of a
radar and filtered copies of a scan as PointCloud2, orientations without rates as Imu.
"""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from furrowmap.core.readers.ouster.captures import looks_like_data
from furrowmap.core.readers.pcap import Datagrams
from furrowmap.core.readers.rosbag import ros_messages as ros
from furrowmap.core.readers.rosbag.bag_storage import BagMessage, Damage
from furrowmap.core.readers.rosbag.cloud_messages import FIELD_NAMES

MESSAGES_LOOKED_AT: Final = 8
"""Messages of each topic that are looked into."""
SCAN_TYPES: Final = (*ros.PACKET_SCANS, *ros.LIVOX_CLOUDS, ros.POINT_CLOUD, ros.LASER_SCAN)
"""Types of messages with scans, those preferred first."""
LOOKED_INTO: Final = (*SCAN_TYPES, ros.IMU)
COPY_SHARE: Final = 0.95
"""A filtered copy has less than this share of the points of the scan."""
SIBLING_SHARE: Final = 0.1
"""A second scanner of the same type has at least this share of the points of the first in a message."""


@dataclass
class TopicContent:
    """What the first messages of a topic with the type of a scanner or an IMU hold.

    Attributes:
        looked_at: messages that could be decoded.
        data: of these with the data of a scanner, or rates and accelerations.
        points: in all of these, or packets, or ranges.
        timed: whether its points have times.
        ringed: whether its points have the number of their laser.
        frame: frame of coordinates that the messages name; empty for none.
        stamps: in the headers of the messages.
    """

    looked_at: int = 0
    data: int = 0
    points: int = 0
    timed: bool = False
    ringed: bool = False
    frame: str = ""
    stamps: set[float] = field(default_factory=set)

    @property
    def has_data(self) -> bool:
        """Whether it has any; unknown messages may."""
        return self.data > 0 or not self.looked_at

    @property
    def points_per_message(self) -> float:
        """Mean over the messages."""
        return self.points / max(self.looked_at, 1)

    @property
    def rank(self) -> tuple[bool, bool, bool, float]:
        """To sort by: topics with data first, then clouds as a driver writes them before filtered ones and tracks."""
        return not self.has_data, not self.timed, not self.ringed, -self.points_per_message

    def look(self, message: BagMessage) -> None:
        """Look into one more message, unless it is damaged."""
        try:
            content = ros.deserialize(message)
        except Damage:
            return
        self.looked_at += 1
        header: Any = getattr(content, "header", None)
        if header is not None:
            self.frame = self.frame or str(header.frame_id)
            self.stamps.add(ros.seconds(header.stamp))
        if ros.PACKET_SCANS.get(message.type) == "Ouster":
            self._look_at_packet(content)
        elif message.type == ros.IMU:
            self.data += not ros.unmeasured(content)
        elif message.type in ros.PACKET_SCANS:
            self._count(len(content.packets), timed=True, ringed=True)
        elif message.type == ros.LASER_SCAN:
            self._count(len(content.ranges), timed=True, ringed=False)
        else:
            names = {str(field.name) for field in content.fields}
            timed = not names.isdisjoint(FIELD_NAMES["time"])
            ringed = not names.isdisjoint(FIELD_NAMES["ring"])
            self._count(int(content.width) * int(content.height), timed=timed, ringed=ringed)

    def _look_at_packet(self, content: Any) -> None:
        payload = np.asarray(content.buf, np.uint8)
        zero = np.zeros(1, np.int64)
        packet = Datagrams(payload, zero, np.array([len(payload)]), np.zeros(1), np.zeros(1, np.uint64))
        if looks_like_data(packet):
            self._count(1, timed=True, ringed=True)

    def _count(self, points: int, *, timed: bool, ringed: bool) -> None:
        self.data += points > 0
        self.points += points
        self.timed |= timed
        self.ringed |= ringed


def is_second_scanner(other: TopicContent, chosen: TopicContent) -> bool:
    """Whether a topic of the same type is of another scanner than the chosen one: not of a filtered copy, or a radar.

    A copy has the frame, the stamps and fewer points than the scan that it was made from; tracks are few, and have no
    times or lasers where scans do.
    """
    if not other.has_data or (other.timed, other.ringed) < (chosen.timed, chosen.ringed):
        return False
    same_time = not other.stamps.isdisjoint(chosen.stamps)
    fewer = other.points_per_message < COPY_SHARE * chosen.points_per_message
    if other.frame == chosen.frame and same_time and fewer:
        return False
    return other.points_per_message >= SIBLING_SHARE * chosen.points_per_message
