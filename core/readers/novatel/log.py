"""Logs of NovAtel's OEM receivers and Unicore's: positions, and the trajectory of an inertial system (SPAN).

An ASCII message is ``#`` and its name with an A, header, ``;`` and fields, ``*`` and a CRC of 8 hexadecimal digits; one
with a short header begins with ``%``. A binary message is AA 44 12, header, content and CRC; with a short header it
begins with AA 44 13, one of Unicore with AA 44 B5. The CRC-32 has the polynomial EDB88320 hexadecimal (reflected),
initial value 0 and no final inversion, over all behind ``#`` or from AA on (NovAtel, OEM7 commands and logs reference
manual, "Message formats"; Unicore, N4 high precision products commands and logs reference).
"""

import re
import struct
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.framed_messages import MessageCounts, Messages, at_equal, count_foreign, layout, scan_stream
from furrowmap.core.readers.poses.pose_file import RawPoses, pose_facts
from furrowmap.core.readers.position_log import (
    MIN_INTACT_SHARE,
    LoggedPositions,
    PositionLog,
    byte_place,
    damage_notices,
    dated_positions,
    has_position,
    log_facts,
)
from furrowmap.core.readers.reader import Inspection, recording_name
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.pose_track import PoseTrack

MAX_CONTENT_BYTES: Final = 16384
"""Largest content of a binary message; observations of all satellites have half of it."""
MAX_TEXT_BYTES: Final = 32768
_LONG_HEADER: Final = 28
_SHORT_HEADER: Final = 12
_UNICORE_HEADER: Final = 24
_CRC_BYTES: Final = 4
_SHORT_SYNC: Final = 0x13
_UNICORE_SYNC: Final = 0xB5
"""Third bytes of binary messages with other headers than the long one."""
_COARSE: Final = 100
"""Time status from which the receiver knows the time to 10 ms or better."""
_OLDEST_WEEK: Final = 520
"""Of Unicore's binary messages: their receivers count from 0 or 1 until they know the week."""
_TIME_UNKNOWN: Final = frozenset((b"UNKNOWN", b"APPROXIMATE", b"COARSEADJUSTING"))
_BEIDOU_WEEK: Final = 1356
_BEIDOU_MS: Final = 14_000
"""BeiDou time 0 as GPS time."""

SOL_COMPUTED: Final = 0
STATUS_NUMBERS: Final = {"SOL_COMPUTED": 0, "INS_HIGH_VARIANCE": 2, "INS_SOLUTION_GOOD": 3, "INS_SOLUTION_FREE": 6,
                         "INS_ALIGNMENT_COMPLETE": 7}  # fmt: skip
"""Numbers in binary messages of the statuses with a solution; all others have none."""
KIND_NUMBERS: Final = {
    "NONE": 0, "FIXEDPOS": 1, "FIXEDHEIGHT": 2, "DOPPLER_VELOCITY": 8, "SINGLE": 16, "PSRDIFF": 17, "WAAS": 18,
    "SBAS": 18, "PROPAGATED": 19, "L1_FLOAT": 32, "IONOFREE_FLOAT": 33, "NARROW_FLOAT": 34, "L1_INT": 48,
    "WIDE_INT": 49, "NARROW_INT": 50, "RTK_DIRECT_INS": 51, "INS": 52, "INS_SBAS": 52, "INS_PSRSP": 53,
    "INS_PSRDIFF": 54, "INS_RTKFLOAT": 55, "INS_RTKFIXED": 56, "PPP_CONVERGING": 68, "PPP": 69, "OPERATIONAL": 70,
    "WARNING": 71, "OUT_OF_BOUNDS": 72, "INS_PPP_CONVERGING": 73, "INS_PPP": 74, "PPP_BASIC_CONVERGING": 77,
    "PPP_BASIC": 78, "INS_PPP_BASIC_CONVERGING": 79, "INS_PPP_BASIC": 80,
}  # fmt: skip
"""Numbers in binary messages of the types of position."""
UNKNOWN_WORD: Final = 255
_WORD_NUMBERS: Final = {word.encode(): n for word, n in (STATUS_NUMBERS | KIND_NUMBERS).items()}


