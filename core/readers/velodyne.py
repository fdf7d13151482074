"""Velodyne data packets to scans: calibration, firing times, azimuths, returns, and where one revolution ends.

Whoever has packets (a capture, a ROS bag) pushes them in batches through one `PacketDecoder` and gets scans back.

Sources: VLP-16 User Manual 63-9243 Rev. E (packets: section 9.3, timing: 9.4, azimuths: 9.5, angles and vertical
corrections: table 9-1), VLP-32C User Manual 63-9325 Rev. C (the same sections), HDL-32E application note 63-9277 Rev. D
(packet structure and timing). Angles and firing times agree with velodyne-decoder 3.1, which is a test.
"""

from __future__ import annotations

import difflib
from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from furrowmap.core.readers.velodyne_clock import SensorClock, settle
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.scan import Clock, Scan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]

PACKET_BYTES: Final = 1206
"""Length of a data packet's payload: 12 blocks of 100 bytes, the stamp, and two factory bytes."""
BLOCK_MARK: Final = b"\xff\xee"
"""What each block of a data packet begins with."""

STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39
RETURN_WORDS: Final = {STRONGEST: "strongest", LAST: "last", DUAL: "dual"}

_SETTLE_PACKETS: Final = 2000
"""So many packets are held back to set the sensor's clock against the recorder's (1 to 3 s)."""
_COUNTS: Final = 36_000
"""Azimuth is counted in hundredths of a degree."""
_MAX_STEP: Final = 120
"""No sensor turns further from one block to the next (0.8 degrees at 1200 rpm)."""


