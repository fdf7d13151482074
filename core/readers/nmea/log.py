"""NMEA 0183 logs of GNSS receivers: GGA or GNS, RMC, GST, VTG, HDT (THS), ZDA, and the proprietary PASHR and PUBX.

GGA makes the epoch, or GNS in a log without positions in GGA, or PUBX,00 in one without either. RMC, GST, PUBX,00 and
PASHR are joined by equal time stamp. VTG and HDT
have no time: if the log begins with such a sentence, it belongs to the next sentence with a time (the receiver writes
it first in each burst), else to the one before. Epochs are never sorted: those that are not later than all before are
dropped and counted.
"""

import datetime as dt
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.gravity import GEOID_SIGMA_M, coarse_geoid_m
from furrowmap.core.readers.epochs import MAX_BACKWARD_SHARE, midnight_utc_s, midnights_utc_s
from furrowmap.core.readers.framed_messages import paired
from furrowmap.core.readers.inertial_rows import attitude_track
from furrowmap.core.readers.nmea.sentences import (
    FIELDS,
    Kind,
    SentenceCounts,
    Sentences,
    are_unchecked,
    read_sentences,
    scan_bytes,
)
from furrowmap.core.readers.position_log import LoggedPositions, PositionLog, byte_place
from furrowmap.core.readers.reader import recording_name
from furrowmap.core.readers.source import Head, look
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import DAY_S, nearest_in_cycle, unroll
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.pose_track import TRUE_NORTH, AttitudeTrack

MAX_OTHER_SHARE: Final = 0.5
"""Largest share of other bytes in a file that is recognised by its sentences alone."""
MIN_NMEA_SHARE: Final = 0.02
"""Smallest share of sentences in a binary log that is recognised by its GGA or GNS sentences."""
NOTED_OTHER_SHARE: Final = 0.01
"""Share of other bytes from which a notice reports them."""
CLOCK_SET_S: Final = 60.0
"""Smallest step of the clock before the first fix that means that the clock was set."""
MAX_SATELLITES: Final = 999
MAX_SWITCHES: Final = 0.2
"""Largest share of positions with another talker than before, for one receiver: it changes the talker with the
constellations that it uses, but not with every sentence."""
WRONG_SIGMAS: Final = 5.0
ZERO_SIGMAS: Final = 2.0
"""Standard deviations of the geoid's model from which on a separation is wrong; the second for one that is zero."""


