"""Captures of a Velodyne's packets, and its sensors: packets, angles, heights and firing times, and product bytes.

Sources: VLP-16 User Manual 63-9243 Rev. E (packets: section 9.3, timing: 9.4, angles and vertical corrections: table
9-1), VLP-32C User Manual 63-9325 Rev. C (the same sections), HDL-32E application note 63-9277 Rev. D (packet structure
and timing). A test compares them with velodyne-decoder 3.1, which is the source of the heights of VLP-32C and HDL-32E
and of the angles and heights of the VLS-128; its timing is that of the ROS driver (velodyne_pointcloud 1.7).
"""

from typing import ClassVar, Final

from furrowmap.core.readers.pcap import capture_format
from furrowmap.core.readers.source import Head
from furrowmap.core.readers.spinning.captures import SpinningPcap
from furrowmap.core.readers.spinning.model import Maker

PACKET_BYTES: Final = 1206
"""Length of a data packet's payload: 12 blocks of 100 bytes, the stamp, and two factory bytes."""
VELODYNE: Final = Maker.listed("Velodyne")


class VelodynePcap(SpinningPcap):
    """Scans in captures of a VLP-16, Puck LITE, Puck Hi-Res, VLP-32C, HDL-32E or VLS-128."""

    format: ClassVar[str] = "velodyne-pcap"
    title: ClassVar[str] = "Velodyne packets in a PCAP capture"
    maker: ClassVar[Maker] = VELODYNE

    @classmethod
    def recognise(cls, head: Head) -> float:
        """1 for captures with a data packet in their first part, 0.5 for others: the error says what they have."""
        return super().recognise(head) or 0.5 * bool(capture_format(head.data))
