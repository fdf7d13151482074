"""Data packets of an Ouster sensor to scans, one per turn.

Formats: Ouster Sensor Documentation, firmware 3.1, "Lidar Data Packet Format" and "Coordinate Frames and XYZ
Calculation".
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.ouster.metadata import STAMP, Heads, Metadata, SensorTime, settle
from furrowmap.core.readers.packet_counts import ScannerCounts
from furrowmap.core.readers.return_columns import ReturnColumns
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.kernels import kernel_part
from furrowmap.core.values.scan import Clock, Scan

ByteArray = NDArray[np.uint8]

_WHOLE_SHARE: Final = 0.9
"""A turn with a smaller share of its packets is not whole."""
_CHECKED_TURNS: Final = 3
_LONGEST_TURN: Final = 2
"""Times the packets of a turn after which it ends, whatever its number."""
_CLOCK_STEP_S: Final = 0.25
"""From one packet to the next without a gap; receivers' sentences may set the clock a second off and back."""
_JUMP_S: Final = 2.0
"""Stamps that move away from the recorder's times by more than this between two packets: the clock was set."""
_COLUMN_APART_NS: Final = 1_000_000_000
"""A column whose stamp is further from that of its packet is damaged."""


class OusterDecoder:
    """Decodes data packets, pushed in batches in the order of time, into scans.

    A scan is a turn of the sensor, which begins at column 0: behind the sensor. Where a pixel has two returns, the
    nearer one is return 1 of 2.

    Args:
        metadata: of the sensor that sends the packets.
        time: what the stamps count from; None to derive it from the first batch.

    Raises:
        InputError: on pushing, if the packets are of another mode than the metadata.
    """

    def __init__(self, metadata: Metadata, time: SensorTime | None = None) -> None:
        self.metadata = metadata
        self.counts = ScannerCounts()
        self._bad_columns = 0
        self.time = time
        self._notices: list[Notice] = []
        self._shift_ns = 0
        self._last: tuple[int, int, int, float] | None = None
        self._open: list[Scan] = []
        self._open_packets = 0
        self._open_frame = -1
        self._columns = self._turns = 0
        self._begun = False
        """Whether the open scan is the rest of a turn that had begun before the recording."""

    @property
    def clock(self) -> Clock:
        """The clock that the times come from."""
        return self.time.kind if self.time else Clock.RECORDER

    def push(self, data: ByteArray, offset: IntArray, host_s: FloatArray) -> list[Scan]:
        """Scans that these packets complete, from payloads at offsets (m,) of the data.

        `host_s` (m,) is the recorder's UTC.
        """
        m = self.metadata
        head = m.heads(data, offset)
        kept = self._in_order(head) & (head.stamp_ns > 0)  # without a valid column the stamp is 0
        offset = offset[kept]
        host_s = host_s[kept]
        head = Heads(*(values[kept] for values in head))
        if not len(offset):
            return []
        if self.time is None:
            self.time, self._notices = settle(head.stamp_ns, host_s, m, None)
        self._check_columns(head)
        shift_ns = self._note_times(head, host_s)
        scan, ends = self._decode(data, offset, shift_ns)
        scans = []
        begin = 0
        start = 0
        turned = np.flatnonzero(np.diff(head.frame)) + 1
        if self._open_packets and head.frame[0] != self._open_frame:
            scans += self._close(cut=self._begun)
            self._begun = False
        for packet in turned.tolist():
            self._open.append(scan[start : (stop := int(ends[packet - 1]))])
            self._open_packets += packet - begin
            scans += self._close(cut=self._begun)
            self._begun = False
            begin = packet
            start = stop
        self._open.append(scan[start:])
        self._open_packets += len(offset) - begin
        self._open_frame = int(head.frame[-1])
        if self._open_packets > _LONGEST_TURN * m.frame_packets:  # the number of the turn stands still
            scans += self._close(cut=True)
        return scans

    def finish(self) -> list[Scan]:
        """The scan that is still open; call it once, after the last packet."""
        ends = self._last is not None and self._last[1] == self.metadata.frame_packets - 1
        return self._close(cut=self._begun or not ends)

    def _in_order(self, head: Heads) -> NDArray[np.bool_]:
        """Which packets (m,) neither repeat the one before nor belong to the turn before."""
        turns = 1 << (32 if self.metadata.fusa else 16)
        kept = np.ones(len(head.frame), bool)
        frame, column = (self._last[0], self._last[1]) if self._last else (-1, -1)
        before = np.diff(head.frame, prepend=frame)
        if not ((before % turns == turns - 1) | (before == 0) & (np.diff(head.column, prepend=column) == 0)).any():
            return kept
        for i, (this, first) in enumerate(zip(head.frame.tolist(), head.column.tolist(), strict=True)):
            if (this, first) == (frame, column):
                self.counts.repeated += 1
                kept[i] = False
            elif frame >= 0 and this == (frame - 1) % turns:
                self.counts.late += 1
                kept[i] = False
            else:
                frame = this
                column = first
        return kept

    def _check_columns(self, head: Heads) -> None:
        """Refuse packets of another mode than that of the metadata: each column would have a wrong azimuth."""
        m = self.metadata
        self._columns = max(self._columns, int(head.column.max()) + m.packet_columns)
        self._turns += int((np.diff(head.frame) != 0).sum())
        short = self._turns >= _CHECKED_TURNS and self._columns < _WHOLE_SHARE * max(m.window)
        if short or np.count_nonzero(head.column >= m.columns) > max(0.1 * len(head.column), 2):
            raise InputError("ouster-metadata-mode", name=m.name, columns=m.columns, there=self._columns)

    def _note_times(self, head: Heads, host_s: FloatArray) -> IntArray:
        """Nanoseconds to subtract from the stamps (m,) of each packet; gaps, pauses and jumps are counted."""
        m = self.metadata
        counts = self.counts
        per_turn = self.metadata.frame_packets
        assert self.time is not None
        blocks = -(-m.columns // m.packet_columns)
        place = (head.column // m.packet_columns - m.window[0] // m.packet_columns) % blocks
        frame, place_0, stamp_ns, last_host_s = self._last or (
            int(head.frame[0]), int(place[0]) - 1, int(head.stamp_ns[0]), float(host_s[0])
        )  # fmt: skip
        turns = np.diff(head.frame, prepend=frame) % (1 << (32 if m.fusa else 16))
        stepped = turns * per_turn + np.diff(place, prepend=place_0)
        step_s = np.diff(head.stamp_ns, prepend=stamp_ns) * 1e-9
        host_step_s = np.diff(host_s, prepend=last_host_s)
        jumped = (np.abs(step_s - host_step_s) > _JUMP_S) | ((stepped == 1) & (np.abs(step_s) > _CLOCK_STEP_S))
        step_s[jumped] = host_step_s[jumped]
        shift_ns = np.full(len(stepped), self._shift_ns or self.time.minus_ns, np.int64)
        for i in np.flatnonzero(jumped).tolist():
            before_ns = int(head.stamp_ns[i - 1]) if i else stamp_ns
            change_ns = int(head.stamp_ns[i]) - before_ns - round(float(step_s[i]) * 1e9)
            shift_ns[i:] += change_ns
            counts.jumps.append((float(host_s[i]), change_ns * 1e-9))
        self._shift_ns = int(shift_ns[-1])
        t_s: FloatArray = np.asarray((head.stamp_ns - shift_ns) * 1e-9, np.float64)
        if not counts.packets:
            self._begun = bool(place[0])
        counts.note_times(t_s, host_s)
        counts.late += int((step_s < 0.0).sum())
        even = stepped == 1
        even[0] &= self._last is not None
        counts.revolutions += float(even.sum()) / blocks
        counts.turning_s += float(step_s[even & ~jumped].sum())
        gap = (stepped > 1) & (stepped <= per_turn) & (turns <= 1)
        counts.gaps += int(gap.sum())
        counts.lost += int((stepped[gap] - 1).sum())
        counts.lost_s += float(step_s[gap].sum())
        counts.pauses_s += step_s[(stepped > per_turn) | (turns > 1)].tolist()
        counts.paused_s = sum(counts.pauses_s)
        self._last = int(head.frame[-1]), int(place[-1]), int(head.stamp_ns[-1]), float(host_s[-1])
        return shift_ns

    def _decode(self, data: ByteArray, offset: IntArray, shift_ns: IntArray) -> tuple[Scan, IntArray]:
        """All returns of packets (m,) as one scan, and the number of them (m,) up to the end of each packet."""
        m = self.metadata
        room = len(offset) * m.packet_columns * len(m.beams) * (2 if m.layout.pixel.second_at else 1)
        out = ReturnColumns.empty(room)
        ends = np.empty(len(offset), np.int64)
        data = np.require(data, requirements=["C", "W"])
        offset = np.ascontiguousarray(offset)
        origin_m = float(np.hypot(*m.beam_m))
        self._bad_columns += _decode(data, offset, shift_ns, m.layout, m.beams, m.turned, origin_m, out, ends)
        return out.scan(int(ends[-1]), len(m.beams)), ends

    def _close(self, *, cut: bool = False) -> list[Scan]:
        """The scan of the turn that ends, which the start or the end of the recording may have `cut`."""
        whole = not cut and self._open_packets >= _WHOLE_SHARE * self.metadata.frame_packets
        pieces = [piece for piece in self._open if len(piece)]
        self._open = []
        self._open_packets = 0
        if not pieces:
            return []
        return [self.counts.numbered(Scan.joined(pieces), whole=whole)]

    def facts(self) -> dict[str, Any]:
        """What `inspect` reports of the sensor."""
        m = self.metadata
        counts = self.counts
        return {
            "model": m.product or None,
            "serial": str(m.serial) if m.serial else None,
            "firmware": m.firmware,
            "metadata": m.name,
            "profile": m.profile,
            "clock_mode": m.timestamp_mode or "not stated",
            "beams": len(m.beams),
            "columns": m.columns,
            "data_packets": counts.packets,
            "points": counts.points,
            "scans": counts.whole + counts.cut,
            "whole_scans": counts.whole,
            "rpm": round(counts.rpm, 1),
        }

    def notices(self) -> list[Notice]:
        """What is unusual about the packets so far."""
        notices = self._notices + self.counts.flow_notices()
        if self._bad_columns:
            notices.append(Notice("ouster-bad-columns", bad=self._bad_columns, name=self.metadata.name))
        return notices + self.counts.clock_notices()


@kernel_part()
def _number(data, at, size):  # type: ignore[no-untyped-def]
    value = np.int64(0)
    for k in range(size):
        value |= np.int64(data[at + k]) << (8 * k)
    return value


@kernel_part()
def _decode(data, offset, shift_ns, layout, beams, turned, origin_m, out, ends):  # type: ignore[no-untyped-def]
    """Returns of all packets in their order; the number of columns that are damaged.

    A range is measured from the lidar frame's axis along the beam, whose origin lies `origin_m` from it.
    """
    pixel = layout.pixel
    mask = (1 << pixel.range_bits) - 1
    wide = 2 if pixel.range_bits < 16 else 4
    turns = len(turned)
    n = bad = 0
    for p in range(len(offset)):
        packet_ns = _number(data, offset[p] + layout.begin, np.int64(8)) & STAMP
        for c in range(layout.columns):
            at = offset[p] + layout.begin + c * layout.size
            if data[at + layout.status_at] & 1 == 0:
                continue
            stamp_ns = _number(data, at, np.int64(8)) & STAMP
            number = _number(data, at + 8, np.int64(2))
            if number >= turns or abs(stamp_ns - packet_ns) > _COLUMN_APART_NS:
                bad += 1
                continue
            since_ns = stamp_ns - shift_ns[p]
            second = since_ns // 1_000_000_000
            t = second + (since_ns - second * 1_000_000_000) * 1e-9
            turn = turned[number]
            for k in range(len(beams)):
                slot = at + layout.head + k * pixel.pixel_bytes
                near = (_number(data, slot, wide) & mask) * pixel.range_step_mm
                bright = data[slot + pixel.reflectivity_at]
                far = np.int64(0)
                bright_far = np.uint8(0)
                if pixel.second_at:
                    far = (_number(data, slot + pixel.second_at, wide) & mask) * pixel.range_step_mm
                    bright_far = data[slot + pixel.second_at + pixel.reflectivity_at]
                    if far != 0 and (near == 0 or far < near):
                        near, far = far, near
                        bright, bright_far = bright_far, bright
                    if far == near:
                        far = np.int64(0)
                if near == 0:
                    continue
                beam = beams[k]
                ux = turn[0, 0] * beam[0] + turn[0, 1] * beam[1] + turn[0, 2] * beam[2]
                uy = turn[1, 0] * beam[0] + turn[1, 1] * beam[1] + turn[1, 2] * beam[2]
                uz = turn[2, 0] * beam[0] + turn[2, 1] * beam[1] + turn[2, 2] * beam[2]
                there = 2 if far else 1
                for which in range(there):
                    range_m = 0.001 * (far if which else near) - origin_m
                    out.t_s[n] = t
                    out.xyz_m[n, 0] = turn[0, 3] + range_m * ux
                    out.xyz_m[n, 1] = turn[1, 3] + range_m * uy
                    out.xyz_m[n, 2] = turn[2, 3] + range_m * uz
                    out.intensity[n] = bright_far if which else bright
                    out.laser[n] = np.uint8(beam[4])
                    out.column[n] = np.uint16((number + np.int64(beam[3])) % turns)
                    out.return_number[n] = which + 1
                    out.returns[n] = there
                    n += 1
        ends[p] = n
    return bad