class NmeaLog(PositionLog):
    """The positions in a log of NMEA 0183 sentences.

    Sentences may begin at every ``$`` and need a valid checksum, so noise and binary messages between them are skipped;
    in a log without checksums they end with their line.
    The height above the ellipsoid is altitude + geoid separation. Times are UTC; the date comes from RMC or ZDA, else
    from `ReadOptions.date` or `ReadOptions.near_s`.
    """

    format: ClassVar[str] = "nmea"
    title: ClassVar[Text] = Text("NMEA 0183 log")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain if most of the file is sentences; possible with GGA or GNS among other bytes."""
        if b"$" not in head.data:
            return 0.0
        counts = SentenceCounts()
        sentences, _ = scan_bytes(head.data, counts, unchecked=are_unchecked(head.data))
        share = counts.message_bytes / len(head.data)
        if len(sentences) and share >= MAX_OTHER_SHARE:
            return 0.9
        return (
            0.6 if share >= MIN_NMEA_SHARE and np.isin(sentences.kind, (Kind.GGA, Kind.GNS, Kind.PUBX)).any() else 0.0
        )

    def _undated(self, t_s: float) -> str:
        return f"{_time_of_day(t_s)} (no date)"

    def attitude(self) -> AttitudeTrack:
        """Roll, pitch and heading of PASHR in all files; InputError as :meth:`track`, or if there are none in order."""
        pashr = self._sentences(self.paths)[0].of_kind(Kind.PASHR)
        stated = np.asarray(np.isfinite(pashr.values[:, :4]).all(axis=1))
        pashr = pashr[stated]
        if not len(pashr):
            raise InputError("no-attitudes", name=self.name)
        first_s = float(self.track().t_s[0])
        t_s = unroll(pashr.column(Kind.PASHR, "tod_s"), DAY_S)
        t_s = t_s + float(nearest_in_cycle(t_s[0], first_s, DAY_S) - t_s[0])
        angles = np.column_stack([pashr.column(Kind.PASHR, name) for name in ("roll_deg", "pitch_deg", "heading_deg")])
        track, late = attitude_track(t_s, angles, TRUE_NORTH, self.name)
        self.notices += late
        return track

    def _sentences(self, paths: list[Path]) -> tuple[Sentences, SentenceCounts, list[int]]:
        """The sentences, their counts, and where each file ends in the stream of all."""
        counts = SentenceCounts()
        parts: list[Sentences] = []
        ends: list[int] = []
        unchecked = are_unchecked(self._piece if self._piece is not None else look(paths[0]).data)
        if unchecked:
            self.notices.append(Notice("sentences-unchecked", name=recording_name(paths)))
        for source in self._sources(paths):
            parts += read_sentences(source, counts, unchecked=unchecked)
            ends.append(counts.stream_bytes)
        return Sentences.joined(parts), counts, ends

    def _read(self, paths: list[Path]) -> LoggedPositions:
        sentences, counts, ends = self._sentences(paths)
        name = recording_name(paths)
        date = self.options.date
        near_s = self.options.near_s
        positions = assemble(sentences, name, date=date, near_s=near_s, place=byte_place(paths, ends))
        if counts.bad or counts.cut:
            damaged = Notice("sentences-damaged", name=name, bad=counts.bad, cut=counts.cut, intact=counts.intact)
            self.notices.append(damaged)
        if counts.other_bytes > NOTED_OTHER_SHARE * counts.stream_bytes:
            share = 100.0 * counts.other_bytes / counts.stream_bytes
            self.notices.append(Notice("bytes-skipped", name=name, other_bytes=counts.other_bytes, percent=share))
        facts = {
            "talkers": _by(counts, lambda address: "proprietary" if address.startswith("P") else address[:2]),
            "sentences": _by(counts, lambda address: address if address.startswith("P") else address[2:]),
            "intact": counts.intact,
            "bad_checksums": counts.bad,
            "cut_or_without_checksum": counts.cut,
            "begun_in_mid_line": counts.behind_cut,
            "other_bytes": counts.other_bytes,
            **positions.facts,
        }
        return replace(positions, facts=facts, scale="UTC from its sentences")


def _separation_off_m(positions: Sentences, name: str) -> tuple[float, list[Notice]]:
    """By how much the geoid separations are off a model of the geoid, with a notice where that is too much; else 0.

    They are off where they are zero all the time, or those of another place.
    """
    columns = [positions.column(Kind.GGA, column) for column in ("lon_deg", "lat_deg", "separation_m")]
    stated = np.isfinite(columns).all(axis=0) & (positions.talker != b"PU")  # heights of PUBX are ellipsoidal
    lon_deg, lat_deg, stated_m = np.array(columns)[:, stated]
    if not len(stated_m):
        return 0.0, []
    middle = len(stated_m) // 2
    model_m = coarse_geoid_m(float(lon_deg[middle]), float(lat_deg[middle]))
    median_m = float(np.median(stated_m))
    # A receiver that knows the separation states it to a millimetre or a decimetre: it is hardly ever zero.
    sigmas = ZERO_SIGMAS if not stated_m.any() else WRONG_SIGMAS
    off_m = abs(median_m - model_m)
    if off_m <= sigmas * GEOID_SIGMA_M:
        return 0.0, []
    return off_m, [Notice("geoid-separation", name=name, stated_m=median_m, model_m=model_m, off_m=off_m)]


def _by(counts: SentenceCounts, part: Callable[[str], str]) -> dict[str, int]:
    """Number of intact sentences by a part of their address, in descending order."""
    by_part: Counter[str] = Counter()
    for address, count in counts.kinds.items():
        by_part[part(address)] += count
    return dict(by_part.most_common())


def assemble(
    sentences: Sentences, name: str, *, date: str | None, near_s: float | None, place: Callable[[int], str]
) -> LoggedPositions:
    """The positions of the receiver with the best and most of them; undated times count from their first midnight.

    Args:
        date: UTC date (YYYY-MM-DD) of the first position of a log without dates.
        near_s: a UTC time within twelve hours of the first position of a log without dates.
        place: describes an offset :attr:`Sentences.at` in the log.

    Raises:
        InputError: if `date` is not a date.
    """
    stated_s = None if date is None else midnight_utc_s(date)
    # GNS, or PUBX,00, in the place of GGA where only it has positions: their columns are the same.
    kinds = (Kind.GGA, Kind.GNS, Kind.PUBX)
    used = next((kind for kind in kinds if _has_position(sentences.of_kind(kind)).any()), Kind.GGA)
    kept = sentences[~np.isin(sentences.kind, [kind for kind in kinds if kind is not used])]
    sentences = replace(kept, kind=np.where(kept.kind == used, np.int8(Kind.GGA), kept.kind))
    all_gga = sentences.of_kind(Kind.GGA)
    of_talker = {t: int(np.sum(all_gga.talker[_has_position(all_gga)] == t)) for t in np.unique(all_gga.talker)}
    facts = {"positions_by_talker": {t.decode("ascii"): count for t, count in of_talker.items() if count}}
    mine, notices = _one_receiver(all_gga[_has_position(all_gga)], name)
    gga = all_gga[np.isin(all_gga.talker, mine)] if len(mine) else all_gga
    positions = gga[_has_position(gga)]
    without = len(gga) - len(positions)
    if not len(positions):
        fault = InputError("no-positions.no-positions", name=name, all_gga=len(all_gga) or None)
        return replace(LoggedPositions.none(name, fault, without_position=without), facts=facts, notices=tuple(notices))
    separation_off_m, of_separation = _separation_off_m(positions, name)
    belongs = _belongs(sentences, mine, [t for t, count in of_talker.items() if count])
    log = sentences if belongs.all() else sentences[belongs]
    t_s, dated, of_date = _times(positions, log, name, stated_s, near_s)
    undated = InputError("no-date.no-date", name=name, first_time=_time_of_day(t_s[0]), last_time=_time_of_day(t_s[-1]))
    found = LoggedPositions.in_order(
        _columns(positions, t_s, log) | {"t_s": t_s},
        lambda k: place(int(positions.at[k])),
        name=name,
        without_position=without,
        notices=[*notices, *of_separation, *of_date, *_clock_set_notices(gga, positions, name)],
        fault=None if dated else undated,
    )
    notices = list(found.notices)
    if len(found.track) and not np.isfinite(found.track.height_m).any():
        stated = bool(np.isfinite(positions.column(Kind.GGA, "altitude_m")).any())
        notices.append(Notice("no-ellipsoidal-height", name=name, is_altitude=stated))
    track = replace(found.track, separation_off_m=separation_off_m)
    return replace(found, track=track, facts=facts, notices=tuple(notices))


def _has_position(gga: Sentences) -> NDArray[np.bool_]:
    quality = gga.column(Kind.GGA, "quality")
    return (quality >= 1) & np.isfinite(gga.values[:, :3]).all(axis=1)


def _one_receiver(positions: Sentences, name: str) -> tuple[NDArray[np.bytes_], list[Notice]]:
    """The talkers of one receiver: all, if they alternate only occasionally, else the best one."""
    talkers = np.unique(positions.talker)
    if len(talkers) < 2:
        return talkers, []
    step = np.diff(positions.column(Kind.GGA, "tod_s"))
    ahead = (step + DAY_S / 2) % DAY_S - DAY_S / 2
    switches = np.sum(positions.talker[1:] != positions.talker[:-1])
    if np.mean(ahead <= 0) <= MAX_BACKWARD_SHARE and switches <= MAX_SWITCHES * len(positions):
        return talkers, []
    quality = positions.column(Kind.GGA, "quality")
    rtk = np.isin(quality, (Fix.FIXED, Fix.FLOAT))
    rank = {t: (int(np.sum(rtk & (positions.talker == t))), int(np.sum(positions.talker == t))) for t in talkers}
    best = max(talkers, key=lambda t: rank[t])
    others = ", ".join(f"{t.decode('ascii')} ({rank[t][1]} positions)" for t in talkers if t != best)
    left_out = Notice(
        "several-receivers",
        name=name,
        talkers=len(talkers),
        value=best.decode("ascii"),
        rank=rank[best][1],
        others=others,
    )
    return np.array([best]), [left_out]


def _belongs(sentences: Sentences, mine: NDArray[np.bytes_], positioned: list[bytes]) -> NDArray[np.bool_]:
    """Which sentences are the receiver's: of its talkers, or of a kind that only talkers without positions have."""
    is_mine = np.isin(sentences.talker, mine)
    is_free = ~np.isin(sentences.talker, np.array(positioned, dtype="S2"))
    out = is_mine.copy()
    for kind in Kind:
        of_kind = sentences.kind == kind
        if not np.any(of_kind & is_mine):
            out |= of_kind & is_free
    return out


