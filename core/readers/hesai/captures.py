"""Captures of a Hesai's packets, and Hesai's sensors: packets, angles and firing times of their lasers.

Sources: the maker's HesaiLidar_General_SDK and HesaiLidar_SDK_2.0 (packets, angles of the models, firing times), and
the manuals of PandarXT-16 and PandarXT-32 (packets, firing times, and that the azimuth of a return is that of the
block, plus that of the channel, plus the turning up to its firing). The SDKs' shift of the optical centre from the axis
(up to 13 mm across, 8 mm in height, off by default) is not applied, nor is it in other decoders.
"""

from typing import ClassVar, Final

from furrowmap.core.readers.spinning.captures import SpinningPcap
from furrowmap.core.readers.spinning.model import Maker

HESAI: Final = Maker.listed("Hesai")


class HesaiPcap(SpinningPcap):
    """Scans in captures of a PandarXT-16, PandarXT-32, PandarXT-32M, PandarQT64, Pandar40P or Pandar64."""

    format: ClassVar[str] = "hesai-pcap"
    title: ClassVar[str] = "Hesai packets in a PCAP capture"
    maker: ClassVar[Maker] = HESAI
