"""Captures of a Hesai's packets, and Hesai's sensors: packets, angles and firing times of their lasers.

Sources: the maker's HesaiLidar_General_SDK and HesaiLidar_SDK_2.0 (packets, angles of the models, firing times), and
the manuals of PandarXT-16 and PandarXT-32 (packets, firing times, and that the azimuth of a return is that of the
block, plus that of the channel, plus the turning up to its firing). The SDKs' shift of the optical centre from the axis
(up to 13 mm across, 8 mm in height, off by default) is not applied, nor is it in other decoders.
"""

from dataclasses import replace
from typing import ClassVar, Final

from furrowmap.core.readers.spinning.captures import SpinningPcap
from furrowmap.core.readers.spinning.model import Maker, Model, PacketLayout

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

_HESAI_MODELS: Final = (
    Model.listed("PandarXT-32", 0x062008, _XT, 0.004, 50e-6, stamp_at_last=True),
    Model.listed("PandarXT-16", 0x061008, _XT16, 0.004, 50e-6, stamp_at_last=True),
    Model.listed("PandarXT-32M", 0x062006, _XTM, 0.004, 50e-6, stamp_at_last=True),
    Model.listed("PandarQT64", 0x034004, _QT, 0.004, 500e-6 / 3.0, start_s=35.71e-6),
    Model.listed("Pandar40P", 0x28000A, _P40, 0.004, 55.56e-6, start_s=-28.58e-6, stamp_at_last=True),
    Model.listed("Pandar64", 0x400006, _P64, 0.004, 55.56e-6, start_s=-42.58e-6, stamp_at_last=True),
)

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
    title: ClassVar[str] = "Hesai packets in a PCAP capture"
    maker: ClassVar[Maker] = HESAI