def _times(
    positions: Sentences, log: Sentences, name: str, stated_s: float | None, near_s: float | None
) -> tuple[FloatArray, bool, list[Notice]]:
    """Times (n,) of the positions, and whether they are UTC; else they count from the midnight before the first."""
    tod = positions.column(Kind.GGA, "tod_s")
    dated_s, dated_at = _dated(log, positions.at[0])
    if len(dated_s):
        behind = np.searchsorted(dated_at, positions.at)
        before = np.maximum(behind - 1, 0)
        behind = np.minimum(behind, len(dated_at) - 1)
        by_before = nearest_in_cycle(tod, dated_s[before], DAY_S)
        by_behind = nearest_in_cycle(tod, dated_s[behind], DAY_S)
        nearer = np.abs(by_behind - dated_s[behind]) < np.abs(by_before - dated_s[before])
        t_s = np.where(nearer, by_behind, by_before)
        notices = []
        if stated_s is not None and not stated_s <= t_s[0] < stated_s + DAY_S:
            in_log = dt.datetime.fromtimestamp(float(t_s[0]), dt.UTC).date()
            stated = dt.datetime.fromtimestamp(stated_s, dt.UTC).date()
            notices.append(Notice("date-contradicted.by-sentences", name=name, in_log=in_log, date=stated))
        return t_s, True, notices
    t_s = unroll(tod, DAY_S)
    if stated_s is not None:
        return t_s + stated_s, True, []
    if near_s is not None:
        return t_s + float(nearest_in_cycle(t_s[0], near_s, DAY_S) - t_s[0]), True, []
    return t_s, False, []


