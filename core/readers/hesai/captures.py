"""Captures of a Hesai's packets."""

from __future__ import annotations

from typing import ClassVar

from furrowmap.core.readers.hesai.models import HESAI
from furrowmap.core.readers.spinning.captures import SpinningPcap
from furrowmap.core.readers.spinning.model import Maker


class HesaiPcap(SpinningPcap):
    """Scans in captures of a PandarXT-16, PandarXT-32, PandarXT-32M, PandarQT64, Pandar40P or Pandar64."""

    format: ClassVar[str] = "hesai-pcap"
    title: ClassVar[str] = "Hesai packets in a PCAP capture"
    maker: ClassVar[Maker] = HESAI