@dataclass(frozen=True)
class Model:
    """A sensor's geometry and timing.

    Attributes:
        name: the maker's name.
        product: product byte of its packets (VLP-16 manual, table 9-2).
        resolution_m: what a count of distance is.
        cycle_s: time between the firing sequences, in which all lasers fire once.
        laser_s: (n,) when in the sequence each laser fires, in the order of the packet.
        elevation_deg: (n,) of each laser, in the same order.
        azimuth_deg: (n,) by how much each laser looks ahead of the block's azimuth.
        height_m: (n,) height above the sensor's origin at which each beam leaves its axis.
    """

    name: str
    product: int
    resolution_m: float
    cycle_s: float
    laser_s: FloatArray
    elevation_deg: FloatArray
    azimuth_deg: FloatArray
    height_m: FloatArray

    @property
    def lasers(self) -> int:
        """Number of lasers."""
        return len(self.elevation_deg)

    def packet_s(self, mode: int) -> float:
        """Time from one packet to the next in a return mode."""
        return 12 * (32 // self.lasers) * self.cycle_s / (2 if mode == DUAL else 1)


def _down_up(low_deg: tuple[float, ...], high_deg: tuple[float, ...]) -> FloatArray:
    """Two fans of lasers that fire in turns."""
    return np.stack([low_deg, high_deg], axis=1).reshape(-1)


def _times(firings: int, apart_s: float) -> FloatArray:
    return np.arange(firings, dtype=np.float64) * apart_s


def _vlp16() -> Model:
    elevation_deg = _down_up((-15, -13, -11, -9, -7, -5, -3, -1), (1, 3, 5, 7, 9, 11, 13, 15))
    return Model(
        "VLP-16",
        0x22,
        0.002,
        55.296e-6,
        _times(16, 2.304e-6),
        elevation_deg,
        np.zeros(16),
        -41.91e-3 * np.tan(np.radians(elevation_deg)),
    )


def _puck_hi_res() -> Model:
    elevation_deg = _down_up(
        (-10, -8.667, -7.333, -6, -4.667, -3.333, -2, -0.667), (0.667, 2, 3.333, 4.667, 6, 7.333, 8.667, 10)
    )
    height_mm = _down_up((7.4, 6.5, 5.5, 4.6, 3.7, 2.7, 1.8, 0.9), (-0.9, -1.8, -2.7, -3.7, -4.6, -5.5, -6.5, -7.4))
    return Model(
        "Puck Hi-Res",
        0x24,
        0.002,
        55.296e-6,
        _times(16, 2.304e-6),
        elevation_deg,
        np.zeros(16),
        height_mm * 1e-3,
    )


def _vlp32c() -> Model:
    elevation_deg = np.array(
        (-25, -1, -1.667, -15.639, -11.31, 0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4,
         -4.667, 1.667, 1, -3.667, -3.333, 3.333, 2.333, -2.667, -3, 7, 4.667, -2.333, -2, 15, 10.333, -1.333)
    )  # fmt: skip
    azimuth_deg = np.array(
        (1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
         1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4)
    )  # fmt: skip
    return Model(
        "VLP-32C",
        0x28,
        0.004,
        55.296e-6,
        np.repeat(_times(16, 2.304e-6), 2),
        elevation_deg,
        azimuth_deg,
        -42.4e-3 * np.tan(np.radians(elevation_deg)),
    )


def _hdl32e() -> Model:
    low_deg = (-30.67, -29.33, -28, -26.67, -25.33, -24, -22.67, -21.33, -20, -18.67, -17.33, -16, -14.67, -13.33, -12,
               -10.67)  # fmt: skip
    high_deg = (-9.33, -8, -6.67, -5.33, -4, -2.67, -1.33, 0, 1.33, 2.67, 4, 5.33, 6.67, 8, 9.33, 10.67)
    elevation_deg = _down_up(low_deg, high_deg)
    return Model(
        "HDL-32E",
        0x21,
        0.002,
        46.08e-6,
        _times(32, 1.152e-6),
        elevation_deg,
        np.zeros(32),
        -28.96e-3 * np.tan(np.radians(elevation_deg)),
    )


MODELS: Final = (_vlp16(), _puck_hi_res(), _vlp32c(), _hdl32e())

_ALIASES: Final = {"Puck": "VLP-16", "Puck LITE": "VLP-16", "Ultra Puck": "VLP-32C", "VLP-16 Hi-Res": "Puck Hi-Res"}
_OTHER_PRODUCTS: Final = {
    0x23: "a VLP-32A or VLP-32B",
    0x31: "a Velarray",
    0x63: "a VLS-128 (Alpha Prime)",
    0xA1: "a VLS-128 (Alpha Prime)",
}


def model_named(name: str) -> Model:
    """The model of that name, however it is spelt.

    Raises:
        InputError: if it is none that can be decoded.
    """
    by_name = {_plain(model.name): model for model in MODELS}
    by_name.update({_plain(alias): by_name[_plain(to)] for alias, to in _ALIASES.items()})
    found = by_name.get(_plain(name))
    if found is None:
        near = difflib.get_close_matches(_plain(name), by_name, 1)
        hint = f" Perhaps you meant {by_name[near[0]].name!r}." if near else ""
        raise InputError(
            f"Unknown LiDAR model {name!r}.",
            "Angles and firing times belong to a model; with others every point would lie wrong.",
            f"Known: {', '.join(model.name for model in MODELS)}.{hint}",
            code="unknown-model",
        )
    return found


def _plain(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum()).removeprefix("velodyne")


@dataclass
class PacketCounts:
    """What went through a decoder.

    Attributes:
        packets: data packets decoded.
        points: returns given out.
        whole: scans that are whole.
        cut: scans that are not.
        modes: packets by return mode byte.
        products: packets by product byte.
        first_s: UTC of the first packet.
        last_s: UTC of the last packet.
        lost: packets that are missing where stamps leave a gap of less than half a revolution.
        gaps: such gaps.
        lost_s: their length in all.
        pauses: longer gaps.
        shortest_pause_s: the shortest of them.
        longest_pause_s: the longest.
        paused_s: their length in all.
        repeated: packets left out because the one before was the same.
        late: packets with a stamp earlier than the one before.
        bad_blocks: blocks left out because they don't begin as blocks do.
        turned: sum of the azimuths that were turned through in packets, in revolutions.
        turning_s: the time that took.
        host_minus_utc_s: recorder's time minus the stamps': smallest, largest, median of the first and last batch.
    """

    packets: int = 0
    points: int = 0
    whole: int = 0
    cut: int = 0
    first_s: float = float("nan")
    last_s: float = float("nan")
    lost: int = 0
    gaps: int = 0
    lost_s: float = 0.0
    pauses: int = 0
    shortest_pause_s: float = float("inf")
    longest_pause_s: float = 0.0
    paused_s: float = 0.0
    repeated: int = 0
    late: int = 0
    bad_blocks: int = 0
    turned: float = 0.0
    turning_s: float = 0.0
    host_minus_utc_s: tuple[float, float, float, float] = (float("inf"), float("-inf"), float("nan"), float("nan"))

    def __post_init__(self) -> None:
        self.modes: Counter[int] = Counter()
        self.products: Counter[int] = Counter()

    @property
    def rpm(self) -> float:
        """Revolutions a minute (nan where nothing turned)."""
        return 60.0 * self.turned / self.turning_s if self.turning_s else float("nan")


class PacketDecoder:
    """Turns a stream of data packets, pushed in batches in the order of time, into scans.

    Example:
        ```
        decoder = PacketDecoder(model=None, where="drive.bag, /velodyne_packets")
        for payloads, host_s in batches:            # any size, best a few hundred to a few thousand packets
            yield from decoder.push(payloads, host_s)
        yield from decoder.finish()
        notices += decoder.notices()                # complete after finish()
        clock = decoder.kind                        # known after the first scan
        ```

    Scans are cut where azimuth passes 0 and at pauses of a revolution or more; a gap of less (lost packets, or a
    sensor that is set to report a sector only) is no cut. Where a sensor reports two returns of a firing that differ,
    the nearer one is return 1 of 2 and the farther one return 2, as LAS counts them along the ray (the manual's order
    is last, then strongest or second-strongest); equal ones are one return.

    Without a `SensorClock` the first packets are held back until there are enough to set the sensor's clock against
    the recorder's: `push` then gives nothing at first.

    Args:
        model: the scanner's model, which wins over the packets' product byte; None takes what the packets say.
        clock: what the stamps count from; None finds out from the recorder's times.
        where: what an error is to name as its place: file, and topic where there is one.
        near_s: a UTC time near which the recording lies, for recorders whose clock knows no date.

    Attributes:
        counts: what went through so far.

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
        self._tables: _Tables | None = None
        self._state = np.zeros(_STATE)
        self._open: list[_Piece] = []
        self._open_whole = False
        self._number = 0
        self._last_stamp: tuple[int, int] | None = None
        self._usual_s = float("nan")

    @property
    def kind(self) -> Clock:
        """Which clock the times come from."""
        return self._clock.kind if self._clock else Clock.RECORDER

    @property
    def model(self) -> Model | None:
        """The model that packets are decoded as; None before the first."""
        return self._model

    @property
    def clock(self) -> SensorClock | None:
        """What the stamps count from; None before it is known."""
        return self._clock

    def push(self, payloads: ByteArray, host_s: FloatArray) -> list[Scan]:
        """Scans that these packets complete.

        Args:
            payloads: (m, 1206) uint8, UDP payloads of data packets.
            host_s: (m,) float64, the recorder's time of each (UTC, POSIX seconds).

        Raises:
            InputError: if the model is unknown or none that can be decoded.
        """
        payloads = np.ascontiguousarray(payloads, np.uint8)
        if payloads.ndim != 2 or payloads.shape[1] != PACKET_BYTES or len(payloads) != len(host_s):
            raise ValueError(f"payloads {payloads.shape} and host_s {np.shape(host_s)} must be (m, 1206) and (m,)")
        offset = np.arange(len(payloads), dtype=np.int64) * PACKET_BYTES
        return self.push_at(payloads.reshape(-1), offset, np.asarray(host_s, np.float64))

    def push_at(self, data: ByteArray, offset: IntArray, host_s: FloatArray) -> list[Scan]:
        """As `push`, for packets that lie in a larger buffer.

        Args:
            data: (k,) uint8.
            offset: (m,) int64, where in `data` each payload of 1206 bytes begins.
            host_s: (m,) float64, the recorder's time of each.

        Raises:
            InputError: if the model is unknown or none that can be decoded.
        """
        if not len(offset):
            return []
        if self._clock is not None:
            return self._decode(data, offset, host_s)
        self._early.append((data[offset[:, None] + np.arange(PACKET_BYTES)], host_s))
        self._early_packets += len(offset)
        return self._settle() if self._early_packets >= _SETTLE_PACKETS else []

    def finish(self) -> list[Scan]:
        """The scans that were still open or held back; the decoder takes no more packets then."""
        scans = self._settle() if self._early else []
        scans += self._close(whole=False)
        return scans

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
        again = self._repeated(device_us, azimuth)
        if again.any():
            self.counts.repeated += int(again.sum())
            offset, host_s, device_us, tail = offset[~again], host_s[~again], device_us[~again], tail[~again]
            if not len(offset):
                return []
        self.counts.modes.update(_tally(tail[:, 4]))
        self.counts.products.update(_tally(tail[:, 5]))
        if self._model is None:
            self._model = self._by_product(int(np.bincount(tail[:, 5]).argmax()))
        if self._tables is None:
            self._tables = _Tables.of(self._model)
        assert self._clock is not None
        t_s = self._clock.utc_s(device_us, host_s)
        before_s = self.counts.last_s
        batch = _run(data, offset, t_s, self._tables, self._state)
        self._note_times(t_s, host_s, before_s, int(np.bincount(tail[:, 4]).argmax()))
        return self._cut(batch)

    def _repeated(self, device_us: NDArray[np.uint32], azimuth: IntArray) -> NDArray[np.bool_]:
        """Packets that are the one before once more, as captures on several interfaces have them."""
        stamps = device_us.astype(np.int64)
        before = self._last_stamp or (-1, -1)
        same: NDArray[np.bool_] = (np.diff(stamps, prepend=before[0]) | np.diff(azimuth, prepend=before[1])) == 0
        self._last_stamp = int(stamps[-1]), int(azimuth[-1])
        return same

    def _by_product(self, product: int) -> Model:
        for model in MODELS:
            if model.product == product:
                return model
        at = f"{self._where}: " if self._where else ""
        if product in _OTHER_PRODUCTS:
            raise InputError(
                f"{at}the packets are those of {_OTHER_PRODUCTS[product]} (product byte 0x{product:02x}).",
                "Its angles and firing times are not known here, so its points cannot be placed.",
                f"Models that can be read: {', '.join(model.name for model in MODELS)}.",
                code="unsupported-model",
            )
        raise InputError(
            f"{at}the packets do not say which model they are from (product byte 0x{product:02x}).",
            "Old firmware leaves the byte empty; angles and firing times depend on the model.",
            f'State the model: model = "..." under [lidar], one of {", ".join(model.name for model in MODELS)}.',
            code="model-unknown",
        )

    def _note_times(self, t_s: FloatArray, host_s: FloatArray, before_s: float, mode: int) -> None:
        assert self._model is not None
        counts = self.counts
        counts.packets += len(t_s)
        if np.isnan(counts.first_s):
            counts.first_s = float(t_s[0])
        counts.last_s = float(t_s[-1])
        counts.turned, counts.turning_s, counts.bad_blocks = (
            float(self._state[_TURNED]) / _COUNTS,
            float(self._state[_TURNING]),
            int(self._state[_BAD]),
        )
        step_s = np.diff(t_s, prepend=before_s)
        if np.isnan(self._usual_s) and len(step_s) >= 20:
            self._usual_s = float(np.median(step_s[1:]))
        packet_s = self._usual_s if self._contradicts(self._model, mode) else self._model.packet_s(mode)
        half_turn_s = 0.5 * counts.turning_s / counts.turned if counts.turned else 0.05
        counts.late += int((step_s < 0.0).sum())
        missing = step_s[(step_s > 1.5 * packet_s) & (step_s <= half_turn_s)]
        counts.gaps += len(missing)
        counts.lost += int(np.round(missing / packet_s - 1.0).sum())
        counts.lost_s += float((missing - packet_s).sum())
        pauses_s = step_s[step_s > half_turn_s]
        if len(pauses_s):
            counts.pauses += len(pauses_s)
            counts.shortest_pause_s = min(counts.shortest_pause_s, float(pauses_s.min()))
            counts.longest_pause_s = max(counts.longest_pause_s, float(pauses_s.max()))
            counts.paused_s += float((pauses_s - packet_s).sum())
        ahead_s = host_s - t_s
        low, high, first, _ = counts.host_minus_utc_s
        median = float(np.median(ahead_s))
        counts.host_minus_utc_s = (
            min(low, float(ahead_s.min())),
            max(high, float(ahead_s.max())),
            median if np.isnan(first) else first,
            median,
        )

    def _contradicts(self, model: Model, mode: int) -> bool:
        """Whether packets follow each other at another rate than this model's."""
        return abs(self._usual_s - model.packet_s(mode)) > 0.02 * model.packet_s(mode)

    def _cut(self, batch: _Batch) -> list[Scan]:
        """Scans that end in this batch; the rest stays open."""
        scans = []
        start = 0
        for stop, by_wrap in zip(batch.cut_at.tolist(), batch.cut_by_wrap.tolist(), strict=True):
            self._open.append(batch.piece(start, stop))
            scans += self._close(whole=by_wrap)
            self._open_whole = by_wrap
            start = stop
        self._open.append(batch.piece(start, len(batch.t_s)))
        return scans

    def _close(self, *, whole: bool) -> list[Scan]:
        pieces = [piece for piece in self._open if len(piece[0])]
        self._open.clear()
        if not pieces:
            return []
        columns = pieces[0] if len(pieces) == 1 else tuple(np.concatenate(part) for part in zip(*pieces, strict=True))
        t_s, xyz_m, intensity, laser, column, return_number, returns = columns
        whole = whole and self._open_whole
        scan = Scan(self._number, t_s, xyz_m, intensity, laser, column, return_number, returns, whole)
        self._number += 1
        self.counts.points += len(t_s)
        self.counts.whole += whole
        self.counts.cut += not whole
        return [scan]

    def notices(self) -> list[Notice]:
        """What was odd about the packets so far."""
        counts = self.counts
        notices = list(self._notices)
        if self._model is not None and counts.packets:
            notices += self._model_notices(self._model)
        if len(counts.modes) > 1:
            notices.append(Notice("return-mode-changed", f"The return mode changes: {_mode_words(counts.modes)}."))
        elif counts.modes and not counts.modes.keys() & RETURN_WORDS.keys():
            notices.append(
                Notice(
                    "return-mode-unknown",
                    f"The packets' return mode byte (0x{next(iter(counts.modes)):02x}) is none that is known: they are"
                    " taken as dual where pairs of blocks have one azimuth, as single elsewhere.",
                )
            )
        if counts.gaps:
            notices.append(
                Notice(
                    "lost-packets",
                    f"{counts.lost:,} packets are missing in {counts.gaps:,} gaps, {counts.lost_s:.3f} s in all"
                    f" ({100 * counts.lost / (counts.lost + counts.packets):.1f} %).",
                )
            )
        if counts.pauses:
            notices.append(
                Notice(
                    "pauses",
                    f"{counts.pauses:,} pauses of {counts.shortest_pause_s:.4g} to {counts.longest_pause_s:.4g} s,"
                    f" {counts.paused_s:.1f} s in all: only a part was stored, or the sensor reports a sector only.",
                )
            )
        if counts.repeated:
            notices.append(Notice("repeated-packets", f"{counts.repeated:,} packets are there twice; one was taken."))
        if counts.late:
            notices.append(Notice("late-packets", f"{counts.late:,} packets are stamped earlier than the one before."))
        if counts.bad_blocks:
            notices.append(Notice("bad-blocks", f"{counts.bad_blocks:,} damaged blocks of packets were left out."))
        if self._clock is not None and self._clock.jumps:
            at_s, size_s = self._clock.jumps[0]
            notices.append(
                Notice(
                    "clock-jumps",
                    f"The sensor's clock was set anew {len(self._clock.jumps):,} times, first by {size_s:+.3f} s at"
                    f" {iso_utc(at_s)}; time runs on across it by the recorder's clock.",
                )
            )
        return notices

    def _model_notices(self, model: Model) -> list[Notice]:
        notices = []
        counts = self.counts
        said = {product: n for product, n in counts.products.items() if product != model.product}
        if said:
            names = {m.product: m.name for m in MODELS} | {p: w.split(" ", 1)[1] for p, w in _OTHER_PRODUCTS.items()}
            words = ", ".join(f"{names.get(p, 'unknown')} (0x{p:02x}) in {n:,} packets" for p, n in said.items())
            why = "stated" if self._stated else "said by the first packets"
            notices.append(
                Notice("model-differs", f"Decoded as {model.name}, as {why}; the product byte says {words}.")
            )
        mode = counts.modes.most_common(1)[0][0]
        if self._contradicts(model, mode):
            fits = [
                f"{m.name} ({word})"
                for m in MODELS
                for byte, word in ((STRONGEST, "one return"), (DUAL, "dual"))
                if abs(self._usual_s - m.packet_s(byte)) <= 0.02 * m.packet_s(byte)
            ]
            notices.append(
                Notice(
                    "packet-rate",
                    f"A packet every {1e3 * self._usual_s:.3f} ms contradicts a {model.name} with"
                    f" {'two returns' if mode == DUAL else 'one return'} ({1e3 * model.packet_s(mode):.3f} ms);"
                    f" it would fit {' or '.join(fits) or 'no known model'}.",
                )
            )
        return notices


_Piece = tuple[
    FloatArray,
    NDArray[np.float32],
    ByteArray,
    ByteArray,
    NDArray[np.uint16],
    ByteArray,
    ByteArray,
]
"""Part of a scan: the arrays of `Scan`, in its order."""


@dataclass(frozen=True)
class _Batch:
    """The returns of some packets, and where among them scans end."""

    t_s: FloatArray
    xyz_m: NDArray[np.float32]
    intensity: ByteArray
    laser: ByteArray
    column: NDArray[np.uint16]
    return_number: ByteArray
    returns: ByteArray
    cut_at: IntArray
    cut_by_wrap: NDArray[np.bool_]

    def piece(self, start: int, stop: int) -> _Piece:
        part = slice(start, stop)
        return (
            self.t_s[part],
            self.xyz_m[part],
            self.intensity[part],
            self.laser[part],
            self.column[part],
            self.return_number[part],
            self.returns[part],
        )


@dataclass(frozen=True)
class _Tables:
    """A model as the kernel wants it: per laser when it fires, where it looks, and its place by elevation."""

    cycle_s: float
    resolution_m: float
    lasers: FloatArray
    order: ByteArray

    @classmethod
    def of(cls, model: Model) -> _Tables:
        elevation = np.radians(model.elevation_deg)
        azimuth = np.radians(model.azimuth_deg)
        lasers = np.stack([model.laser_s, azimuth, np.cos(elevation), np.sin(elevation), model.height_m], axis=1)
        order = np.empty(model.lasers, np.uint8)
        order[np.argsort(model.elevation_deg, kind="stable")] = np.arange(model.lasers, dtype=np.uint8)
        return cls(model.cycle_s, model.resolution_m, np.ascontiguousarray(lasers), order)


_STARTED, _AZIMUTH, _TIME, _COLUMN, _TURNED, _TURNING, _BAD, _STATE = range(8)
"""What the kernel carries from batch to batch; the last is how many that is."""


def _run(data: ByteArray, offset: IntArray, t_s: FloatArray, tables: _Tables, state: FloatArray) -> _Batch:
    """The typed face of the kernel (which is compiled once, so for writable arrays alone)."""
    slots = len(offset) * 384
    t_out = np.empty(slots)
    xyz = np.empty((slots, 3), np.float32)
    intensity = np.empty(slots, np.uint8)
    laser = np.empty(slots, np.uint8)
    column = np.empty(slots, np.uint16)
    return_number = np.empty(slots, np.uint8)
    returns = np.empty(slots, np.uint8)
    cut_at = np.empty(len(offset) * 24, np.int64)
    cut_by_wrap = np.empty(len(offset) * 24, np.bool_)
    n, cuts = _decode(
        np.require(data, requirements=["C", "W"]), np.ascontiguousarray(offset), np.ascontiguousarray(t_s),
        tables.cycle_s, tables.resolution_m, tables.lasers, tables.order, state,
        t_out, xyz, intensity, laser, column, return_number, returns, cut_at, cut_by_wrap,
    )  # fmt: skip
    return _Batch(
        t_out[:n], xyz[:n], intensity[:n], laser[:n], column[:n], return_number[:n], returns[:n],
        cut_at[:cuts], cut_by_wrap[:cuts],
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _decode(  # type: ignore[no-untyped-def]
    data, offset, t_s, cycle_s, resolution_m, lasers, order, state,
    t_out, xyz, intensity, laser, column, return_number, returns, cut_at, cut_by_wrap,
):  # fmt: skip
    """Returns of all packets in the order of firing; how many, and how many scans end among them.

    The azimuth of a firing is its block's, carried on by the packet's mean rate of turning (which averages out the
    encoder's rounding over 11 blocks), to the microsecond of each laser's own firing (VLP-16 manual, section 9.5).
    A sensor that is set to report only a sector leaves the rest out and fills its packets across: the blocks after
    the leap were fired as much later as turning there took.
    """
    lasers_n = len(order)
    per_block = 32 // lasers_n
    to_rad = np.pi / 18_000.0
    cos_ahead = np.empty(lasers_n)
    sin_ahead = np.empty(lasers_n)
    n = 0
    cuts = 0
    for p in range(len(offset)):
        base = offset[p]
        mode = data[base + 1204]
        same = data[base + 2] == data[base + 102] and data[base + 3] == data[base + 103]
        dual = mode == 0x39 or (mode != 0x37 and mode != 0x38 and same)
        blocks = 6 if dual else 12
        size = 200 if dual else 100

        turned = np.int64(0)
        steps = 0
        before = (np.int64(data[base + 2]) | np.int64(data[base + 3]) << 8) % 36_000
        for b in range(1, blocks):
            block = (np.int64(data[base + b * size + 2]) | np.int64(data[base + b * size + 3]) << 8) % 36_000
            step = (block - before + 18_000) % 36_000 - 18_000
            if abs(step) <= _MAX_STEP:
                turned += step
                steps += 1
            before = block
        rate = max(0.0, turned / (steps * per_block * cycle_s)) if steps else 0.0
        state[_TURNED] += turned
        state[_TURNING] += steps * per_block * cycle_s
        hidden = steps == blocks - 2  # one leap: the edges of the sector that the sensor is set to report
        hidden_s = 0.0
        for i in range(lasers_n):
            ahead = lasers[i, 1] + rate * lasers[i, 0] * to_rad
            cos_ahead[i] = np.cos(ahead) * lasers[i, 2]
            sin_ahead[i] = np.sin(ahead) * lasers[i, 2]
        turn_s = 36_000.0 / rate if rate > 0.0 else 0.1
        before = (np.int64(data[base + 2]) | np.int64(data[base + 3]) << 8) % 36_000
        for b in range(blocks):
            at = base + b * size
            if data[at] != 0xFF or data[at + 1] != 0xEE:
                state[_BAD] += 12 - (2 * b if dual else b)
                break
            block = (np.int64(data[at + 2]) | np.int64(data[at + 3]) << 8) % 36_000
            leap = (block - before) % 36_000
            if hidden and _MAX_STEP < leap < 36_000 - _MAX_STEP and rate > 0.0:
                hidden_s = (np.round(leap / (rate * cycle_s)) - per_block) * cycle_s
            before = block
            for f in range(per_block):
                azimuth = block + rate * cycle_s * f
                if azimuth >= 36_000.0:
                    azimuth -= 36_000.0
                fired_s = t_s[p] + (b * per_block + f) * cycle_s + hidden_s
                gap_s = fired_s - state[_TIME]
                fallen = state[_AZIMUTH] - azimuth
                pause = gap_s >= turn_s or gap_s < -turn_s
                wrap = fallen > (18_000.0 if gap_s < 0.25 * turn_s else 50.0)
                if state[_STARTED] == 0.0:
                    state[_STARTED] = 1.0
                    state[_COLUMN] = 0.0
                elif pause or wrap or state[_COLUMN] >= 65_535.0:
                    cut_at[cuts] = n
                    cut_by_wrap[cuts] = wrap and not pause
                    cuts += 1
                    state[_COLUMN] = 0.0
                else:
                    state[_COLUMN] += 1.0
                state[_AZIMUTH] = azimuth
                state[_TIME] = fired_s
                cos_a = np.cos(azimuth * to_rad)
                sin_a = np.sin(azimuth * to_rad)
                col = np.uint16(state[_COLUMN])
                slot = at + 4 + f * lasers_n * 3
                for i in range(lasers_n):
                    near = np.int64(data[slot]) | np.int64(data[slot + 1]) << 8
                    bright = data[slot + 2]
                    far = np.int64(0)
                    bright_far = bright
                    if dual:
                        other = np.int64(data[slot + 100]) | np.int64(data[slot + 101]) << 8
                        bright_other = data[slot + 102]
                        if near == 0 or near == other:
                            near = other
                            bright = bright_other
                        elif other > near:
                            far = other
                            bright_far = bright_other
                        elif other != 0:
                            far = near
                            bright_far = bright
                            near = other
                            bright = bright_other
                    slot += 3
                    if near == 0:
                        continue
                    ux = cos_a * cos_ahead[i] - sin_a * sin_ahead[i]
                    uy = -(sin_a * cos_ahead[i] + cos_a * sin_ahead[i])
                    range_m = near * resolution_m
                    t_out[n] = fired_s + lasers[i, 0]
                    xyz[n, 0] = range_m * ux
                    xyz[n, 1] = range_m * uy
                    xyz[n, 2] = range_m * lasers[i, 3] + lasers[i, 4]
                    intensity[n] = bright
                    laser[n] = order[i]
                    column[n] = col
                    return_number[n] = 1
                    returns[n] = 1
                    n += 1
                    if far == 0:
                        continue
                    returns[n - 1] = 2
                    range_m = far * resolution_m
                    t_out[n] = t_out[n - 1]
                    xyz[n, 0] = range_m * ux
                    xyz[n, 1] = range_m * uy
                    xyz[n, 2] = range_m * lasers[i, 3] + lasers[i, 4]
                    intensity[n] = bright_far
                    laser[n] = order[i]
                    column[n] = col
                    return_number[n] = 2
                    returns[n] = 2
                    n += 1
    return n, cuts


def _tally(values: ByteArray) -> dict[int, int]:
    counts = np.bincount(values)
    return {int(value): int(counts[value]) for value in np.flatnonzero(counts)}


def _mode_words(modes: Counter[int]) -> str:
    return ", ".join(f"{RETURN_WORDS.get(mode, f'0x{mode:02x}')} in {n:,} packets" for mode, n in modes.most_common())