def _dated(log: Sentences, first_at: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """UTC and offsets of the valid RMC, else of ZDA, whose calendar may be wrong by years before the first position."""
    rmc = log.of_kind(Kind.RMC)
    zda = log.of_kind(Kind.ZDA)
    rmc = rmc[rmc.column(Kind.RMC, "valid") == 1.0]
    for kind, found in ((Kind.RMC, rmc), (Kind.ZDA, zda[zda.at >= first_at]), (Kind.ZDA, zda)):
        date_ymd = found.column(kind, "date_ymd")
        whole = np.where((date_ymd > 0) & (date_ymd < 1e8), date_ymd, 0.0).astype(np.int64)
        t_s = midnights_utc_s(whole // 10000, whole // 100 % 100, whole % 100) + found.column(kind, "tod_s")
        known = np.isfinite(t_s)
        if known.any():
            return t_s[known], found.at[known]
    return np.empty(0), np.empty(0, np.int64)


def _columns(positions: Sentences, t_s: FloatArray, log: Sentences) -> dict[str, NDArray[Any]]:
    """The columns (n,) of the positions, with those of RMC, GST, VTG and HDT at the same times."""
    gga = {column: positions.column(Kind.GGA, column) for column in FIELDS[Kind.GGA]}
    quality = gga["quality"]
    satellites = gga["satellites"]
    columns: dict[str, NDArray[Any]] = {
        "lon_deg": gga["lon_deg"],
        "lat_deg": gga["lat_deg"],
        "height_m": gga["altitude_m"] + gga["separation_m"],
        "fix": np.select([quality == 9, quality > 9], [Fix.DGPS, Fix.SINGLE], quality).astype(np.int8),
        "satellites": np.where(satellites <= MAX_SATELLITES, satellites, -1.0).astype(np.int16),
        "hdop": gga["hdop"],
        "age_s": gga["age_s"],
    }
    timed = (log.kind != Kind.VTG) & (log.kind != Kind.HDT)
    timed_at = log.at[timed]
    near = np.clip(np.searchsorted(positions.at, timed_at, side="right") - 1, 0, len(positions) - 1)
    timed_s = nearest_in_cycle(log.values[timed, 0], t_s[near], DAY_S)  # the day of the last position before
    key_us = np.round(t_s * 1e6).astype(np.int64)
    for kind in (Kind.RMC, Kind.GST, Kind.VTG, Kind.HDT, Kind.PUBX_MOTION, Kind.PASHR):
        found = log.of_kind(kind)
        if kind is Kind.RMC:
            found = found[found.column(kind, "valid") == 1.0]
        if not len(found):
            continue
        index = np.searchsorted(timed_at, found.at)
        leads = False
        if kind in (Kind.VTG, Kind.HDT):
            leads = bool(found.at[0] < timed_at[0])
            index -= 0 if leads else 1
        inside = (index >= 0) & (index < len(timed_at))
        stamps = np.where(inside, timed_s[np.clip(index, 0, len(timed_at) - 1)], np.nan)
        # Of several in one epoch the one nearest to its sentence with a time is used: it is the last.
        known = np.flatnonzero(np.isfinite(stamps))[:: 1 if leads else -1]
        row, last = paired(key_us, np.round(stamps[known] * 1e6).astype(np.int64))
        for column in FIELDS[kind][1:]:
            if column in GnssTrack.columns():
                values = np.full(len(t_s), np.nan)
                values[row] = found.column(kind, column)[known[last]]
                first = columns.get(column, values)  # RMC before VTG
                columns[column] = np.where(np.isfinite(first), first, values)
    return columns


def _time_of_day(t_s: float) -> str:
    """Time of day hh:mm:ss.sss of seconds since any midnight."""
    ms = round(float(t_s) * 1000.0) % (DAY_S * 1000)
    return f"{ms // 3_600_000:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d}.{ms % 1000:03d}"


def _clock_set_notices(gga: Sentences, positions: Sentences, name: str) -> Iterator[Notice]:
    """A notice that the receiver's clock was set at its first fix; the times before are invalid."""
    tod = gga.column(Kind.GGA, "tod_s")[gga.at <= positions.at[0]]
    tod = tod[np.isfinite(tod)]
    ahead = (np.diff(tod) + DAY_S / 2) % DAY_S - DAY_S / 2
    jumps = np.flatnonzero(np.abs(ahead) > CLOCK_SET_S)
    if len(jumps):
        last = int(jumps[-1])
        yield Notice(
            "clock-set-at-first-fix",
            name=name,
            before=_time_of_day(tod[last]),
            after=_time_of_day(tod[last + 1]),
            times=len(tod) - 1,
        )