_WORD_FIELDS: Final = frozenset(("status", "kind", "velocity_status", "heading_kind"))
"""Fields with a word in ASCII and its number in binary messages; all others are numbers."""


class _Layout(NamedTuple):
    """Where a message has its fields: as commas before them in ASCII, and as a record in the binary content."""

    commas: dict[str, int]
    record: np.dtype[np.void]

    @property
    def read(self) -> np.dtype[np.void]:
        """The fields as they are read, with the time of the header: GPS milliseconds since 1980, −1 if unknown."""
        return np.dtype([("gps_ms", "i8"), *((name, "u4" if name in _WORD_FIELDS else "f8") for name in self.commas)])


def _layout(size: int, **fields: tuple[int, int, str]) -> _Layout:
    """A message whose binary content has at least `size` bytes: ``name=(commas before it, offset, format)``."""
    record = layout(size, **{name: (offset, kind) for name, (_, offset, kind) in fields.items()})
    return _Layout({name: commas for name, (commas, _, _) in fields.items()}, record)


_ANTENNAS: Final = {"status": (0, 0, "u4"), "kind": (1, 4, "u4"), "heading": (3, 12, "f4")}
_INSPVA: Final = _layout(
    88, lat=(2, 12, "f8"), lon=(3, 20, "f8"), height=(4, 28, "f8"), vn=(5, 36, "f8"), ve=(6, 44, "f8"),
    roll=(8, 60, "f8"), pitch=(9, 68, "f8"), azimuth=(10, 76, "f8"), status=(11, 84, "u4"),
)  # fmt: skip
LAYOUTS: Final = {
    "BESTPOS": _layout(
        72, status=(0, 0, "u4"), kind=(1, 4, "u4"), lat=(2, 8, "f8"), lon=(3, 16, "f8"), height=(4, 24, "f8"),
        undulation=(5, 32, "f4"), sigma_n=(7, 40, "f4"), sigma_e=(8, 44, "f4"), sigma_h=(9, 48, "f4"),
        age=(11, 56, "f4"), satellites=(14, 65, "u1"),
    ),
    "BESTVEL": _layout(
        44, status=(0, 0, "u4"), kind=(1, 4, "u4"), speed=(4, 16, "f8"), course=(5, 24, "f8"),
    ),
    "HEADING": _layout(44, **_ANTENNAS),
    "HEADING2": _layout(48, **_ANTENNAS),
    "INSPVA": _INSPVA,
    "INSPVAS": _INSPVA,
    "INSPVAX": _layout(
        126, status=(0, 0, "u4"), kind=(1, 4, "u4"), lat=(2, 8, "f8"), lon=(3, 16, "f8"), height=(4, 24, "f8"),
        undulation=(5, 32, "f4"), vn=(6, 36, "f8"), ve=(7, 44, "f8"), roll=(9, 60, "f8"), pitch=(10, 68, "f8"),
        azimuth=(11, 76, "f8"), sigma_n=(12, 84, "f4"), sigma_e=(13, 88, "f4"), sigma_h=(14, 92, "f4"),
        sigma_roll=(18, 108, "f4"), sigma_pitch=(19, 112, "f4"), sigma_azimuth=(20, 116, "f4"),
    ),
    "BESTNAV": _layout(
        120, status=(0, 0, "u4"), kind=(1, 4, "u4"), lat=(2, 8, "f8"), lon=(3, 16, "f8"), height=(4, 24, "f8"),
        undulation=(5, 32, "f4"), sigma_n=(7, 40, "f4"), sigma_e=(8, 44, "f4"), sigma_h=(9, 48, "f4"),
        age=(11, 56, "f4"), satellites=(14, 65, "u1"), velocity_status=(21, 72, "u4"), speed=(25, 88, "f8"),
        course=(26, 96, "f8"),
    ),
    "PVTSLN": _layout(
        112, kind=(0, 0, "u4"), height=(1, 4, "f4"), lat=(2, 8, "f8"), lon=(3, 16, "f8"), sigma_h=(4, 24, "f4"),
        sigma_n=(5, 28, "f4"), sigma_e=(6, 32, "f4"), age=(7, 36, "f4"), undulation=(12, 64, "f4"),
        satellites=(14, 69, "u1"), vn=(17, 72, "f8"), ve=(18, 80, "f8"), heading_kind=(20, 96, "u4"),
        heading=(22, 104, "f4"),
    ),
    "UNIHEADING": _layout(44, **_ANTENNAS),
}  # fmt: skip
"""The messages that are read; BESTNAV, PVTSLN and UNIHEADING are Unicore's."""

