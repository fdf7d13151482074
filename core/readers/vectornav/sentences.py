"""ASCII sentences of VectorNav sensors: ``$VNIMU,…*XX`` with a checksum of 8 or 16 bits.

Sentences of measurements have no time of their own. It is what a logger wrote before them, or follows from sentences
between them that have GPS time (`VNINS`, `VNGPS`).
"""

from __future__ import annotations

import datetime as dt
import re
from binascii import crc_hqx
from dataclasses import dataclass, field
from functools import reduce
from operator import xor
from typing import Final

import numpy as np

from furrowmap.core.readers.messages import MESSAGE_CHUNK_BYTES, MessageCounts
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.clock import WEEK_S

_VN_SENTENCE: Final = re.compile(rb"([^$\r\n]{0,64})\$(VN[A-Z]{3}),([^*$\r\n]{1,400})\*([0-9A-Fa-fX]{2,4})")
MEASURED_FIELDS: Final = {b"VNIMU": (6, 3, 11), b"VNYMR": (9, 6, 12), b"VNMAR": (6, 3, 9)}
"""First fields of angular rate and specific force, and the number of fields."""
TIMED_FIELDS: Final = {b"VNINS": 15, b"VNGPS": 15}
"""Sentences whose first two fields are GPS seconds of the week and week, and the number of fields at least."""
STAMPS_S: Final = (6.0e8, 5.0e9)
"""Numbers before a sentence that are smaller or larger are no seconds of UTC."""


@dataclass
class AsciiSentences:
    """Sentences of a log in their order.

    Attributes:
        rows: fields 0 to 2 time before the sentence (UTC, else nan), GPS time (else nan), number of the line; then
            angular rate and specific force (else nan), and yaw, pitch, roll (else nan).
        counts: those with fields that are no numbers count as bad, too.
    """

    rows: list[tuple[float, ...]] = field(default_factory=list)
    counts: MessageCounts[str] = field(default_factory=MessageCounts)

    def scan(self, data: bytes, base: int = 0, last: bool = True) -> int:  # noqa: ARG002
        """Find the sentences in a piece of a stream; see :func:`~furrowmap.core.readers.messages.scan_stream`."""
        end = len(data) if last or len(data) >= 2 * MESSAGE_CHUNK_BYTES else data.rfind(b"\n") + 1
        for before, kind, body, checksum in _VN_SENTENCE.findall(data[:end]):
            values = _fields(kind, body, checksum)
            if values is None:
                self.counts.bad += 1
                continue
            self.counts.kinds[kind.decode()] += 1
            measured: tuple[float, ...] = (np.nan,) * 6
            angles: tuple[float, ...] = (np.nan,) * 3
            gps_s = np.nan
            if kind in MEASURED_FIELDS and len(values) >= MEASURED_FIELDS[kind][2]:
                rate, force, _ = MEASURED_FIELDS[kind]
                measured = (*values[rate : rate + 3], *values[force : force + 3])
            if kind in (b"VNYMR", b"VNYPR") and len(values) >= 3:
                angles = (values[0], values[1], values[2])
            if kind in TIMED_FIELDS and len(values) >= TIMED_FIELDS[kind] and values[1] > 0:
                gps_s = WEEK_S * values[1] + values[0]
            self.rows.append((_stamp_s(before), gps_s, float(len(self.rows)), *measured, *angles))
        return end

    def table(self) -> FloatArray:
        """(n, 12) the rows."""
        return np.array(self.rows, np.float64).reshape(-1, 12)


def _fields(kind: bytes, body: bytes, checksum: bytes) -> list[float] | None:
    """The numbers of a sentence; None if it is damaged. A checksum of XX was switched off."""
    text = kind + b"," + body
    if b"X" not in checksum.upper():
        right = reduce(xor, text) if len(checksum) == 2 else crc_hqx(text, 0)
        if len(checksum) == 3 or int(checksum, 16) != right:
            return None
    try:
        # The status of VNINS is hexadecimal.
        values = [float(part) if k != 2 or kind not in TIMED_FIELDS else 0.0 for k, part in enumerate(body.split(b","))]
    except ValueError:
        return None
    return values if all(np.isfinite(values)) else None


def _stamp_s(before: bytes) -> float:
    """UTC that a logger wrote before a sentence: seconds or milliseconds since 1970, or ISO 8601; else nan."""
    text = before.decode("latin-1").strip(" \t,;:[]\"'")
    try:
        number = float(text)
    except ValueError:
        try:
            stamp = dt.datetime.fromisoformat(text)
        except ValueError:
            return float("nan")
        return (stamp if stamp.tzinfo else stamp.replace(tzinfo=dt.UTC)).timestamp()
    if number > 1e3 * STAMPS_S[0]:
        number *= 1e-3
    return number if STAMPS_S[0] < number < STAMPS_S[1] else float("nan")
