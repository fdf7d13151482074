"""Captures of a Velodyne's packets, and its sensors: packets, angles, heights and firing times, and product bytes.

Sources: VLP-16 User Manual 63-9243 Rev. E (packets: section 9.3, timing: 9.4, angles and vertical corrections: table
9-1), VLP-32C User Manual 63-9325 Rev. C (the same sections), HDL-32E application note 63-9277 Rev. D (packet structure
and timing). A test compares them with velodyne-decoder 3.1, which is the source of the heights of VLP-32C and HDL-32E
and of the angles and heights of the VLS-128; its timing is that of the ROS driver (velodyne_pointcloud 1.7).
"""

from typing import ClassVar, Final

import numpy as np

from furrowmap.core.readers.pcap import capture_format
from furrowmap.core.readers.source import Head
from furrowmap.core.readers.spinning.scanner_model import Maker, Model, PacketLayout
from furrowmap.core.readers.spinning.spinning_captures import SpinningPcap
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.languages.texts import Text

PACKET_BYTES: Final = 1206
"""Length of a data packet's payload: 12 blocks of 100 bytes, the stamp, and two factory bytes."""
STRONGEST: Final = 0x37
LAST: Final = 0x38
DUAL: Final = 0x39

_VELODYNE_PACKET: Final = PacketLayout(
    (PACKET_BYTES,), {0: 0xFF, 1: 0xEE}, blocks=12, header=0, azimuth=2, unit=3, units=32, marked=True, mode=1204,
    stamp=1200, product=1205,
)  # fmt: skip


def _alternate(low_deg: tuple[float, ...], high_deg: tuple[float, ...]) -> FloatArray:
    """Two fans of lasers that fire alternately."""
    return np.stack([low_deg, high_deg], axis=1).reshape(-1)


_HI_RES_LOW_DEG: Final = (-10, -8.667, -7.333, -6, -4.667, -3.333, -2, -0.667)
_HI_RES_HIGH_DEG: Final = (0.667, 2, 3.333, 4.667, 6, 7.333, 8.667, 10)
_HI_RES_HEIGHT_MM: Final = (7.4, 6.5, 5.5, 4.6, 3.7, 2.7, 1.8, 0.9), (-0.9, -1.8, -2.7, -3.7, -4.6, -5.5, -6.5, -7.4)
_VLP16_DEG: Final = _alternate((-15, -13, -11, -9, -7, -5, -3, -1), (1, 3, 5, 7, 9, 11, 13, 15))
_VLP32C_DEG: Final = np.array(
    (-25, -1, -1.667, -15.639, -11.31, 0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4,
     -4.667, 1.667, 1, -3.667, -3.333, 3.333, 2.333, -2.667, -3, 7, 4.667, -2.333, -2, 15, 10.333, -1.333)
)  # fmt: skip
_VLP32C_AZIMUTH_DEG: Final = np.array(
    (1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
     1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4)
)  # fmt: skip
_HDL32E_DEG: Final = _alternate(
    (-30.67, -29.33, -28, -26.67, -25.33, -24, -22.67, -21.33, -20, -18.67, -17.33, -16, -14.67, -13.33, -12, -10.67),
    (-9.33, -8, -6.67, -5.33, -4, -2.67, -1.33, 0, 1.33, 2.67, 4, 5.33, 6.67, 8, 9.33, 10.67),
)
_VLS128_DEG: Final = np.array(
    (-11.742, -1.99, 3.4, -5.29, -0.78, 4.61, -4.08, 1.31, -6.5, -1.11, 4.28, -4.41,
     0.1, 6.48, -3.2, 2.19, -3.86, 1.53, -9.244, -1.77, 2.74, -5.95, -0.56, 4.83,
     -2.98, 2.41, -6.28, -0.89, 3.62, -5.07, 0.32, 7.58, -0.34, 5.18, -3.64, 1.75,
     -25, -2.43, 2.96, -5.73, 0.54, 9.7, -2.76, 2.63, -7.65, -1.55, 3.84, -4.85,
     3.18, -5.51, -0.12, 5.73, -4.3, 1.09, -16.042, -2.21, 4.06, -4.63, 0.76, 15,
     -3.42, 1.97, -6.85, -1.33, -5.62, -0.23, 5.43, -3.53, 0.98, -19.582, -2.32, 3.07,
     -4.74, 0.65, 11.75, -2.65, 1.86, -7.15, -1.44, 3.95, -2.1, 3.29, -5.4, -0.01,
     4.5, -4.19, 1.2, -13.565, -1.22, 4.17, -4.52, 0.87, 6.08, -3.31, 2.08, -6.65,
     1.42, -10.346, -1.88, 3.51, -6.06, -0.67, 4.72, -3.97, 2.3, -6.39, -1, 4.39,
     -5.18, 0.21, 6.98, -3.09, 4.98, -3.75, 1.64, -8.352, -2.54, 2.85, -5.84, -0.45,
     8.43, -2.87, 2.52, -6.17, -1.66, 3.73, -4.96, 0.43)
)  # fmt: skip
_VLS128_AZIMUTH_DEG: Final = np.tile((6.354, 4.548, 2.732, 0.911, -0.911, -2.732, -4.548, -6.354), 16)
_VLS128_CYCLE_S: Final = 53.3e-6
"""Up to firmware 5.1.7, 20 steps of 2.665 µs; since 5.2.3, of 2.89 µs. A real recording has steps of 2.76 µs."""
_VLS128_STEPS: Final = np.arange(128.0) // 8 + np.arange(128.0) // 64
"""Eight lasers fire at once, in 20 steps a sequence: eight, a pause of one, eight, and a pause of three."""
_PUCK_TIMES_S: Final = np.arange(16, dtype=np.float64) * 2.304e-6


