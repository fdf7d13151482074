"""Velodyne data packets to scans: calibration, firing times, azimuths, returns, and where one revolution ends.

Whoever has packets (a capture, a ROS bag) pushes them in batches through one `PacketDecoder` and gets scans back.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.errors import Notice
from furrowmap.core.values.scan import Clock, Scan

PACKET_BYTES = 1206
"""Length of a data packet's payload."""


class PacketDecoder:
    """Turns a stream of data packets, pushed in batches in the order of time, into scans.

    Example:
        ```
        decoder = PacketDecoder(model=None, where="drive.bag, /velodyne_packets")
        for payloads, host_s in batches:            # any size, best a few hundred to a few thousand packets
            yield from decoder.push(payloads, host_s)
        yield from decoder.finish()
        notices += decoder.notices()                # complete after finish()
        clock = decoder.clock                       # known after the first scan
        ```

    Without a `SensorClock` the first packets are held back until there are enough to set the sensor's clock against
    the recorder's: `push` then gives nothing at first.

    Args:
        model: the scanner's model, which wins over the packets' product byte; None takes what the packets say.
        where: what an error is to name as its place: file, and topic where there is one.
        near_s: a UTC time near which the recording lies, for recorders whose clock knows no date.
    """

    def __init__(self, model: str | None = None, *, where: str = "", near_s: float | None = None) -> None:
        raise NotImplementedError

    def push(self, payloads: NDArray[np.uint8], host_s: NDArray[np.float64]) -> list[Scan]:
        """Scans that these packets complete.

        Args:
            payloads: (m, 1206) uint8, UDP payloads of data packets.
            host_s: (m,) float64, the recorder's time of each (UTC, POSIX seconds).

        Raises:
            InputError: if the model is unknown or none that can be decoded.
        """
        raise NotImplementedError

    def finish(self) -> list[Scan]:
        """The scans that were still open or held back."""
        raise NotImplementedError