NAMES: Final = {
    42: "BESTPOS", 99: "BESTVEL", 971: "HEADING", 1335: "HEADING2", 507: "INSPVA", 508: "INSPVAS", 1465: "INSPVAX",
    8: "IONUTC", 37: "VERSION", 41: "RAWEPHEM", 43: "RANGE", 47: "PSRPOS", 93: "RXSTATUS", 100: "PSRVEL", 101: "TIME",
    140: "RANGECMP", 174: "PSRDOP", 241: "BESTXYZ", 263: "INSATT", 264: "INSCOV", 265: "INSPOS", 266: "INSSPD",
    267: "INSVEL", 268: "RAWIMU", 319: "INSATTS", 320: "INSCOVS", 325: "RAWIMUS", 723: "GLOEPHEMERIS",
    1122: "GALEPHEMERIS", 1429: "BESTGNSSPOS", 1430: "BESTGNSSVEL", 1461: "RAWIMUX", 1462: "RAWIMUSX",
    1696: "BDSEPHEMERIS", 2264: "CORRIMUS",
}  # fmt: skip
"""Name of NovAtel's messages by their number; BESTPOS to INSPVAX are read."""
UNICORE_NAMES: Final = {
    2118: "BESTNAV", 1021: "PVTSLN", 972: "UNIHEADING", 8: "GPSION", 12: "OBSVM", 13: "OBSVH", 37: "VERSION",
    102: "RECTIME", 138: "OBSVMCMP", 142: "ADRNAV", 240: "BESTNAVXYZ", 509: "RTKSTATUS", 954: "STADOP", 1026: "PPPNAV",
    1331: "UNIHEADING2", 2125: "RTCMSTATUS", 11276: "AGRIC",
}  # fmt: skip
"""Name of Unicore's messages by their number; BESTNAV to UNIHEADING are read."""
_START: Final = re.compile(rb"[#%](?=[A-Z][A-Z0-9_]{2,30}A,)|\xaaD[\x12\x13\xb5]")
_MAX_NAME_BYTES: Final = 34
_BEGUN: Final = re.compile(rb"(?:[#%][A-Z0-9_]*|\xaaD?)\Z")
"""A message whose start the next piece of a stream may complete."""
_TEXT: Final = re.compile(rb"[#%](([A-Z][A-Z0-9_]*)A,([^#;*\r\n]*);([^#*\r\n]*))\*([0-9A-Fa-f]{8})")
_TEXT_END: Final = re.compile(rb"\*|[#\r\n]")


def crc(data: bytes | memoryview) -> int:
    """The CRC of the bytes between ``#`` and ``*``, or of a binary message without its last four bytes."""
    return crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


class _Found(NamedTuple):
    """What was found of one message: time and fields of ASCII ones, contents of binary ones, with offsets."""

    texts: list[tuple[int, int, list[bytes]]]
    contents: list[tuple[int, int, bytes]]


def scan_bytes(
    data: bytes, counts: MessageCounts[str], base: int = 0, *, last: bool
) -> tuple[dict[str, Messages], int]:
    """The messages of :data:`LAYOUTS` in `data`, and the number of bytes that are done with.

    If the piece is not the last, an unfinished message at its end is left for the next one.
    """
    found: dict[str, _Found] = defaultdict(lambda: _Found([], []))
    spans = [0]
    at = 0
    used = len(data)
    while (start := _START.search(data, at)) is not None:
        begin = start.start()
        is_text = data[begin] != 0xAA
        end = _text_end(data, begin) if is_text else _binary_end(data, begin)
        if end is None or end > len(data):
            if end is not None and not last:
                used = begin
                break
            counts.bad += end is None
            counts.cut += end is not None
            at = start.end()
            continue
        take = _take_text if is_text else _take_binary
        if not take(data, (begin, end), base, counts, found):
            counts.bad += 1
            at = start.end()
            continue
        spans += [begin, end]
        counts.message_bytes += end - begin
        at = end
    else:
        begun = _BEGUN.search(data, max(at, len(data) - _MAX_NAME_BYTES))
        if begun is not None and not last:
            used = begun.start()
    bounds = np.array([*spans, max(used, spans[-1])], np.int64)
    counts.foreign_bytes += count_foreign(np.frombuffer(data, np.uint8), bounds.reshape(-1, 2))
    return {name: _messages(LAYOUTS[name], found[name], counts) for name in found}, used