def _beam_height_m(axis_m: float, elevation_deg: FloatArray) -> FloatArray:
    """Heights of the origins of beams that meet the vertical axis from an optical centre beside it."""
    return -axis_m * np.tan(np.radians(elevation_deg))


_IN_LINE: Final = np.zeros(32)
_VELODYNE_MODELS: Final = (
    Model("VLP-16", 0x22, _VELODYNE_PACKET, 0.002, 55.296e-6, _PUCK_TIMES_S,
          _VLP16_DEG, _IN_LINE[:16], _beam_height_m(41.91e-3, _VLP16_DEG)),
    Model("Puck Hi-Res", 0x24, _VELODYNE_PACKET, 0.002, 55.296e-6, _PUCK_TIMES_S,
          _alternate(_HI_RES_LOW_DEG, _HI_RES_HIGH_DEG), _IN_LINE[:16], _alternate(*_HI_RES_HEIGHT_MM) * 1e-3),
    Model("VLP-32C", 0x28, _VELODYNE_PACKET, 0.004, 55.296e-6, np.repeat(_PUCK_TIMES_S, 2),
          _VLP32C_DEG, _VLP32C_AZIMUTH_DEG, _beam_height_m(42.4e-3, _VLP32C_DEG)),
    Model("HDL-32E", 0x21, _VELODYNE_PACKET, 0.002, 46.08e-6, np.arange(32, dtype=np.float64) * 1.152e-6,
          _HDL32E_DEG, _IN_LINE, _beam_height_m(28.96e-3, _HDL32E_DEG)),
    Model("VLS-128", 0xA1, _VELODYNE_PACKET, 0.004, _VLS128_CYCLE_S, _VLS128_CYCLE_S / 20 * _VLS128_STEPS,
          _VLS128_DEG, _VLS128_AZIMUTH_DEG, _beam_height_m(58.63e-3, _VLS128_DEG), start_s=-8.7e-6, slowest_s=57.8e-6),
)  # fmt: skip

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
    title: ClassVar[Text] = Text("Velodyne packets in a PCAP capture")
    maker: ClassVar[Maker] = VELODYNE

    @classmethod
    def recognise(cls, head: Head) -> float:
        """1 for captures with a data packet in their first part, 0.5 for others: the error says what they have."""
        return super().recognise(head) or 0.5 * bool(capture_format(head.data))
