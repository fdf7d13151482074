"""NMEA 0183 sentences in a stream of bytes, among whatever else.

A sentence is ``$``, its address and fields, ``*`` and two hexadecimal digits: the exclusive or of all characters
between ``$`` and ``*`` (NMEA 0183, section 5.3). The scanner tries every ``$`` and does not split lines, because noise,
binary messages and truncated sentences may directly precede intact ones. Before version 3.0 the checksum was optional:
in a log without any, a sentence ends with its line.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.column_names import FOOT_M
from furrowmap.core.readers.framed_messages import MessageCounts, scan_stream
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.kernels import kernel

LEAST_UNCHECKED: Final = 2
"""Sentences without a checksum that a log has at least, if it is one without any."""
MAX_SENTENCE_BYTES: Final = 512
"""Maximum distance in bytes from ``$`` to ``*``; the standard allows 82, proprietary sentences are longer."""

KNOT_MPS: Final = 1852.0 / 3600.0


class Kind(IntEnum):
    """The sentences that are read; see :data:`FIELDS`."""

    GGA = 0
    RMC = 1
    GST = 2
    VTG = 3
    HDT = 4
    ZDA = 5
    GNS = 6
    PUBX = 7
    PUBX_MOTION = 8
    PASHR = 9


FIELDS: Final[dict[Kind, tuple[str, ...]]] = {
    Kind.GGA: ("tod_s", "lat_deg", "lon_deg", "altitude_m", "separation_m", "quality", "satellites", "hdop", "age_s"),
    Kind.RMC: ("tod_s", "date_ymd", "valid", "speed_mps", "course_deg"),
    Kind.GST: ("tod_s", "sigma_n_m", "sigma_e_m", "sigma_h_m"),
    Kind.VTG: ("", "speed_mps", "course_deg"),
    Kind.HDT: ("", "heading_deg"),
    Kind.ZDA: ("tod_s", "date_ymd"),
    Kind.GNS: ("tod_s", "lat_deg", "lon_deg", "altitude_m", "separation_m", "quality", "satellites", "hdop", "age_s"),
    Kind.PUBX: ("tod_s", "lat_deg", "lon_deg", "altitude_m", "separation_m", "quality", "satellites", "hdop", "age_s"),
    Kind.PUBX_MOTION: ("tod_s", "sigma_n_m", "sigma_e_m", "sigma_h_m", "speed_mps", "course_deg"),
    Kind.PASHR: ("tod_s", "heading_deg", "roll_deg", "pitch_deg"),
}
"""Names of the columns of :attr:`Sentences.values`. ``tod_s``: UTC seconds of the day; ``date_ymd``: UTC date as the
number yyyymmdd; ``valid``: 1 if the receiver marks its data as valid; ``quality``: code of GGA, of GNS the best of its
constellations. THS is read as HDT. u-blox's ``PUBX,00`` is read as both of its kinds: its height is above the
ellipsoid, and its horizontal accuracy is shared equally by north and east. ``PUBX,04`` is read as ZDA."""

COLUMNS: Final = max(len(names) for names in FIELDS.values())


@dataclass(frozen=True)
class Sentences:
    """Intact sentences in the order of the stream.

    Attributes:
        kind: (n,) int8, values of :class:`Kind`.
        talker: (n,) bytes of length 2, such as ``b"GN"``.
        at: (n,) int64, offset of the ``$`` in the stream, plus the length of all streams before.
        values: (n, COLUMNS) float64, columns as in :data:`FIELDS`, nan where a field is empty or malformed.
    """

    kind: NDArray[np.int8]
    talker: NDArray[np.bytes_]
    at: NDArray[np.int64]
    values: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.at)

    @property
    def nbytes(self) -> int:
        """Memory of the columns."""
        return self.kind.nbytes + self.talker.nbytes + self.at.nbytes + self.values.nbytes

    def __getitem__(self, index: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        """Some of the sentences; these themselves if a mask leaves none out."""
        if not isinstance(index, slice) and index.dtype == np.bool_ and index.all():
            return self
        return type(self)(self.kind[index], self.talker[index], self.at[index], self.values[index])

    def of_kind(self, kind: Kind) -> Self:
        """The sentences of one kind."""
        return self[self.kind == kind]

    def column(self, kind: Kind, name: str) -> NDArray[np.float64]:
        """The column `name` of sentences that are all of `kind`."""
        return self.values[:, FIELDS[kind].index(name)]

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """The sentences of several parts, one after the other; a single part itself."""
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return cls(np.empty(0, np.int8), np.empty(0, "S2"), np.empty(0, np.int64), np.empty((0, COLUMNS)))
        return cls(
            np.concatenate([p.kind for p in parts]),
            np.concatenate([p.talker for p in parts]),
            np.concatenate([p.at for p in parts]),
            np.concatenate([p.values for p in parts]),
        )


@dataclass
class SentenceCounts(MessageCounts[str]):
    """Counts over a stream of sentences; their kind is the address, such as ``GNGGA`` or ``PSTI``.

    `behind_cut` counts intact sentences that begin where a truncated one ends, in the middle of a line.
    """

    behind_cut: int = 0


def are_unchecked(data: bytes) -> bool:
    """Whether the sentences of a log that begins with `data` have no checksums: not one of them."""
    strict = SentenceCounts()
    scan_bytes(data, strict)
    if strict.intact or strict.bad or not strict.cut:
        return False
    lenient = SentenceCounts()
    found, _ = scan_bytes(data, lenient, unchecked=True)
    return len(found) >= LEAST_UNCHECKED


def read_sentences(source: Source, counts: SentenceCounts, *, unchecked: bool = False) -> list[Sentences]:
    """The sentences of a stream from its current position, piece by piece.

    `counts` are updated; the length of streams before is added to :attr:`Sentences.at`. See :func:`are_unchecked`.
    """
    found = []

    def scan(piece: bytes, base: int, last: bool) -> int:
        sentences, used = scan_bytes(piece, counts, base, last=last, unchecked=unchecked)
        found.append(sentences)
        counts.row_bytes += sentences.nbytes
        return used

    scan_stream(source, counts, scan)
    return found


def scan_bytes(
    data: bytes, counts: SentenceCounts, base: int = 0, *, last: bool = True, unchecked: bool = False
) -> tuple[Sentences, int]:
    """The sentences in `data`, and the number of bytes that are done with.

    `counts` are updated, but for `stream_bytes`. If the piece is not the last, an unfinished sentence at its end is
    left for the next one. Where they are `unchecked`, sentences without a checksum count as intact.
    """
    room = min(data.count(b"$"), len(data) // _SHORTEST_BYTES + 1) + data.count(b"$PUBX,00,")
    kind = np.empty(room, np.int8)
    talker = np.empty((room, 2), np.uint8)
    at = np.empty(room, np.int64)
    values = np.empty((room, COLUMNS))
    address = np.zeros((room, 8), np.uint8)
    sums = np.zeros(4, np.int64)
    rows, sentences, used = _scan(
        np.frombuffer(data, np.uint8), last, unchecked, kind, talker, at, values, address, sums
    )
    names, times = np.unique(address[:sentences].view("S8"), return_counts=True)
    counts.kinds.update({bytes(n).decode("ascii"): int(c) for n, c in zip(names, times, strict=True)})
    counts.bad += int(sums[_BAD])
    counts.cut += int(sums[_CUT])
    counts.behind_cut += int(sums[_BEHIND])
    counts.message_bytes += int(sums[_BYTES])
    # Copies: of a piece of noise there is room for far more.
    found = Sentences(
        kind[:rows].copy(), talker[:rows].copy().view("S2").ravel(), at[:rows] + base, values[:rows].copy()
    )
    return found, used


_BAD, _CUT, _BEHIND, _BYTES = range(4)
_GGA, _RMC, _GST, _VTG, _HDT, _ZDA, _GNS, _PUBX, _PUBX_MOTION, _PASHR = (int(kind) for kind in Kind)
_MOST_FIELDS: Final = 19
_SHORTEST_BYTES: Final = 4
"""Of an intact sentence: dollar, star, checksum."""
_TENS: Final = 10.0 ** np.arange(19)

_DOLLAR, _STAR, _COMMA, _DOT, _MINUS, _PLUS = (np.int64(ord(c)) for c in "$*,.-+")
_0, _4, _9, _A, _B, _C, _D, _E, _F, _G = (np.int64(ord(c)) for c in "049ABCDEFG")
_H, _K, _M, _N, _P, _R, _S, _T, _U, _V, _W, _X, _Z = (np.int64(ord(c)) for c in "HKMNPRSTUVWXZ")
_MODES: Final = np.frombuffer(b"SMEADPFR", np.uint8)
"""Mode indicators of GNS, the best last; N is no position."""
_QUALITIES: Final = np.array([8.0, 7.0, 6.0, 1.0, 2.0, 3.0, 5.0, 4.0])
"""The quality that GGA gives each of them."""
_FIELD_1: Final = np.int64(1)
_FIELD_8: Final = np.int64(8)
_ADDRESSES: Final = np.frombuffer(b"GGARMCGSTVTGHDTZDAGNS", np.uint8).reshape(-1, 3)
_NUMBERS: Final = np.full((len(Kind), COLUMNS), -1)
"""The field of the number in each column; -1 where it is not a number, or calculated."""
for _kind, _columns, _fields in (
    (Kind.GGA, [3, 4, 5, 6, 7, 8], [8, 10, 5, 6, 7, 12]),
    (Kind.RMC, [3, 4], [6, 7]),
    (Kind.GST, [1, 2, 3], [5, 6, 7]),
    (Kind.VTG, [1, 2], [4, 0]),
    (Kind.HDT, [1], [0]),
    (Kind.GNS, [3, 4, 6, 7, 8], [8, 9, 6, 7, 10]),
    (Kind.PUBX, [3, 6, 7, 8], [5, 16, 13, 12]),
    (Kind.PUBX_MOTION, [1, 3, 4, 5], [7, 8, 9, 10]),
    (Kind.PASHR, [1, 2, 3], [1, 3, 4]),
):
    _NUMBERS[_kind, _columns] = _fields
_SMALL_A: Final = np.int64(ord("a"))
_SMALL_F: Final = np.int64(ord("f"))


@kernel()
def _scan(
    data: Any, last: Any, unchecked: Any, kind: Any, talker: Any, at: Any, values: Any, address: Any, counts: Any
) -> tuple[np.int64, int, int | np.int64]:
    """Fill the arrays; number of rows of known kinds, of intact sentences, and of bytes done with."""
    size = len(data)
    begin = np.empty(_MOST_FIELDS + 1, np.int64)
    rows = i = np.int64(0)  # of one type from the start: _take would be compiled for a literal 0 as well
    sentences = 0
    broken_off = np.int64(-1)
    while i < size:
        if data[i] != _DOLLAR:
            i += 1
            continue
        end = i + 1
        checksum = 0
        while end < size and end - i < MAX_SENTENCE_BYTES:
            c = data[end]
            if c < 32 or c > 126 or c in (_STAR, _DOLLAR):
                break
            checksum ^= c
            end += 1
        if not last and (end == size or (data[end] == _STAR and end + 2 >= size)):
            return rows, sentences, i
        if end < size and data[end] == _STAR:
            high = _hex(data[end + 1]) if end + 1 < size else -1
            low = _hex(data[end + 2]) if end + 2 < size else -1
            if high >= 0 and low >= 0:
                counts[_BYTES] += end + 3 - i + _line_end(data, end + 3)
                if 16 * high + low == checksum:
                    _take_address(data, i + 1, end, address[sentences])
                    sentences += 1
                    counts[_BEHIND] += broken_off == i
                    rows += _take(data, i, end, begin, kind, talker, at, values, rows)
                else:
                    counts[_BAD] += 1
                i = end + 3
                continue
            end += 1 if high < 0 else 2
            stopped = end >= size or data[end] < 32 or data[end] > 126 or data[end] == _DOLLAR
        else:
            stopped = True
        if unchecked and _line_end(data, end) > 0 and _is_address(data, i + 1, end):
            counts[_BYTES] += end - i + _line_end(data, end)
            _take_address(data, i + 1, end, address[sentences])
            sentences += 1
            rows += _take(data, i, end, begin, kind, talker, at, values, rows)
            i = end
            continue
        if _is_address(data, i + 1, end):
            counts[_CUT if stopped else _BAD] += 1
            counts[_BYTES] += end - i + _line_end(data, end)
            broken_off = end
        i = end
    return rows, sentences, size


@kernel()
def _take(data: Any, i: int, end: int, begin: Any, kind: Any, talker: Any, at: Any, values: Any, row: int) -> int:
    """Read the sentence at `i` into `row` if it is of a known kind; number of rows (0, 1, or 2 of PUBX,00)."""
    if i + 7 > end:
        return 0
    a = data[i + 3]
    b = data[i + 4]
    c = data[i + 5]
    is_pubx = data[i + 1] == _P and data[i + 2] == _U and a == _B and b == _X and c == _COMMA
    is_pubx = is_pubx and i + 9 <= end and data[i + 8] == _COMMA
    is_pashr = data[i + 1] == _P and data[i + 2] == _A and a == _S and b == _H and c == _R
    if data[i + 6] != _COMMA and not is_pubx:
        return 0
    if data[i + 1] == _P and not is_pubx and not is_pashr:
        return 0
    begin[0] = i + 9 if is_pubx else i + 7
    fields = 1
    for k in range(begin[0], end):
        if data[k] == _COMMA and fields < _MOST_FIELDS:
            begin[fields] = k + 1
            fields += 1
    for k in range(fields, _MOST_FIELDS + 1):
        begin[k] = end + 1
    known = -1
    for k in range(len(_ADDRESSES)):
        if a == _ADDRESSES[k, 0] and b == _ADDRESSES[k, 1] and c == _ADDRESSES[k, 2]:
            known = k
    if a == _T and b == _H and c == _S:
        known = _HDT
    elif is_pashr:
        known = _PASHR
    elif is_pubx and data[i + 6] == _0:
        known = _ZDA if data[i + 7] == _4 else _PUBX if data[i + 7] == _0 else -1
    if known < 0:
        return 0
    rows = 2 if known == _PUBX else 1
    for k in range(row, row + rows):
        kind[k] = known if k == row else _PUBX_MOTION
        talker[k, 0] = data[i + 1]
        talker[k, 1] = data[i + 2]
        at[k] = i
        for column in range(values.shape[1]):
            field = _NUMBERS[kind[k], column]
            values[k, column] = _number(data, begin[field], begin[field + 1] - 1) if field >= 0 else np.nan
    out = values[row]
    if known != _VTG and known != _HDT:
        out[0] = _time_of_day(data, begin, 0)
    if known in (_GGA, _GNS, _PUBX):
        for k in range(2):
            out[1 + k] = _angle(data, begin, 1 + 2 * k, _E if k else _N, _W if k else _S)
    if known == _GGA:
        for k in range(2):  # altitude and separation, whose units stand behind them
            if begin[9 + 2 * k] < end and data[begin[9 + 2 * k]] in (_F, _SMALL_F):
                out[3 + k] *= FOOT_M
    if known == _GNS:
        out[5] = _best_mode(data, begin[5], begin[6] - 1)
    elif known == _RMC:
        out[1] = _date(data, begin, _FIELD_8)
        out[2] = 1.0 if begin[2] - 1 > begin[1] and data[begin[1]] == _A else 0.0
        out[3] *= KNOT_MPS
    elif known == _VTG:
        kmh = _number(data, begin[6], begin[7] - 1)
        out[1] = kmh / 3.6 if np.isnan(out[1]) else out[1] * KNOT_MPS
    elif known == _HDT and a == _T and (begin[2] - 1 <= begin[1] or data[begin[1]] == _V):
        out[1] = np.nan
    elif known == _ZDA and is_pubx:
        out[1] = _date(data, begin, _FIELD_1)
    elif known == _ZDA:
        out[1] = 0.0
        for k in range(3, 0, -1):
            out[1] = 100.0 * out[1] + _number(data, begin[k], begin[k + 1] - 1)
    elif is_pashr:
        # time, heading, T, roll, pitch, heave, three accuracies, quality of the position, state of the inertial system
        bad = data[begin[10]] == _0 and begin[11] - 1 != begin[10]
        if bad or data[begin[2]] != _T:
            out[1] = np.nan
        if bad:
            out[2] = out[3] = np.nan
    elif known == _PUBX:
        out[4] = 0.0
        out[5] = _state_quality(data, begin[6], begin[7] - 1)
        motion = values[row + 1]
        motion[0] = out[0]
        motion[1] /= np.sqrt(2.0)
        motion[2] = motion[1]
        motion[4] /= 3.6
    return rows


@kernel()
def _number(data: Any, begin: int, end: int) -> Any:
    """The decimal number in ``data[begin:end]``, correctly rounded up to 15 digits; nan if it is invalid."""
    i = begin
    sign = 1.0
    if i < end and (data[i] == _MINUS or data[i] == _PLUS):
        sign = -1.0 if data[i] == _MINUS else 1.0
        i += 1
    mantissa = 0
    digits = 0
    decimals = -1
    while i < end:
        c = data[i]
        if c == _DOT and decimals < 0:
            decimals = 0
        elif _0 <= c <= _9 and digits < 18:
            mantissa = 10 * mantissa + (c - _0)
            digits += 1
            if decimals >= 0:
                decimals += 1
        else:
            return np.nan
        i += 1
    if digits == 0:
        return np.nan
    return sign * (mantissa / _TENS[max(decimals, 0)])


@kernel()
def _date(data: Any, begin: Any, k: int) -> Any:
    """The number yyyymmdd of the date in field `k`, written ddmmyy, of the years 1980 to 2079; nan if it is invalid."""
    date = _number(data, begin[k], begin[k + 1] - 1)
    year = date % 100.0
    return (year + (1900.0 if year >= 80.0 else 2000.0)) * 10000.0 + (date // 100.0) % 100.0 * 100.0 + date // 10000.0


@kernel()
def _time_of_day(data: Any, begin: Any, k: int) -> Any:
    """Seconds of the day in field `k`, written hhmmss.sss, to the microsecond; nan if it is invalid."""
    value = _number(data, begin[k], begin[k + 1] - 1)
    if begin[k] + 6 > begin[k + 1] - 1 or np.isnan(value) or value < 0.0:
        return np.nan
    hours = value // 10000.0
    minutes = value // 100.0 - 100.0 * hours
    seconds = value - 10000.0 * hours - 100.0 * minutes
    if hours >= 24.0 or minutes >= 60.0 or seconds >= 61.0:
        return np.nan
    return np.rint((3600.0 * hours + 60.0 * minutes + seconds) * 1e6) / 1e6


@kernel()
def _angle(data: Any, begin: Any, k: int, positive: int, negative: int) -> Any:
    """Degrees in field `k`, written dddmm.mmm, with the hemisphere in the next field; nan if it is invalid."""
    value = _number(data, begin[k], begin[k + 1] - 1)
    degrees = value // 100.0
    minutes = value - 100.0 * degrees
    angle = degrees + minutes / 60.0
    if np.isnan(value) or value < 0.0 or minutes >= 60.0 or begin[k + 2] - 1 != begin[k + 1] + 1:
        return np.nan
    side = data[begin[k + 1]]
    if side == positive:
        return angle
    return -angle if side == negative else np.nan


@kernel()
def _best_mode(data: Any, begin: int, end: int) -> Any:
    """Quality of a position whose constellations have the modes in ``data[begin:end]``; 0 if none has a position."""
    best = -1
    for i in range(begin, end):
        for k in range(best + 1, len(_MODES)):
            if data[i] == _MODES[k]:
                best = k
    return _QUALITIES[best] if best >= 0 else 0.0


@kernel()
def _state_quality(data: Any, begin: int, end: int) -> Any:
    """The quality that GGA gives a navigation status of PUBX,00: G2, G3, D2, D3, RK (with dead reckoning), DR."""
    if end - begin != 2:
        return 0.0
    a = data[begin]
    b = data[begin + 1]
    if a == _D and b == _R:
        return 6.0
    if (a == _G and b != _R) or (a == _R and b == _K):
        return 1.0
    return 2.0 if a == _D else 0.0


@kernel()
def _hex(c: int) -> int | np.int64:
    """Value of a hexadecimal digit; −1 if it is not one."""
    if _0 <= c <= _9:
        return c - _0
    if _A <= c <= _F:
        return c - _A + 10
    if _SMALL_A <= c <= _SMALL_F:
        return c - _SMALL_A + 10
    return -1


@kernel()
def _line_end(data: Any, i: int) -> int:
    """Number of line-end characters at `i`, at most 2."""
    n = 0
    while n < 2 and i + n < len(data) and (data[i + n] == 13 or data[i + n] == 10):
        n += 1
    return n


@kernel()
def _is_address(data: Any, begin: int, end: int) -> bool:
    """Whether there are three to eight capital letters or digits before a comma or the end."""
    i = begin
    while i < end and (65 <= data[i] <= 90 or _0 <= data[i] <= _9):
        i += 1
    return 3 <= i - begin <= 8 and (i == end or data[i] == _COMMA)


@kernel()
def _take_address(data: Any, begin: int, end: int, out: Any) -> None:
    """The first eight characters before the comma."""
    for k in range(min(8, end - begin)):
        if data[begin + k] == _COMMA:
            return
        out[k] = data[begin + k]