def _text_end(data: bytes, begin: int) -> int | None:
    """End of an ASCII message, beyond the data if they end first; None if it is not one."""
    stop = _TEXT_END.search(data, begin + 1, begin + MAX_TEXT_BYTES)
    if stop is None:
        return None if len(data) - begin >= MAX_TEXT_BYTES else len(data) + 1
    return stop.start() + 9 if stop.group() == b"*" else None


def _binary_end(data: bytes, begin: int) -> int | None:
    """End of a binary message, beyond the data if they end first; None if its header is invalid."""
    third = data[begin + 2]
    least = {_SHORT_SYNC: _SHORT_HEADER, _UNICORE_SYNC: _UNICORE_HEADER}.get(third, _LONG_HEADER)
    if begin + least > len(data):
        return len(data) + 1
    if third == _SHORT_SYNC:
        return begin + least + data[begin + 3] + _CRC_BYTES
    length_at = begin + (6 if third == _UNICORE_SYNC else 8)
    length = data[length_at] | data[length_at + 1] << 8
    header = least if third == _UNICORE_SYNC else data[begin + 3]
    if header < least or length > MAX_CONTENT_BYTES:
        return None
    return begin + header + length + _CRC_BYTES


def _take_text(
    data: bytes, span: tuple[int, int], base: int, counts: MessageCounts[str], found: dict[str, _Found]
) -> bool:
    """Take an ASCII message, if it is intact."""
    message = _TEXT.match(data, *span)
    if message is None or crc(message[1]) != int(message[5], 16):
        return False
    name = message[2].decode("ascii")
    counts.kinds[name] += 1
    if name in LAYOUTS:
        header = message[3].split(b",")
        found[name].texts.append((base + span[0], _text_time(header), message[4].split(b",")))
    return True


def _text_time(header: list[bytes]) -> int:
    """GPS milliseconds of the header of an ASCII message; −1 if it is unknown."""
    beidou = False
    try:
        if len(header) == 2:  # the short header
            week = int(header[0])
            ms = round(1000.0 * float(header[1]))
        elif header[1] in (b"GPS", b"BDS"):  # Unicore's
            beidou = header[1] == b"BDS"
            known = header[2] not in _TIME_UNKNOWN
            week = int(header[3])
            ms = int(header[4])
            week = week if known else 0
        else:
            week = int(header[4])
            ms = round(1000.0 * float(header[5]))
            week = week if header[3] not in _TIME_UNKNOWN else 0
    except (ValueError, IndexError, OverflowError):
        return -1
    return _gps_ms(week, ms, beidou=beidou)


def _gps_ms(week: int, ms: int, *, beidou: bool = False) -> int:
    """GPS milliseconds since 1980; −1 for an unknown week or an invalid time."""
    if not (0 < week < 10_000 and 0 <= ms < 1000 * WEEK_S):
        return -1
    return 1000 * WEEK_S * week + ms + (_BEIDOU_WEEK * WEEK_S * 1000 + _BEIDOU_MS) * beidou


