"""Data packets of spinning scanners to scans, cut where a revolution ends.

The reader of a capture or a ROS bag pushes packets in batches through one `PacketDecoder` and gets scans back.
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.packet_counts import ScannerCounts
from furrowmap.core.readers.return_columns import ReturnColumns
from furrowmap.core.readers.spinning.hour_clock import SensorClock, settle
from furrowmap.core.readers.spinning.scanner_model import (
    MAX_RETURNS,
    RATE_TOLERANCE,
    AngleTable,
    ByteArray,
    Maker,
    Model,
)
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.kernels import kernel_part
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.scan import Clock, Scan

_FASTEST: Final = 1.5 * 720_000.0
"""Largest turning rate in hundredths of a degree per second: that of 1200 rpm, with a margin for lost blocks."""


_STARTED, _AZIMUTH, _TIME, _COLUMN, _RATE, TURNED, TURNING, BAD_BLOCKS, CARRIED = range(9)
"""Indices into the state from batch to batch: the last firing and its column; the turning rate; hundredths of a degree
turned within packets, the duration of that in seconds, and blocks skipped because their mark is wrong, summed over all
packets. The last is its length."""


class ScanCuts(NamedTuple):
    """Where one scan ends and the next begins.

    Attributes:
        at: (c,) index of the first return of each next scan.
        by_wrap: (c,) whether azimuth passed 0 there, else there was a pause.
    """

    at: IntArray
    by_wrap: NDArray[np.bool_]


class DecoderScratch(NamedTuple):
    """Room for what the kernel keeps of each laser while the turning rate stays, and of the returns of one.

    Attributes:
        cos_ahead: (n,) of the azimuth against that of the firing, times the cosine of the elevation.
        sin_ahead: (n,) the same of the sine.
        columns_ahead: (n,) of lasers that look aside.
        ranges: (3,) in steps, by distance.
        intensity: (3,) the same.
    """

    cos_ahead: FloatArray
    sin_ahead: FloatArray
    columns_ahead: IntArray
    ranges: IntArray
    intensity: ByteArray

    @classmethod
    def empty(cls, lasers: int) -> "DecoderScratch":
        """Room for so many lasers."""
        of_one = np.empty(MAX_RETURNS, np.int64), np.empty(MAX_RETURNS, np.uint8)
        return cls(np.empty(lasers), np.empty(lasers), np.empty(lasers, np.int64), *of_one)


def decode_returns(
    data: ByteArray, offset: IntArray, t_s: FloatArray, returns_of: ByteArray, model: Model, carried: FloatArray
) -> tuple[Scan, ScanCuts]:
    """The returns of data packets, as one scan, and where scans end among them.

    Args:
        data: (k,) the bytes of the packets.
        offset: (m,) where in `data` each packet begins.
        t_s: (m,) UTC of the stamp of each packet.
        returns_of: (m,) returns that firings of each packet have, 1 to 3.
        carried: (:data:`CARRIED`,) state after the batch before, at first zeros; updated.
    """
    out = ReturnColumns.empty(len(offset) * model.layout.blocks * model.layout.units)
    firings = len(offset) * model.groups(1) * model.firings_per_block
    cuts = ScanCuts(np.empty(firings, np.int64), np.empty(firings, np.bool_))
    scratch = DecoderScratch.empty(model.lasers)
    # A read-only array is another type to numba: the kernel would be compiled a second time.
    data = np.require(data, requirements=["C", "W"])
    offset = np.ascontiguousarray(offset)
    n, ends = _decode(data, offset, np.ascontiguousarray(t_s), returns_of, model.tables, carried, scratch, out, cuts)
    return out.scan(n, model.lasers), ScanCuts(cuts.at[:ends], cuts.by_wrap[:ends])


@kernel_part()
def _decode(data, offset, t_s, returns_of, model, state, scratch, out, cuts):  # type: ignore[no-untyped-def]
    """Returns of all packets in the order of firing; their number, and the number of scans that end among them.

    Azimuth is in hundredths of a degree. The azimuth of a firing is that of its block, extrapolated by the packet's
    mean turning rate (which averages the encoder's rounding over the blocks) to the firing time of each laser (VLP-16
    manual, section 9.5; PandarXT manual, appendix on absolute times). A sensor that reports only a sector fills its
    packets across the gap: the blocks after the leap are later by the time that turning through the gap takes.
    """
    per_block = model.firings_per_block
    cycle_s = model.cycle_s
    max_step = np.ceil(_FASTEST * (per_block * cycle_s))
    tabled_rate = -1.0
    n = 0
    ends = 0
    for p in range(len(offset)):
        base = offset[p] + model.header
        echoes = np.int64(returns_of[p])
        blocks = model.azimuths[echoes - 1]
        start_s = t_s[p] + model.first_firing_s[echoes - 1]
        steps = _turn(data, base + model.azimuth, blocks, model.stride[echoes - 1], start_s, model, state)
        rate = state[_RATE]
        hidden = steps == blocks - 2  # one leap, between the edges of the sector that the sensor reports
        hidden_s = 0.0
        if rate != tabled_rate:
            _aim(rate, model, scratch)
        tabled_rate = rate
        turn_s = 36_000.0 / rate if rate > 0.0 else 0.1
        before = _azimuth(data, base + model.azimuth)
        for b in range(blocks):
            at = base + b * model.stride[echoes - 1]
            if model.marked and (data[at] != 0xFF or data[at + 1] != 0xEE):
                state[BAD_BLOCKS] += model.blocks - b * model.blocks // blocks
                break
            block = _azimuth(data, at + model.azimuth)
            leap = (block - before) % 36_000
            if hidden and max_step < leap < 36_000 - max_step and rate > 0.0:
                hidden_s = (np.rint(leap / (rate * cycle_s)) - per_block) * cycle_s
            before = block
            for f in range(per_block):
                azimuth = block + rate * cycle_s * f
                if azimuth >= 36_000.0:
                    azimuth -= 36_000.0
                fired_s = start_s + (b * per_block + f) * cycle_s + hidden_s
                cut, by_wrap = _next_column(azimuth, fired_s, turn_s, state)
                if cut:
                    cuts.at[ends] = n
                    cuts.by_wrap[ends] = by_wrap
                    ends += 1
                from_ = at + f * len(model.order) * model.unit
                n = _fire(data, from_, echoes, azimuth, fired_s, np.int64(state[_COLUMN]), model, scratch, out, n)
    return n, ends


# Inlined by numba: to pass tables and arrays to each would take longer than some of them take.
@kernel_part(inline="always")
def _azimuth(data, at):  # type: ignore[no-untyped-def]
    return (np.int64(data[at]) | np.int64(data[at + 1]) << 8) % 36_000


@kernel_part(inline="always")
def _turn(data, at, blocks, stride, start_s, model, state):  # type: ignore[no-untyped-def]
    """Set the turning rate to that of a packet with azimuths from `at` on; the number of steps that show it."""
    group_s = model.firings_per_block * model.cycle_s
    max_step = np.ceil(_FASTEST * group_s)
    turned = np.int64(0)
    steps = 0
    before = _azimuth(data, at)
    if blocks == 1 and state[_STARTED] == 1.0 and 0.5 < (start_s - state[_TIME]) / group_s < 1.5:
        step = (before - np.int64(state[_AZIMUTH]) + 18_000) % 36_000 - 18_000
        if 0 <= step <= max_step:
            turned += step
            steps += 1
    for b in range(1, blocks):
        block = _azimuth(data, at + b * stride)
        step = (block - before + 18_000) % 36_000 - 18_000
        if abs(step) <= max_step:
            turned += step
            steps += 1
        before = block
    if steps:
        state[_RATE] = max(0.0, turned / (steps * group_s))
    state[TURNED] += turned
    state[TURNING] += steps * group_s
    return steps


@kernel_part(inline="always")
def _aim(rate, model, scratch):  # type: ignore[no-untyped-def]
    """Set where lasers look against the azimuth of their firing, at a turning rate."""
    to_rad = np.pi / 18_000.0
    lasers = model.lasers
    least = lasers[0, 1]
    for i in range(len(lasers)):
        least = min(least, lasers[i, 1])
    for i in range(len(lasers)):
        ahead = lasers[i, 1] + rate * lasers[i, 0] * to_rad
        scratch.cos_ahead[i] = np.cos(ahead) * lasers[i, 2]
        scratch.sin_ahead[i] = np.sin(ahead) * lasers[i, 2]
        # of steps of 0.01 degrees at least
        columns = (lasers[i, 1] - least) / (max(rate * model.cycle_s, 1.0) * to_rad)
        scratch.columns_ahead[i] = np.int64(np.rint(columns))


@kernel_part(inline="always")
def _next_column(azimuth, fired_s, turn_s, state):  # type: ignore[no-untyped-def]
    """Number the column of a firing; whether a scan ends before it, and that because azimuth passed 0."""
    gap_s = fired_s - state[_TIME]
    fallen = state[_AZIMUTH] - azimuth
    pause = gap_s >= turn_s or gap_s < -turn_s
    wrap = fallen > (18_000.0 if gap_s < 0.25 * turn_s else 50.0)
    begun = state[_STARTED] == 1.0
    cut = begun and (pause or wrap or state[_COLUMN] >= 65_535.0)
    state[_COLUMN] = state[_COLUMN] + 1.0 if begun and not cut else 0.0
    state[_STARTED] = 1.0
    state[_AZIMUTH] = azimuth
    state[_TIME] = fired_s
    return cut, wrap and not pause


@kernel_part(inline="always")
def _fire(data, at, echoes, azimuth, fired_s, column, model, scratch, out, n):  # type: ignore[no-untyped-def]
    """Add the returns of a firing, whose lasers are from `at` on, to the `n` before; how many there are then."""
    azimuth_rad = azimuth * (np.pi / 18_000.0)
    cos_a = np.cos(azimuth_rad)
    sin_a = np.sin(azimuth_rad)
    for i in range(len(model.order)):
        # Unsigned, as the sign of other indices is looked at each time.
        found = _echoes(data, np.uint64(at + model.first_return[echoes - 1, i]), echoes, model.block, scratch)
        if found == 0:
            continue
        ux = cos_a * scratch.cos_ahead[i] - sin_a * scratch.sin_ahead[i]
        uy = -(sin_a * scratch.cos_ahead[i] + cos_a * scratch.sin_ahead[i])
        for k in range(found):
            m = np.uint64(n)
            range_m = scratch.ranges[k] * model.resolution_m
            out.t_s[m] = fired_s + model.lasers[i, 0]
            out.xyz_m[m, 0] = range_m * ux
            out.xyz_m[m, 1] = range_m * uy
            out.xyz_m[m, 2] = range_m * model.lasers[i, 3] + model.lasers[i, 4]
            out.intensity[m] = scratch.intensity[k]
            out.laser[m] = model.order[i]
            out.column[m] = min(column + scratch.columns_ahead[i], 65_535)
            out.return_number[m] = k + 1
            out.returns[m] = found
            n += 1
    return n


@kernel_part(inline="always")
def _echoes(data, slot, echoes, block, scratch):  # type: ignore[no-untyped-def]
    """Set the returns of a laser from `slot` on by distance, of equal ones the last; how many there are."""
    found = 0
    for _ in range(echoes):
        count = np.int64(data[slot]) | np.int64(data[slot + np.uint64(1)]) << 8
        value = data[slot + np.uint64(2)]
        slot += np.uint64(block)
        if count == 0:
            continue
        k = found
        while k > 0 and scratch.ranges[k - 1] > count:
            scratch.ranges[k] = scratch.ranges[k - 1]
            scratch.intensity[k] = scratch.intensity[k - 1]
            k -= 1
        if k > 0 and scratch.ranges[k - 1] == count:
            scratch.intensity[k - 1] = value
            continue
        scratch.ranges[k] = count
        scratch.intensity[k] = value
        found += 1
    return found


@dataclass
class PacketCounts(ScannerCounts):
    """Counts over the packets of a spinning scanner.

    Attributes:
        usual_s: time between packets, median of the first batch of 20 or more.
        bad_blocks: blocks skipped because their mark is wrong.
    """

    maker: Maker = field(kw_only=True)
    modes: Counter[int] = field(default_factory=Counter)
    products: Counter[int] = field(default_factory=Counter)
    usual_s: float = float("nan")
    bad_blocks: int = 0

    @property
    def mode(self) -> int:
        """The return mode byte of most packets."""
        return self.modes.most_common(1)[0][0]

    def packet_s(self, model: Model) -> float:
        """Time from one packet to the next of a model in that mode."""
        return model.packet_s(self.maker.modes.get(self.mode, (1, ""))[0])

    def note_gaps(self, t_s: FloatArray, model: Model) -> None:
        """Count gaps and disorder in the UTC `t_s` (m,) of packets, before :meth:`note_times`."""
        step_s = np.diff(t_s, prepend=self.last_s)
        if np.isnan(self.usual_s) and len(step_s) >= 20:
            self.usual_s = float(np.median(step_s[1:]))
        self.late += int((step_s < 0.0).sum())
        packet_s = self.usual_s if self._contradicts(model) else self.packet_s(model)
        half_turn_s = 0.5 * self.turning_s / self.revolutions if self.revolutions > 0.0 else 0.05
        missing_s = step_s[(step_s > 1.5 * packet_s) & (step_s <= half_turn_s)]
        self.gaps += len(missing_s)
        self.lost += int(np.round(missing_s / packet_s - 1.0).sum())
        self.lost_s += float((missing_s - packet_s).sum())
        pauses_s = step_s[step_s > half_turn_s]
        self.pauses_s += pauses_s.tolist()
        self.paused_s += float((pauses_s - packet_s).sum())

    def notices(self, model: Model, *, stated: bool) -> list[Notice]:
        """What is unusual; `stated` says whether the session states it, rather than the packets."""
        notices = []
        others = {product: n for product, n in self.products.items() if product != model.product}
        if others:
            names = {**self.maker.others, **{m.product: m.name for m in self.maker.models}}
            words = ", ".join(f"{names.get(p, 'unknown')} (0x{p:02x}) in {n:,} packets" for p, n in others.items())
            notices.append(Notice("model-differs", model=model.name, stated=bool(stated), words=words))
        if self._contradicts(model):
            fits = [
                Text("{model} ({returns})", model=m.name, returns=word)
                for m in self.maker.models
                for returns, word in ((1, Text("one return")), (2, Text("dual")))
                if abs(self.usual_s - m.packet_s(returns)) <= RATE_TOLERANCE * m.packet_s(returns)
            ]
            notices.append(
                Notice(
                    "packet-rate",
                    interval_ms=1e3 * self.usual_s,
                    model=model.name,
                    dual=self.maker.modes.get(self.mode, (1, ""))[0] > 1,
                    expected_ms=1e3 * self.packet_s(model),
                    fits=fits or Text("no known model"),
                )
            )
        if len(self.modes) > 1:
            modes = [
                Text("{mode} in {packets:,} packets", mode=self.maker.mode_name(mode), packets=n)
                for mode, n in self.modes.most_common()
            ]
            notices.append(Notice("return-mode-changed", words=modes))
        elif self.mode not in self.maker.modes:
            notices.append(Notice("return-mode-unknown", mode=self.mode))
        notices += self.flow_notices()
        if self.bad_blocks:
            notices.append(Notice("bad-blocks", bad_blocks=self.bad_blocks))
        return notices

    def _contradicts(self, model: Model) -> bool:
        """Whether the packet rate differs from that of the model."""
        return abs(self.usual_s - self.packet_s(model)) > RATE_TOLERANCE * self.packet_s(model)


_SETTLE_PACKETS: Final = 2000
"""Number of packets that are held back to compare the sensor's clock with the recorder's (1 to 3 s)."""

_LONE_REVOLUTION: Final = (0.95, 1.1)
"""Length of a revolution that was recorded alone: some packets more or less, never a tenth of a revolution more."""


class PacketDecoder:
    """Decodes a stream of data packets, pushed in batches in the order of time, into scans.

    Example:
        ```
        decoder = PacketDecoder(VELODYNE, where="drive.bag, /velodyne_packets")
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
        angles: the sensor's own angles; None for those of the model.
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
        maker: Maker,
        model: str | None = None,
        *,
        angles: AngleTable | None = None,
        clock: SensorClock | None = None,
        where: str = "",
        near_s: float | None = None,
    ) -> None:
        self.counts = PacketCounts(maker=maker)
        self._maker = maker
        self._stated = maker.named(model) if model else None
        self._model: Model | None = None
        self._angles = angles
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
        self._last_stamp = (-1, -1)

    @property
    def kind(self) -> Clock:
        """The clock that the times come from."""
        return self._clock.kind if self._clock else Clock.RECORDER

    @property
    def model(self) -> Model | None:
        """The model that packets are decoded as; None before the first packet."""
        return self._model

    @property
    def angles(self) -> dict[str, str]:
        """Where the angles are from, for `inspect`; nothing of makers whose sensors have none of their own."""
        if not self._maker.calibrated:
            return {}
        return {"angles": self._angles.path.name if self._angles is not None else "of the model"}

    def push(self, payloads: ByteArray, host_s: FloatArray) -> list[Scan]:
        """Scans that these packets complete; InputError if the model is unknown or not supported.

        Payloads (m, k) are uint8 data packets; `host_s` (m,) is the recorder's time of each (UTC, POSIX seconds).
        """
        payloads = np.ascontiguousarray(payloads, np.uint8)
        if payloads.ndim != 2 or len(payloads) != len(host_s):
            raise ValueError(f"payloads {payloads.shape} and host_s {np.shape(host_s)} must be (m, k) and (m,)")
        offset = np.arange(len(payloads), dtype=np.int64) * payloads.shape[1]
        data = payloads.reshape(-1)
        product = self._maker.products(data, offset, np.full(len(offset), payloads.shape[1]))
        return self.push_at(data, offset, product, np.asarray(host_s, np.float64))

    def push_at(self, data: ByteArray, offset: IntArray, product: IntArray, host_s: FloatArray) -> list[Scan]:
        """As `push`, for packets that begin at offsets (m,) of a larger buffer.

        Each has a product (m,), see `Maker.products`; packets with negative ones are skipped.
        """
        mine = product >= 0
        if self._model is None and mine.any():
            self._model = self._model_of(data, offset[mine], product[mine])
        if self._model is not None:
            mine &= ~np.isin(product, self._maker.differently_packed(self._model.layout))
        self.counts.foreign += int((~mine).sum())
        if not mine.any():
            return []
        data_offset = offset[mine]
        host_s = host_s[mine]
        self.counts.products.update(sorted(product[mine].tolist()))
        if self._clock is not None:
            return self._decode(data, data_offset, host_s)
        assert self._model is not None
        self._early.append((data[data_offset[:, None] + np.arange(min(self._model.layout.lengths))], host_s))
        self._early_packets += len(data_offset)
        return self._settle() if self._early_packets >= _SETTLE_PACKETS else []

    def finish(self) -> list[Scan]:
        """The scans that are still open or held back; call it once, after the last packet."""
        scans = self._settle() if self._early else []
        return scans + self._close(by_wrap=False) + self._release()

    def _model_of(self, data: ByteArray, offset: IntArray, product: IntArray) -> Model:
        """The model of the first packets: of most of them, with the firing times of its firmware and its own angles."""
        kinds, count = np.unique(product, return_counts=True)
        most = int(kinds[np.argmax(count)])
        model = self._stated or self._maker.model_of(most, self._where)
        if most in self._maker.differently_packed(model.layout):
            raise InputError(
                "model-contradicted",
                where=self._where,
                stated=model.name,
                packed=self._maker.model_of(most, self._where).name,
            )
        if model.slowest_s and len(offset) > 1:
            usual_us = float(np.median(np.diff(model.layout.stamp_us(data, offset).astype(np.int64))))
            model = model.as_fired(usual_us * 1e-6, int(self._maker.returns(data, offset[:1], model)[0]))
        if model.layout.distance_mm is not None:
            model = replace(model, resolution_m=float(data[offset[0] + model.layout.distance_mm]) * 1e-3)
        if self._angles is not None:
            return self._angles.applied(model)
        if self._maker.calibrated:
            self._notices.append(Notice("angles-of-model", model=f"{self._maker.name} {model.name}"))
        return model

    def _settle(self) -> list[Scan]:
        assert self._model is not None
        payloads = np.concatenate([early for early, _ in self._early])
        host_s = np.concatenate([host_s for _, host_s in self._early])
        self._early.clear()
        data = payloads.reshape(-1)
        offset = np.arange(len(payloads), dtype=np.int64) * payloads.shape[1]
        self._clock, notices = settle(self._model.layout.stamp_us(data, offset), host_s, [], self._near_s)
        self._notices += notices
        return self._decode(data, offset, host_s)

    def _decode(self, data: ByteArray, offset: IntArray, host_s: FloatArray) -> list[Scan]:
        assert self._model is not None
        layout = self._model.layout
        device_us = layout.stamp_us(data, offset)
        at = offset + layout.header + layout.azimuth
        azimuth = data[at].astype(np.int64) | data[at + 1].astype(np.int64) << 8
        # Captures on several interfaces repeat packets.
        stamps = device_us.astype(np.int64)
        before = self._last_stamp
        again = (np.diff(stamps, prepend=before[0]) | np.diff(azimuth, prepend=before[1])) == 0
        self._last_stamp = int(stamps[-1]), int(azimuth[-1])
        if again.any():
            self.counts.repeated += int(again.sum())
            offset = offset[~again]
            host_s = host_s[~again]
            device_us = device_us[~again]
            if not len(offset):
                return []
        self.counts.modes.update(sorted(data[offset + layout.mode].tolist()))
        assert self._clock is not None
        t_s = self._clock.utc_s(device_us, host_s)
        returns, cuts = decode_returns(
            data, offset, t_s, self._maker.returns(data, offset, self._model), self._model, self._carried
        )
        self.counts.revolutions = float(self._carried[TURNED]) / 36_000
        self.counts.turning_s = float(self._carried[TURNING])
        self.counts.bad_blocks = int(self._carried[BAD_BLOCKS])
        self.counts.note_gaps(t_s, self._model)
        self.counts.note_times(t_s, host_s)
        self.counts.jumps = self._clock.jumps
        scans = []
        start = 0
        for stop, by_wrap in zip(cuts.at.tolist(), cuts.by_wrap.tolist(), strict=True):
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
            first = self._held
            self._held = None
            piece.column[:] += first.column.max() + 1
            return [self.counts.numbered(Scan.joined([first, piece]), whole=True)]
        return [*self._release(), self.counts.numbered(piece, whole=by_wrap and self._open_by_wrap)]

    def _release(self) -> list[Scan]:
        """The piece that was held back, now known to be an incomplete revolution."""
        held = self._held
        self._held = None
        return [] if held is None else [self.counts.numbered(held, whole=False)]

    def _is_lone_revolution(self, first: Scan, second: Scan) -> bool:
        """Whether two pieces with azimuth 0 between them are one revolution without lost firings."""
        if not self.counts.revolutions:
            return False
        assert self._model is not None
        revolution_s = self.counts.turning_s / self.counts.revolutions
        fired_s = (int(first.column.max()) + int(second.column.max())) * self._model.cycle_s
        low, high = _LONE_REVOLUTION
        return fired_s >= low * revolution_s and float(second.t_s[-1] - first.t_s[0]) <= high * revolution_s

    def notices(self) -> list[Notice]:
        """What is unusual about the packets so far."""
        notices = list(self._notices)
        if self._model is not None and self.counts.packets:
            notices += self.counts.notices(self._model, stated=self._stated is not None)
        return notices + self.counts.clock_notices()
