"""Captures of a Velodyne's packets."""

from __future__ import annotations

from typing import ClassVar

from furrowmap.core.readers.pcap import capture_format
from furrowmap.core.readers.source import Head
from furrowmap.core.readers.spinning.captures import SpinningPcap
from furrowmap.core.readers.spinning.model import Maker
from furrowmap.core.readers.velodyne.models import VELODYNE


class VelodynePcap(SpinningPcap):
    """Scans in captures of a VLP-16, Puck LITE, Puck Hi-Res, VLP-32C, HDL-32E or VLS-128."""

    format: ClassVar[str] = "velodyne-pcap"
    title: ClassVar[str] = "Velodyne packets in a PCAP capture"
    maker: ClassVar[Maker] = VELODYNE

    @classmethod
    def recognise(cls, head: Head) -> float:
        """1 for captures with a data packet in their first part, 0.5 for others: the error says what they have."""
        return super().recognise(head) or 0.5 * bool(capture_format(head.data))