def _take_binary(
    data: bytes, span: tuple[int, int], base: int, counts: MessageCounts[str], found: dict[str, _Found]
) -> bool:
    """Take a binary message, if it is intact; responses to commands are only counted."""
    begin, end = span
    stop = end - _CRC_BYTES
    if crc(memoryview(data)[begin:stop]) != int.from_bytes(data[stop:end], "little"):
        return False
    number = data[begin + 4] | data[begin + 5] << 8
    third = data[begin + 2]
    name = (UNICORE_NAMES if third == _UNICORE_SYNC else NAMES).get(number, f"message {number}")
    counts.kinds[name] += 1
    response = False
    beidou = False
    known = True
    if third == _SHORT_SYNC:
        header = _SHORT_HEADER
        week, ms = struct.unpack_from("<HI", data, begin + 6)
    elif third == _UNICORE_SYNC:
        header = _UNICORE_HEADER
        week, ms = struct.unpack_from("<HI", data, begin + 10)
        beidou = data[begin + 8] == 1
        known = week > _OLDEST_WEEK
    else:
        header = data[begin + 3]
        response = data[begin + 6] & 0x80 > 0
        week, ms = struct.unpack_from("<HI", data, begin + 14)
        known = data[begin + 13] >= _COARSE
    if name in LAYOUTS and not response:
        gps_ms = _gps_ms(week, ms, beidou=beidou) if known else -1
        found[name].contents.append((base + begin, gps_ms, data[begin + header : stop]))
    return True


def _messages(form: _Layout, found: _Found, counts: MessageCounts[str]) -> Messages:
    """What was found of a message, in the order of the stream; without those that lack fields."""
    texts = [row for row in found.texts if len(row[2]) > max(form.commas.values())]
    size = form.record.itemsize
    contents = [row for row in found.contents if len(row[2]) >= size]
    counts.bad += len(found.texts) - len(texts) + len(found.contents) - len(contents)
    rows = [*texts, *contents]
    values = np.zeros(len(rows), form.read)
    values["gps_ms"] = [ms for _, ms, _ in rows]
    binary = np.frombuffer(b"".join(content[:size] for _, _, content in contents), form.record)
    for name, commas in form.commas.items():
        parse = _word if name in _WORD_FIELDS else _number
        values[name][: len(texts)] = [parse(fields[commas]) for _, _, fields in texts]
        values[name][len(texts) :] = binary[name]
    at: NDArray[np.int64] = np.array([begin for begin, _, _ in rows], np.int64)
    return Messages(values, at)[np.argsort(at, kind="stable")]


def _number(text: bytes) -> Any:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _word(text: bytes) -> int:
    return _WORD_NUMBERS.get(text, UNKNOWN_WORD)


POSITIONS: Final = ("BESTPOS", "BESTNAV", "PVTSLN", "INSPVAX", "INSPVA", "INSPVAS")
"""Messages with positions: the first of them that a log has is read."""
POSES: Final = ("INSPVAX", "INSPVA", "INSPVAS")
HEADINGS: Final = ("HEADING2", "HEADING", "UNIHEADING")
_INS_GOOD: Final = (3, 6, 7)
"""Statuses of an inertial solution that is aligned: good, free, alignment complete."""
_FIX_KINDS: Final = {
    Fix.SINGLE: ("SINGLE", "INS_PSRSP", "OPERATIONAL", "WARNING", "OUT_OF_BOUNDS"),
    Fix.DGPS: ("PSRDIFF", "WAAS", "INS_SBAS", "INS_PSRDIFF"),
    Fix.FIXED: ("L1_INT", "WIDE_INT", "NARROW_INT", "INS_RTKFIXED"),
    Fix.FLOAT: ("L1_FLOAT", "IONOFREE_FLOAT", "NARROW_FLOAT", "RTK_DIRECT_INS", "INS_RTKFLOAT"),
    Fix.ESTIMATED: ("PROPAGATED",),
    Fix.MANUAL: ("FIXEDPOS", "FIXEDHEIGHT"),
    Fix.PPP: tuple(word for word in KIND_NUMBERS if "PPP" in word),
}
NOVATEL_FIXES: Final = {KIND_NUMBERS[word]: fix for fix, words in _FIX_KINDS.items() for word in words}
"""Fix by the number of the type of position; all others are none."""
_FIX_BY_KIND: Final = np.array([NOVATEL_FIXES.get(kind, Fix.NONE) for kind in range(256)], np.int8)
_KIND_WORDS: Final = {number: word for word, number in reversed(KIND_NUMBERS.items())}
_SBAS: Final = (KIND_NUMBERS["WAAS"], KIND_NUMBERS["INS_SBAS"])


