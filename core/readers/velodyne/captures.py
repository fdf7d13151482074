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
from furrowmap.core.readers.spinning.model import Maker, Model, PacketLayout

PACKET_BYTES: Final = 1206
"""Length of a data packet's payload: 12 blocks of 100 bytes, the stamp, and two factory bytes."""
STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39

_VELODYNE_PACKET: Final = PacketLayout(
    (PACKET_BYTES,), {0: 0xFF, 1: 0xEE}, blocks=12, header=0, azimuth=2, unit=3, units=32, marked=True, mode=1204,
    stamp=1200, product=1205,
)  # fmt: skip


_VELODYNE_MODELS: Final = (
    Model.listed("VLP-16", 0x22, _VELODYNE_PACKET, 0.002, 55.296e-6),
    Model.listed("Puck Hi-Res", 0x24, _VELODYNE_PACKET, 0.002, 55.296e-6),
    Model.listed("VLP-32C", 0x28, _VELODYNE_PACKET, 0.004, 55.296e-6),
    Model.listed("HDL-32E", 0x21, _VELODYNE_PACKET, 0.002, 46.08e-6),
    Model.listed("VLS-128", 0xA1, _VELODYNE_PACKET, 0.004, 53.3e-6, start_s=-8.7e-6, slowest_s=57.8e-6),
)
"""The sequence of the VLS-128 is 20 steps of 2.665 µs up to firmware 5.1.7, of 2.89 µs since 5.2.3; those of a real
recording are of 2.76 µs."""

VELODYNE: Final = Maker(
    "Velodyne",
    _VELODYNE_MODELS,
    modes={STRONGEST: (1, "strongest"), LAST: (1, "last"), DUAL: (2, "dual")},
    others={0x23: "VLP-32A or VLP-32B", 0x31: "Velarray", 0x63: "VLS-128 (prototype)"},
    other_names={
        "Puck": "VLP-16",
        "Puck LITE": "VLP-16",
        "Ultra Puck": "VLP-32C",
        "VLP-16 Hi-Res": "Puck Hi-Res",
        "Alpha Prime": "VLS-128",
    },
)


class VelodynePcap(SpinningPcap):
    """Scans in captures of a VLP-16, Puck LITE, Puck Hi-Res, VLP-32C, HDL-32E or VLS-128."""

    format: ClassVar[str] = "velodyne-pcap"
    title: ClassVar[str] = "Velodyne packets in a PCAP capture"
    maker: ClassVar[Maker] = VELODYNE

    @classmethod
    def recognise(cls, head: Head) -> float:
        """1 for captures with a data packet in their first part, 0.5 for others: the error says what they have."""
        return super().recognise(head) or 0.5 * bool(capture_format(head.data))
