"""Velodyne data packets to scans, cut where a revolution ends.

The reader of a capture or a ROS bag pushes packets in batches through one `PacketDecoder` and gets scans back.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.velodyne.clock import SensorClock, settle
from furrowmap.core.readers.velodyne.counts import PacketCounts
from furrowmap.core.readers.velodyne.models import PACKET_BYTES, Model, model_named, model_of
from furrowmap.core.readers.velodyne.returns import BAD_BLOCKS, CARRIED, TURNED, TURNING, decode_returns
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.scan import Clock, Scan

ByteArray = NDArray[np.uint8]

_SETTLE_PACKETS: Final = 2000
"""Number of packets that are held back to compare the sensor's clock with the recorder's (1 to 3 s)."""

_LONE_REVOLUTION: Final = (0.95, 1.1)
"""Length of a revolution that was recorded alone: some packets more or less, never a tenth of a revolution more."""


class PacketDecoder:
    """Decodes a stream of data packets, pushed in batches in the order of time, into scans.

    Example:
        ```
        decoder = PacketDecoder(model=None, where="drive.bag, /velodyne_packets")
        for payloads, host_s in batches:            # any size, best a few hundred to a few thousand packets
            yield from decoder.push(payloads, host_s)
        yield from decoder.finish()
        notices += decoder.notices()                # complete after finish()
        clock = decoder.kind                        # known after the first scan
        ```

    Scans are cut where azimuth passes 0 and at pauses of a revolution or more, but not at shorter gaps (lost packets,
    or a sensor that reports a sector only). A single revolution between two pauses is one scan at whatever azimuth it
    begins: some recorders store every fifth revolution.

    If a firing has two different returns, the nearer one is return 1 of 2 and the farther one return 2, as LAS counts
    along the ray (the manual's order is last, then strongest or second-strongest). Equal ones are one return.

    Without a `SensorClock` the first packets are held back to compare the sensor's clock with the recorder's: `push`
    returns nothing at first.

    Args:
        model: the scanner's model, which overrides the packets' product byte; None for that byte.
        clock: what the stamps count from; None to derive it from the recorder's times.
        where: the location that errors name: file, and topic if there is one.
        near_s: a UTC time near the recording, for recorders whose clock has no date.

    Attributes:
        counts: counts over all packets so far.

    Raises:
        InputError: if the stated model is unknown.
    """

    def __init__(
        self,
        model: str | None = None,
        *,
        clock: SensorClock | None = None,
        where: str = "",
        near_s: float | None = None,
    ) -> None:
        self.counts = PacketCounts()
        self._stated = model_named(model) if model else None
        self._model: Model | None = self._stated
        self._clock = clock
        self._where = where
        self._near_s = near_s
        self._early: list[tuple[ByteArray, FloatArray]] = []
        self._early_packets = 0
        self._notices: list[Notice] = []
        self._carried = np.zeros(CARRIED)
        self._open: list[Scan] = []
        self._open_by_wrap = False
        self._held: Scan | None = None
        self._number = 0
        self._last_stamp = (-1, -1)

    @property
    def kind(self) -> Clock:
        """The clock that the times come from."""
        return self._clock.kind if self._clock else Clock.RECORDER

    @property
    def model(self) -> Model | None:
        """The model that packets are decoded as; None before the first packet."""
        return self._model

    def push(self, payloads: ByteArray, host_s: FloatArray) -> list[Scan]:
        """Scans that these packets complete.

        Args:
            payloads: (m, 1206) uint8, UDP payloads of data packets.
            host_s: (m,) float64, the recorder's time of each (UTC, POSIX seconds).

        Raises:
            InputError: if the model is unknown or not supported.
        """
        payloads = np.ascontiguousarray(payloads, np.uint8)
        if payloads.ndim != 2 or payloads.shape[1] != PACKET_BYTES or len(payloads) != len(host_s):
            raise ValueError(f"payloads {payloads.shape} and host_s {np.shape(host_s)} must be (m, 1206) and (m,)")
        offset = np.arange(len(payloads), dtype=np.int64) * PACKET_BYTES
        return self.push_at(payloads.reshape(-1), offset, np.asarray(host_s, np.float64))

    def push_at(self, data: ByteArray, offset: IntArray, host_s: FloatArray) -> list[Scan]:
        """As `push`, for packets in a larger buffer.

        Args:
            offset: (m,) int64, where in `data` each payload of 1206 bytes begins.

        Raises:
            InputError: if the model is unknown or not supported.
        """
        if not len(offset):
            return []
        if self._clock is not None:
            return self._decode(data, offset, host_s)
        self._early.append((data[offset[:, None] + np.arange(PACKET_BYTES)], host_s))
        self._early_packets += len(offset)
        return self._settle() if self._early_packets >= _SETTLE_PACKETS else []

    def finish(self) -> list[Scan]:
        """The scans that are still open or held back; call it once, after the last packet."""
        scans = self._settle() if self._early else []
        return scans + self._close(by_wrap=False) + self._release()

    def _settle(self) -> list[Scan]:
        payloads = np.concatenate([early for early, _ in self._early])
        host_s = np.concatenate([host_s for _, host_s in self._early])
        self._early.clear()
        device_us = payloads[:, 1200:1204].copy().view("<u4")[:, 0]
        self._clock, notices = settle(device_us, host_s, [], self._near_s)
        self._notices += notices
        return self.push(payloads, host_s)

    def _decode(self, data: ByteArray, offset: IntArray, host_s: FloatArray) -> list[Scan]:
        tail = data[offset[:, None] + np.arange(1200, 1206)]
        device_us = tail[:, :4].copy().view("<u4")[:, 0]
        azimuth = data[offset + 2].astype(np.int64) | data[offset + 3].astype(np.int64) << 8
        # Captures on several interfaces repeat packets.
        stamps = device_us.astype(np.int64)
        before = self._last_stamp
        again = (np.diff(stamps, prepend=before[0]) | np.diff(azimuth, prepend=before[1])) == 0
        self._last_stamp = int(stamps[-1]), int(azimuth[-1])
        if again.any():
            self.counts.repeated += int(again.sum())
            offset, host_s, device_us, tail = offset[~again], host_s[~again], device_us[~again], tail[~again]
            if not len(offset):
                return []
        self.counts.modes.update(sorted(tail[:, 4].tolist()))
        self.counts.products.update(sorted(tail[:, 5].tolist()))
        if self._model is None:
            self._model = model_of(int(np.bincount(tail[:, 5]).argmax()), self._where)
        assert self._clock is not None
        t_s = self._clock.utc_s(device_us, host_s)
        returns, cut_at, cut_by_wrap = decode_returns(data, offset, t_s, self._model, self._carried)
        self.counts.revolutions = float(self._carried[TURNED]) / 36_000
        self.counts.turning_s = float(self._carried[TURNING])
        self.counts.bad_blocks = int(self._carried[BAD_BLOCKS])
        self.counts.note_times(t_s, host_s, self._model)
        scans = []
        start = 0
        for stop, by_wrap in zip(cut_at.tolist(), cut_by_wrap.tolist(), strict=True):
            self._open.append(returns[start:stop])
            scans += self._close(by_wrap=by_wrap)
            self._open_by_wrap = by_wrap
            start = stop
        self._open.append(returns[start:])
        return scans

    def _close(self, *, by_wrap: bool) -> list[Scan]:
        """The scans that are complete where the open piece ends: at azimuth 0 if `by_wrap`, else at a pause or end."""
        pieces = [piece for piece in self._open if len(piece)]
        self._open.clear()
        if not pieces:
            return []
        piece = Scan.joined(pieces)
        if by_wrap and not self._open_by_wrap:  # maybe the first part of a revolution that was recorded alone
            scans = self._release()
            self._held = piece
            return scans
        if not by_wrap and self._held is not None and self._is_lone_revolution(self._held, piece):
            first, self._held = self._held, None
            piece.column[:] += first.column[-1] + 1
            return [self._numbered(Scan.joined([first, piece]), whole=True)]
        return [*self._release(), self._numbered(piece, whole=by_wrap and self._open_by_wrap)]

    def _release(self) -> list[Scan]:
        """The piece that was held back, now known to be an incomplete revolution."""
        held, self._held = self._held, None
        return [] if held is None else [self._numbered(held, whole=False)]

    def _is_lone_revolution(self, first: Scan, second: Scan) -> bool:
        """Whether two pieces with azimuth 0 between them are one revolution without lost firings."""
        if not self.counts.revolutions:
            return False
        assert self._model is not None
        revolution_s = self.counts.turning_s / self.counts.revolutions
        fired_s = (int(first.column[-1]) + int(second.column[-1])) * self._model.cycle_s
        low, high = _LONE_REVOLUTION
        return fired_s >= low * revolution_s and float(second.t_s[-1] - first.t_s[0]) <= high * revolution_s

    def _numbered(self, piece: Scan, *, whole: bool) -> Scan:
        scan = replace(piece, number=self._number, whole=whole)
        self._number += 1
        self.counts.points += len(scan)
        self.counts.whole += whole
        self.counts.cut += not whole
        return scan

    def notices(self) -> list[Notice]:
        """What is unusual about the packets so far."""
        notices = list(self._notices)
        if self._model is not None and self.counts.packets:
            notices += self.counts.notices(self._model, stated=self._stated is not None)
        if self._clock is not None and self._clock.jumps:
            at_s, size_s = self._clock.jumps[0]
            notices.append(Notice("clock-jumps", jumps=len(self._clock.jumps), size_s=size_s, at_s=iso_utc(at_s)))
        return notices