class NovatelLog(PositionLog):
    """The positions and poses in a log of NovAtel's or Unicore's messages, in ASCII or binary.

    BESTPOS makes the epoch, or the first of :data:`POSITIONS` that the log has. BESTVEL and the heading of two antennas
    (HEADING2, HEADING or UNIHEADING, with fixed ambiguities) are joined by equal time stamp. Times are GPS week and
    milliseconds. Heights are altitude + undulation, those of INSPVA above the ellipsoid. INSPVAX, or INSPVA, makes
    poses: those of an aligned inertial system, in the vehicle frame that is configured in the receiver.
    """

    format: ClassVar[str] = "novatel"
    title: ClassVar[Text] = Text("NovAtel or Unicore log")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """By intact messages with positions; possible (0.3) where there are others."""
        counts = MessageCounts[str]()
        found, _ = scan_bytes(head.data, counts, last=True)
        if any(len(found.get(name, ())) for name in POSITIONS):
            return 0.95
        return 0.3 if counts.message_bytes >= MIN_INTACT_SHARE * max(len(head.data), 1) else 0.0

    def poses(self) -> PoseTrack:
        """All poses of all files; InputError if there are none, or too many are out of order."""
        self.notices = []
        messages, _, _ = self._messages(self.paths)
        poses = _raw_poses(messages, recording_name(self.paths))
        if not len(poses.seconds):
            raise InputError("no-poses.inertial-log", name=self.name)
        track, dropped = poses.track(self.options)
        self.notices += dropped
        return track

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        found = super().inspect()
        if not any(name in found.facts["messages"] for name in POSES):
            return replace(found, facts=found.facts | {"poses": "none"})
        inspected = NovatelLog(self.paths[:1], self.options)
        try:
            facts = pose_facts(inspected.poses())
        except InputError:
            facts = {"poses": "none"}
        return replace(found, facts=found.facts | facts)

    def _messages(self, paths: list[Path]) -> tuple[dict[str, Messages], MessageCounts[str], list[int]]:
        """The messages by name, their counts, and where each file ends in the stream of all."""
        counts, ends = MessageCounts[str](), list[int]()
        parts: dict[str, list[Messages]] = {name: [] for name in LAYOUTS}

        def scan(piece: bytes, base: int, last: bool) -> int:
            found, used = scan_bytes(piece, counts, base, last=last)
            for name, messages in found.items():
                parts[name].append(messages)
            return used

        for source in self._sources(paths):
            scan_stream(source, counts, scan)
            ends.append(counts.stream_bytes)
        return {name: Messages.joined(pieces, LAYOUTS[name].read) for name, pieces in parts.items()}, counts, ends

    def _read(self, paths: list[Path]) -> LoggedPositions:
        messages, counts, ends = self._messages(paths)
        name = recording_name(paths)
        self.notices += damage_notices(counts, name)
        facts = log_facts(counts, "messages", str)
        of = next((of for of in POSITIONS if len(messages[of])), None)
        if of is None:
            kinds = ", ".join(kind for kind, _ in counts.kinds.most_common(4))
            fault = InputError("no-positions.novatel", name=name, frames=kinds or None)
            return replace(LoggedPositions.none(name, fault), facts=facts)
        base = messages[of]
        columns, kind = _columns(of, base, messages)
        numbers, times = (found.tolist() for found in np.unique(kind, return_counts=True))
        words = [_KIND_WORDS.get(number, f"type {number}") for number in numbers]
        facts |= {"positions_from": of, "solutions": dict(zip(words, times, strict=True))}
        gps_s = base.column("gps_ms", 1e-3)
        columns["t_s"] = np.where(gps_s >= 0.0, gps_to_utc_s(gps_s), np.nan)
        return dated_positions(
            columns, base.at, byte_place(paths, ends), name=name, what=f"{of} messages", facts=facts,
            service=_service(kind[has_position(columns)]),
        )  # fmt: skip


