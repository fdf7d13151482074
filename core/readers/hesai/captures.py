"""Captures of a Hesai's packets, and Hesai's sensors: packets, angles and firing times of their lasers.

Sources: the maker's HesaiLidar_General_SDK and HesaiLidar_SDK_2.0 (packets, angles of the models, firing times), and
the manuals of PandarXT-16 and PandarXT-32 (packets, firing times, and that the azimuth of a return is that of the
block, plus that of the channel, plus the turning up to its firing). The SDKs' shift of the optical centre from the axis
(up to 13 mm across, 8 mm in height, off by default) is not applied, nor is it in other decoders.
"""

from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from furrowmap.core.readers.spinning.scanner_model import Maker, Model, PacketLayout
from furrowmap.core.readers.spinning.spinning_captures import SpinningPcap
from furrowmap.core.runtime.languages.texts import Text

_HESAI_MARK: Final = {0: 0xEE, 1: 0xFF}
_XT: Final = PacketLayout(
    (1080,), {**_HESAI_MARK, 2: 6, 6: 32, 7: 8}, blocks=8, header=12, unit=4, units=32, mode=1062, stamp=1071,
    date=1065, distance_mm=9,
)  # fmt: skip
_XT16: Final = replace(_XT, lengths=(568,), signature={**_XT.signature, 6: 16}, units=16, mode=550, stamp=559, date=553)
_XTM: Final = replace(_XT, lengths=(820,), signature={**_XT.signature, 7: 6}, blocks=6, mode=802, stamp=811, date=805)
_QT: Final = PacketLayout(
    (1072, 1068), {**_HESAI_MARK, 2: 3, 6: 64, 7: 4}, blocks=4, header=12, unit=4, units=64, mode=1060, stamp=1056,
    date=1062, distance_mm=9,
)  # fmt: skip
_P64: Final = PacketLayout(
    (1198, 1194), {**_HESAI_MARK, 2: 64, 3: 6}, blocks=6, header=8, unit=3, units=64, mode=1186, stamp=1182, date=1188,
    distance_mm=5,
)  # fmt: skip
_P40: Final = PacketLayout(
    (1266, 1262), {0: 0xFF, 1: 0xEE}, blocks=10, header=0, azimuth=2, unit=3, units=40, marked=True, mode=1254,
    stamp=1250, date=1256,
)  # fmt: skip

