"""Counts of a packet decoder, and notices from them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from furrowmap.core.readers.velodyne.models import DUAL, MODELS, OTHER_PRODUCTS, RETURN_WORDS, STRONGEST, Model
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice

_RATE_TOLERANCE: Final = 0.02


@dataclass
class PacketCounts:
    """Counts over the packets of a decoder.

    Attributes:
        packets: decoded data packets.
        points: returns in the scans.
        whole: complete scans.
        cut: incomplete scans.
        modes: packets by return mode byte.
        products: packets by product byte.
        first_s: UTC of the first packet.
        last_s: UTC of the last packet.
        usual_s: time between packets, median of the first batch of 20 or more.
        lost: packets missing in gaps between stamps of less than half a revolution.
        gaps: number of such gaps.
        lost_s: their total duration.
        pauses: number of longer gaps.
        paused_s: their total duration.
        repeated: packets skipped because they repeat the one before.
        late: packets with a stamp earlier than the one before.
        bad_blocks: blocks skipped because their mark is wrong.
        revolutions: revolutions of azimuth within packets, summed.
        turning_s: duration of those.
        host_first_s: recorder's time minus the stamps' time, median of the first batch.
        host_last_s: the same of the last batch.
        host_least_s: its minimum over all packets.
        host_most_s: its maximum over all packets.
    """

    packets: int = 0
    points: int = 0
    whole: int = 0
    cut: int = 0
    modes: Counter[int] = field(default_factory=Counter)
    products: Counter[int] = field(default_factory=Counter)
    first_s: float = float("nan")
    last_s: float = float("nan")
    usual_s: float = float("nan")
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
    revolutions: float = 0.0
    turning_s: float = 0.0
    host_first_s: float = float("nan")
    host_last_s: float = float("nan")
    host_least_s: float = float("inf")
    host_most_s: float = float("-inf")

    @property
    def rpm(self) -> float:
        """Revolutions per minute; nan without rotation."""
        return 60.0 * self.revolutions / self.turning_s if self.turning_s else float("nan")

    @property
    def mode(self) -> int:
        """The return mode byte of most packets."""
        return self.modes.most_common(1)[0][0]

    def note_times(self, t_s: FloatArray, host_s: FloatArray, model: Model) -> None:
        """Count gaps and disorder in the UTC `t_s` (m,) of packets; compare it with the recorder's times `host_s`."""
        self.packets += len(t_s)
        step_s = np.diff(t_s, prepend=self.last_s)
        if np.isnan(self.usual_s) and len(step_s) >= 20:
            self.usual_s = float(np.median(step_s[1:]))
        if np.isnan(self.first_s):
            self.first_s = float(t_s[0])
        self.last_s = float(t_s[-1])
        self.late += int((step_s < 0.0).sum())

        packet_s = self.usual_s if self._contradicts(model) else model.packet_s(self.mode)
        half_turn_s = 0.5 * self.turning_s / self.revolutions if self.revolutions > 0.0 else 0.05
        missing_s = step_s[(step_s > 1.5 * packet_s) & (step_s <= half_turn_s)]
        self.gaps += len(missing_s)
        self.lost += int(np.round(missing_s / packet_s - 1.0).sum())
        self.lost_s += float((missing_s - packet_s).sum())
        pauses_s = step_s[step_s > half_turn_s]
        self.pauses += len(pauses_s)
        self.shortest_pause_s = float(np.min(pauses_s, initial=self.shortest_pause_s))
        self.longest_pause_s = float(np.max(pauses_s, initial=self.longest_pause_s))
        self.paused_s += float((pauses_s - packet_s).sum())

        ahead_s = host_s - t_s
        self.host_last_s = float(np.median(ahead_s))
        if np.isnan(self.host_first_s):
            self.host_first_s = self.host_last_s
        self.host_least_s = min(self.host_least_s, float(ahead_s.min()))
        self.host_most_s = max(self.host_most_s, float(ahead_s.max()))

    def notices(self, model: Model, *, stated: bool) -> list[Notice]:
        """What is unusual.

        Args:
            stated: whether the session states it, rather than the packets.
        """
        notices = []
        others = {product: n for product, n in self.products.items() if product != model.product}
        if others:
            names = OTHER_PRODUCTS | {m.product: m.name for m in MODELS}
            words = ", ".join(f"{names.get(p, 'unknown')} (0x{p:02x}) in {n:,} packets" for p, n in others.items())
            notices.append(Notice("model-differs", model=model.name, stated=bool(stated), words=words))
        if self._contradicts(model):
            fits = [
                f"{m.name} ({word})"
                for m in MODELS
                for byte, word in ((STRONGEST, "one return"), (DUAL, "dual"))
                if abs(self.usual_s - m.packet_s(byte)) <= _RATE_TOLERANCE * m.packet_s(byte)
            ]
            notices.append(
                Notice(
                    "packet-rate",
                    usual_s=1e3 * self.usual_s,
                    model=model.name,
                    is_mode=self.mode == DUAL,
                    mode=1e3 * model.packet_s(self.mode),
                    fits=" or ".join(fits) or "no known model",
                )
            )
        if len(self.modes) > 1:
            words = ", ".join(
                f"{RETURN_WORDS.get(mode, f'0x{mode:02x}')} in {n:,} packets" for mode, n in self.modes.most_common()
            )
            notices.append(Notice("return-mode-changed", words=words))
        elif self.mode not in RETURN_WORDS:
            notices.append(Notice("return-mode-unknown", mode=self.mode))
        if self.gaps:
            notices.append(
                Notice(
                    "lost-packets",
                    lost=self.lost,
                    gaps=self.gaps,
                    lost_s=self.lost_s,
                    lost_share=100 * self.lost / (self.lost + self.packets),
                )
            )
        if self.pauses:
            ends = [f"{end_s:,.3f}" for end_s in (self.shortest_pause_s, self.longest_pause_s)]
            notices.append(
                Notice(
                    "pauses",
                    pauses=self.pauses,
                    shortest_pause_s=" to ".join(dict.fromkeys(ends)),
                    paused_s=self.paused_s,
                )
            )
        if self.repeated:
            notices.append(Notice("repeated-packets", repeated=self.repeated))
        if self.late:
            notices.append(Notice("late-packets", late=self.late))
        if self.bad_blocks:
            notices.append(Notice("bad-blocks", bad_blocks=self.bad_blocks))
        return notices

    def _contradicts(self, model: Model) -> bool:
        """Whether the packet rate differs from that of the model."""
        return abs(self.usual_s - model.packet_s(self.mode)) > _RATE_TOLERANCE * model.packet_s(self.mode)