def _columns(
    of: str, base: Messages, messages: Mapping[str, Messages]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """The columns (n,) of the positions in messages named `of`, and the numbers (n,) of their types of position."""
    values = base.values
    names = values.dtype.names or ()
    nothing = np.full(len(base), np.nan)
    field = {name: base.column(name) for name in names}
    kind = values["kind"].astype(np.int64) if "kind" in names else np.full(len(base), KIND_NUMBERS["PROPAGATED"])
    fix = _FIX_BY_KIND[np.minimum(kind, 255)]
    if "status" in names:
        fix = np.where(np.isin(values["status"], _INS_GOOD if of in POSES else SOL_COMPUTED), fix, Fix.NONE)
    if "vn" in names:
        speed = np.hypot(field["ve"], field["vn"])
        course = np.degrees(np.arctan2(field["ve"], field["vn"]))
    elif of == "BESTNAV":
        computed = values["velocity_status"] == SOL_COMPUTED
        speed, course = (np.where(computed, field[name], np.nan) for name in ("speed", "course"))
    else:
        other = messages["BESTVEL"]
        other = other[other.values["status"] == SOL_COMPUTED]
        speed, course = (_at_equal(base, other, name) for name in ("speed", "course"))
    if "heading" in names:
        heading = np.where(_FIX_BY_KIND[np.minimum(values["heading_kind"], 255)] == Fix.FIXED, field["heading"], np.nan)
    else:
        other = next((messages[name] for name in HEADINGS if len(messages[name])), messages["HEADING2"])
        fixed = _FIX_BY_KIND[np.minimum(other.values["kind"], 255)] == Fix.FIXED
        heading = _at_equal(base, other[fixed & (other.values["status"] == SOL_COMPUTED)], "heading")
    satellites = field.get("satellites", nothing)
    on_earth = (np.abs(field["lat"]) <= 90.0) & (np.abs(field["lon"]) <= 360.0)
    columns: dict[str, NDArray[Any]] = {
        "lon_deg": np.where(on_earth, field["lon"], np.nan),
        "lat_deg": np.where(on_earth, field["lat"], np.nan),
        "height_m": field["height"] + field.get("undulation", 0.0),
        "fix": fix,
        "speed_mps": speed,
        "course_deg": course % 360.0,
        "heading_deg": heading % 360.0,
        "satellites": np.where((satellites >= 0) & (satellites < 255), satellites, -1).astype(np.int16),
        "age_s": field.get("age", nothing),
    }
    sigmas = {f"sigma_{axis}_m": _positive(field.get(f"sigma_{axis}", nothing)) for axis in "enh"}
    return columns | sigmas, kind


def _at_equal(base: Messages, other: Messages, name: str) -> FloatArray:
    """A field (n,) of other messages with the times of `base`; nan elsewhere."""
    known = other[other.values["gps_ms"] >= 0]
    return at_equal(base.values["gps_ms"], known.values["gps_ms"], known.column(name))


def _positive(sigma: FloatArray) -> FloatArray:
    """Standard deviations (n,); nan for 0, which means unknown."""
    return np.where(sigma > 0.0, sigma, np.nan)


def _service(kind: NDArray[np.int64]) -> str:
    """The correction service of most positions, by their types."""
    if 2 * np.sum(np.isin(kind, _SBAS)) > len(kind):
        return "sbas"
    return "ppp" if 2 * np.sum(_FIX_BY_KIND[np.minimum(kind, 255)] == Fix.PPP) > len(kind) else ""


def _raw_poses(messages: Mapping[str, Messages], name: str) -> RawPoses:
    """The poses of an aligned inertial system."""
    of = next((of for of in POSES if len(messages[of])), POSES[0])
    poses = messages[of]
    usable = np.isin(poses.values["status"], _INS_GOOD) & (poses.values["gps_ms"] >= 0)
    field = {column: poses.column(column) for column in poses.values.dtype.names or ()}
    nothing = np.full(len(poses), np.nan)
    height = field["height"] + field.get("undulation", 0.0)
    values = np.column_stack([field["lon"], field["lat"], height, field["roll"], field["pitch"], field["azimuth"]])
    axes = ("e", "n", "h", "roll", "pitch", "azimuth")
    sigmas = np.column_stack([_positive(field.get(f"sigma_{axis}", nothing)) for axis in axes])
    usable &= np.isfinite(values).all(axis=1) & (np.abs(values[:, :2]) <= (360.0, 90.0)).all(axis=1)
    return RawPoses(
        seconds=field["gps_ms"][usable] * 1e-3,
        scale="gps",
        scale_note="GPS time of its messages",
        values=np.hstack([values, sigmas])[usable],
        projected=False,
        true_north=True,
        name=name,
    )