_P40_DEG: Final = np.array(
    (15, 11, 8, 5, 3, 2, 1.67, 1.33, 1, 0.67, 0.33, 0,
     -0.33, -0.67, -1, -1.33, -1.66, -2, -2.33, -2.67, -3, -3.33, -3.67, -4,
     -4.33, -4.67, -5, -5.33, -5.67, -6, -7, -8, -9, -10, -11, -12,
     -13, -14, -19, -25)
)  # fmt: skip
_P40_AZIMUTH_DEG: Final = np.array((-1.042,) * 6 + (3.125, -5.208, -1.042) * 8 + (-1.042,) * 10)
_P40_BEFORE_US: Final = np.array(
    (42.22, 28.47, 16.04, 3.62, 45.49, 31.74, 47.46, 54.67, 20.62, 33.71, 40.91, 8.19,
     20.62, 27.16, 50.73, 8.19, 14.74, 36.98, 45.49, 52.7, 23.89, 31.74, 38.95, 11.47,
     18.65, 25.19, 48.76, 6.23, 12.77, 35.01, 21.92, 9.5, 43.52, 29.77, 17.35, 4.92,
     42.22, 28.47, 16.04, 3.62)
)  # fmt: skip
_P64_DEG: Final = np.array(
    (14.882, 11.032, 8.059, 5.057, 3.04, 2.028, 1.86, 1.688, 1.522, 1.351, 1.184, 1.013,
     0.846, 0.675, 0.508, 0.337, 0.169, 0, -0.169, -0.337, -0.508, -0.675, -0.845, -1.013,
     -1.184, -1.351, -1.522, -1.688, -1.86, -2.028, -2.198, -2.365, -2.536, -2.7, -2.873, -3.04,
     -3.21, -3.375, -3.548, -3.712, -3.884, -4.05, -4.221, -4.385, -4.558, -4.72, -4.892, -5.057,
     -5.229, -5.391, -5.565, -5.726, -5.898, -6.061, -7.063, -8.059, -9.06, -9.885, -11.032, -12.006,
     -12.974, -13.93, -18.889, -24.897)
)  # fmt: skip
_P64_AZIMUTH_DEG: Final = np.array((-1.042,) * 6 + (1.042, 3.125, 5.208, -5.208, -3.125, -1.042) * 8 + (-1.042,) * 10)
_P64_BEFORE_US: Final = np.array(
    (23.18, 21.876, 20.572, 19.268, 17.964, 16.66, 11.444, 46.796, 7.532, 36.956, 50.732, 54.668,
     40.892, 44.828, 31.052, 34.988, 48.764, 52.7, 38.924, 42.86, 29.084, 33.02, 46.796, 25.148,
     36.956, 50.732, 27.116, 40.892, 44.828, 31.052, 34.988, 48.764, 25.148, 38.924, 42.86, 29.084,
     33.02, 52.7, 6.228, 54.668, 15.356, 27.116, 10.14, 23.18, 4.924, 21.876, 14.052, 17.964,
     8.836, 19.268, 3.62, 20.572, 12.748, 16.66, 7.532, 11.444, 6.228, 15.356, 10.14, 4.924,
     3.62, 14.052, 8.836, 12.748)
)  # fmt: skip
_QT_DEG: Final = np.array(
    (-52.121, -49.785, -47.577, -45.477, -43.465, -41.528, -39.653, -37.831, -36.055, -34.32,
     -32.619, -30.95, -29.308, -27.69, -26.094, -24.517, -22.964, -21.42, -19.889, -18.372,
     -16.865, -15.368, -13.88, -12.399, -10.925, -9.457, -7.994, -6.535, -5.079, -3.626,
     -2.175, -0.725, 0.725, 2.175, 3.626, 5.079, 6.534, 7.993, 9.456, 10.923,
     12.397, 13.877, 15.365, 16.861, 18.368, 19.885, 21.415, 22.959, 24.524, 26.101,
     27.697, 29.315, 30.957, 32.627, 34.328, 36.064, 37.84, 39.662, 41.537, 43.475,
     45.487, 47.587, 49.795, 52.133)
)  # fmt: skip
_QT_AZIMUTH_DEG: Final = np.array(
    (8.736, 8.314, 7.964, 7.669, 7.417, 7.198, 7.007, 6.838, 6.688, 6.554, 6.434,
     6.326, 6.228, 6.14, 6.059, 5.987, -5.27, -5.216, -5.167, -5.123, -5.083, -5.047,
     -5.016, -4.988, -4.963, -4.942, -4.924, -4.91, -4.898, -4.889, -4.884, -4.881, 5.493,
     5.496, 5.502, 5.512, 5.525, 5.541, 5.561, 5.584, 5.611, 5.642, 5.676, 5.716,
     5.759, 5.808, 5.862, 5.921, -5.33, -5.396, -5.469, -5.55, -5.64, -5.74, -5.85,
     -5.974, -6.113, -6.269, -6.447, -6.651, -6.887, -7.163, -7.493, -7.892)
)  # fmt: skip
_QT_US: Final = np.array(
    (2.31, 4.37, 6.43, 8.49, 10.54, 12.6, 14.66, 16.71, 19.16, 21.22, 23.28,
     25.34, 27.39, 29.45, 31.5, 33.56, 36.61, 38.67, 40.73, 42.78, 44.84, 46.9,
     48.95, 51.01, 53.45, 55.52, 57.58, 59.63, 61.69, 63.74, 65.8, 67.86, 70.9,
     72.97, 75.02, 77.08, 79.14, 81.19, 83.25, 85.3, 87.75, 89.82, 91.87, 93.93,
     95.98, 98.04, 100.1, 102.15, 105.2, 107.26, 109.32, 111.38, 113.43, 115.49, 117.54,
     119.6, 122.05, 124.11, 126.17, 128.22, 130.28, 132.34, 134.39, 136.45)
)  # fmt: skip

_LASERS: Final = np.arange(32, dtype=np.float64)
_AXIS: Final = np.zeros(64)
"""Azimuths of lasers in line, and heights of beams that meet in the sensor's origin."""
_HESAI_MODELS: Final = tuple(
    Model(name, product, layout, 0.004, cycle_s, laser_us * 1e-6, elevation, azimuth, _AXIS[: len(elevation)], start_s,
          stamp_at_last=name != "PandarQT64")
    for name, product, layout, cycle_s, laser_us, elevation, azimuth, start_s in (
        ("PandarXT-32", 0x062008, _XT, 50e-6, 6.0 + 1.512 * _LASERS, 15.0 - _LASERS, _AXIS[:32], 0.0),
        ("PandarXT-16", 0x061008, _XT16, 50e-6, 6.0 + 3.024 * _LASERS[:16], 15.0 - 2 * _LASERS[:16], _AXIS[:16], 0.0),
        ("PandarXT-32M", 0x062006, _XTM, 50e-6, 6.0 + 2.888 * (_LASERS % 16), 19.5 - 1.3 * _LASERS, _AXIS[:32], 0.0),
        ("PandarQT64", 0x034004, _QT, 500e-6 / 3.0, _QT_US, _QT_DEG, _QT_AZIMUTH_DEG, 35.71e-6),
        ("Pandar40P", 0x28000A, _P40, 55.56e-6, -_P40_BEFORE_US, _P40_DEG, _P40_AZIMUTH_DEG, -28.58e-6),
        ("Pandar64", 0x400006, _P64, 55.56e-6, -_P64_BEFORE_US, _P64_DEG, _P64_AZIMUTH_DEG, -42.58e-6),
    )
)  # fmt: skip

_OTHER_VERSIONS: Final = {
    0x0101: "Pandar128", 0x0103: "Pandar128", 0x0104: "Pandar128 or OT128", 0x0302: "QT128", 0x0401: "AT128",
    0x0403: "AT128", 0x0501: "FT120", 0x0702: "FT120",
}  # fmt: skip
"""Major and minor version of the packets → model (HesaiLidar_SDK_2.0)."""

HESAI: Final = Maker(
    "Hesai",
    _HESAI_MODELS,
    modes={
        0x33: (1, "first"),
        0x34: (1, "second"),
        0x37: (1, "strongest"),
        0x38: (1, "last"),
        0x39: (2, "dual (last, strongest)"),
        0x3A: (2, "dual (first, second)"),
        0x3B: (2, "dual (first, last)"),
        0x3C: (2, "dual (first, strongest)"),
        0x3D: (3, "triple (first, last, strongest)"),
    },
    others=_OTHER_VERSIONS,
    other_names={
        "XT16": "PandarXT-16",
        "XT32": "PandarXT-32",
        "XT32M": "PandarXT-32M",
        "XT32M2X": "PandarXT-32M",
        "PandarXTM": "PandarXT-32M",
        "QT64": "PandarQT64",
        "PandarQT": "PandarQT64",
    },
    other_packets=tuple(
        ({0: 0xEE, 1: 0xFF, 2: version >> 8, 3: version & 0xFF}, version) for version in _OTHER_VERSIONS
    ),
    calibrated=True,
)


class HesaiPcap(SpinningPcap):
    """Scans in captures of a PandarXT-16, PandarXT-32, PandarXT-32M, PandarQT64, Pandar40P or Pandar64."""

    format: ClassVar[str] = "hesai-pcap"
    title: ClassVar[Text] = Text("Hesai packets in a PCAP capture")
    maker: ClassVar[Maker] = HESAI
