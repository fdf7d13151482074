"""NMEA sentences to one receiver's positions: choice of receiver, date, and assignment of sentences to epochs.

GGA makes the epoch, or GNS in a log without positions in GGA. RMC and GST are joined by equal time stamp. VTG and HDT
have no time: if the log begins with such a sentence, it belongs to the next sentence with a time (the receiver writes
it first in each burst), else to the one before. Epochs are never sorted: those that are not later than all before are
dropped and counted.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import MAX_BACKWARD_SHARE, in_order, midnight_utc_s, midnights_utc_s
from furrowmap.core.readers.nmea.sentences import FIELDS, Kind, Sentences
from furrowmap.core.readers.position_log import LoggedPositions
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import DAY_S, nearest_in_cycle, unroll
from furrowmap.core.values.gnss import Fix, GnssTrack

FloatArray = NDArray[np.float64]

CLOCK_SET_S: Final = 60.0
"""Smallest step of the clock before the first fix that means that the clock was set."""
MOST_SATELLITES: Final = 999
MOST_SWITCHES: Final = 0.2
"""Largest share of positions with another talker than before, for one receiver: it changes the talker with the
constellations that it uses, but not with every sentence."""


def assemble(
    sentences: Sentences,
    name: str,
    *,
    date: str | None,
    near_s: float | None,
    place: Callable[[int], str],
) -> LoggedPositions:
    """The positions of the receiver with the best and most of them; undated times count from their first midnight.

    Args:
        sentences: of one recording, in the order of the log.
        name: of the log, for messages.
        date: UTC date (YYYY-MM-DD) of the first position of a log without dates.
        near_s: a UTC time within twelve hours of the first position of a log without dates.
        place: describes an offset :attr:`Sentences.at` in the log.

    Raises:
        InputError: if `date` is not a date.
    """
    notices: list[Notice] = []
    sentences = _gns_as_gga(sentences)
    all_gga = sentences.of(Kind.GGA)
    of_talker = {t: int(np.sum(all_gga.talker[_has_position(all_gga)] == t)) for t in np.unique(all_gga.talker)}
    mine = _one_receiver(all_gga[_has_position(all_gga)], notices, name)
    gga = all_gga[np.isin(all_gga.talker, mine)] if len(mine) else all_gga
    belongs = _belongs(sentences, mine, [t for t, count in of_talker.items() if count])
    log = sentences if belongs.all() else sentences[belongs]
    positions = gga[_has_position(gga)]

    t_s, dated = _times(positions, log, notices, name, date=date, near_s=near_s)
    _note_clock_set(gga, positions, notices, name)
    forward = np.zeros(len(t_s), bool)
    dropped = 0
    fault: InputError | None = None
    if not len(t_s):
        fault = _no_positions(name, len(all_gga))
    else:
        lat, lon = (positions.column(Kind.GGA, column) for column in ("lat_deg", "lon_deg"))
        try:
            forward, disorder_notices = in_order(t_s, lon, lat, name, lambda k: place(int(positions.at[k])))
        except InputError as disorder:
            fault = disorder
        else:
            notices += disorder_notices
            dropped = int(np.sum(~forward))
            fault = None if dated else _no_date(t_s, name)
    kept = positions[forward]
    _note_heights(kept, notices, name)
    return LoggedPositions(
        track=_track(kept, t_s[forward], log, name),
        dated=dated,
        without_position=int(np.sum(~_has_position(gga))),
        dropped=dropped,
        facts={"positions_by_talker": {t.decode("ascii"): count for t, count in of_talker.items() if count}},
        notices=tuple(notices),
        fault=fault,
    )


def _gns_as_gga(sentences: Sentences) -> Sentences:
    """GNS in the place of GGA where only GNS has positions: their columns are the same."""
    gga, gns = sentences.of(Kind.GGA), sentences.of(Kind.GNS)
    if _has_position(gga).any() or not _has_position(gns).any():
        return sentences[sentences.kind != Kind.GNS]
    kept = sentences[sentences.kind != Kind.GGA]
    return replace(kept, kind=np.where(kept.kind == Kind.GNS, np.int8(Kind.GGA), kept.kind))


def _has_position(gga: Sentences) -> NDArray[np.bool_]:
    quality = gga.column(Kind.GGA, "quality")
    return (quality >= 1) & np.isfinite(gga.values[:, :3]).all(axis=1)


def _one_receiver(positions: Sentences, notices: list[Notice], name: str) -> NDArray[np.bytes_]:
    """The talkers of one receiver: all, if they alternate only occasionally, else the best one."""
    talkers = np.unique(positions.talker)
    if len(talkers) < 2:
        return talkers
    step = np.diff(positions.column(Kind.GGA, "tod_s"))
    ahead = (step + DAY_S / 2) % DAY_S - DAY_S / 2
    switches = np.sum(positions.talker[1:] != positions.talker[:-1])
    if np.mean(ahead <= 0) <= MAX_BACKWARD_SHARE and switches <= MOST_SWITCHES * len(positions):
        return talkers
    quality = positions.column(Kind.GGA, "quality")
    rtk = np.isin(quality, (Fix.FIXED, Fix.FLOAT))
    rank = {t: (int(np.sum(rtk & (positions.talker == t))), int(np.sum(positions.talker == t))) for t in talkers}
    best = max(talkers, key=lambda t: rank[t])
    others = ", ".join(f"{t.decode('ascii')} ({rank[t][1]} positions)" for t in talkers if t != best)
    notices.append(
        Notice(
            "several-receivers",
            name=name,
            talkers=len(talkers),
            value=best.decode("ascii"),
            rank=rank[best][1],
            others=others,
        )
    )
    return np.array([best])


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
    positions: Sentences, log: Sentences, notices: list[Notice], name: str, *, date: str | None, near_s: float | None
) -> tuple[FloatArray, bool]:
    """Times (n,) of the positions, and whether they are UTC; else they count from the midnight before the first."""
    tod = positions.column(Kind.GGA, "tod_s")
    stated_s = None if date is None else midnight_utc_s(date)
    if not len(tod):
        return tod, False
    dated_s, dated_at = _dated(log, positions.at[0])
    if len(dated_s):
        behind = np.searchsorted(dated_at, positions.at)
        before = np.maximum(behind - 1, 0)
        behind = np.minimum(behind, len(dated_at) - 1)
        by_before = nearest_in_cycle(tod, dated_s[before], DAY_S)
        by_behind = nearest_in_cycle(tod, dated_s[behind], DAY_S)
        nearer = np.abs(by_behind - dated_s[behind]) < np.abs(by_before - dated_s[before])
        t_s = np.where(nearer, by_behind, by_before)
        if stated_s is not None and not stated_s <= t_s[0] < stated_s + DAY_S:
            in_log = dt.datetime.fromtimestamp(float(t_s[0]), dt.UTC).date()
            notices.append(Notice("date-contradicted.times", name=name, in_log=in_log, date=date))
        return t_s, True
    t_s = unroll(tod, DAY_S)
    if stated_s is not None:
        return t_s + stated_s, True
    if near_s is not None:
        return t_s + float(nearest_in_cycle(t_s[0], near_s, DAY_S) - t_s[0]), True
    return t_s, False


def _dated(log: Sentences, first_at: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """UTC of the sentences with a date, and their offsets in the log.

    RMC is used if it is marked as valid. ZDA has no such mark, and before the first position a receiver's calendar may
    be wrong by years, so it is used from there on, and only without RMC.
    """
    rmc, zda = log.of(Kind.RMC), log.of(Kind.ZDA)
    rmc = rmc[rmc.column(Kind.RMC, "valid") == 1.0]
    for kind, found in ((Kind.RMC, rmc), (Kind.ZDA, zda[zda.at >= first_at]), (Kind.ZDA, zda)):
        t_s = _midnights(found.column(kind, "date_ymd")) + found.column(kind, "tod_s")
        known = np.isfinite(t_s)
        if known.any():
            return t_s[known], found.at[known]
    return np.empty(0), np.empty(0, np.int64)


def _midnights(date_ymd: FloatArray) -> FloatArray:
    """UTC of the start of days (n,) written yyyymmdd; nan for invalid dates."""
    whole = np.where((date_ymd > 0) & (date_ymd < 1e8), date_ymd, 0.0).astype(np.int64)
    return midnights_utc_s(whole // 10000, whole // 100 % 100, whole % 100)


def _track(positions: Sentences, t_s: FloatArray, log: Sentences, name: str) -> GnssTrack:
    """The positions with the columns of RMC, GST, VTG and HDT."""
    gga = {column: positions.column(Kind.GGA, column) for column in FIELDS[Kind.GGA]}
    added = _added(positions.at, t_s, log)
    nothing = np.full(len(t_s), np.nan)
    speed_mps, course_deg = (
        np.where(np.isfinite(rmc), rmc, vtg)
        for rmc, vtg in (
            [added.get((kind, column), nothing) for kind in (Kind.RMC, Kind.VTG)]
            for column in ("speed_mps", "course_deg")
        )
    )
    quality = gga["quality"]
    fix = np.select([quality == 9, quality > 9], [Fix.DGPS, Fix.SINGLE], quality)
    satellites = np.where(gga["satellites"] <= MOST_SATELLITES, gga["satellites"], -1.0)
    return GnssTrack(
        t_s=t_s,
        lon_deg=gga["lon_deg"],
        lat_deg=gga["lat_deg"],
        height_m=gga["altitude_m"] + gga["separation_m"],
        fix=fix.astype(np.int8),
        sigma_e_m=added.get((Kind.GST, "sigma_e_m"), nothing),
        sigma_n_m=added.get((Kind.GST, "sigma_n_m"), nothing),
        sigma_h_m=added.get((Kind.GST, "sigma_h_m"), nothing),
        speed_mps=speed_mps,
        course_deg=course_deg,
        heading_deg=added.get((Kind.HDT, "heading_deg"), nothing),
        satellites=satellites.astype(np.int16),
        hdop=gga["hdop"],
        age_s=gga["age_s"],
        source=name,
    )


def _added(position_at: NDArray[np.int64], t_s: FloatArray, log: Sentences) -> dict[tuple[Kind, str], FloatArray]:
    """Columns (n,) of RMC, GST, VTG and HDT at the positions' times; nan where an epoch has none."""
    out: dict[tuple[Kind, str], FloatArray] = {}
    if not len(t_s):
        return out
    timed_s, timed_at = _timed(log, position_at, t_s)
    for kind in (Kind.RMC, Kind.GST, Kind.VTG, Kind.HDT):
        found = log.of(kind)
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
        # Of several in one epoch the one nearest to its sentence with a time is used: it is assigned last.
        order = slice(None) if leads else slice(None, None, -1)
        row, of = _equal(t_s, stamps[order])
        for column in FIELDS[kind][1:]:
            values = np.full(len(t_s), np.nan)
            values[row] = found.column(kind, column)[order][of]
            out[kind, column] = values
    return out


def _timed(
    log: Sentences, position_at: NDArray[np.int64], position_t_s: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Times of all sentences that have one, on the day of the last position before, and their offsets in the log."""
    timed = (log.kind != Kind.VTG) & (log.kind != Kind.HDT)
    at = log.at[timed]
    near = np.clip(np.searchsorted(position_at, at, side="right") - 1, 0, len(position_at) - 1)
    return nearest_in_cycle(log.values[timed, 0], position_t_s[near], DAY_S), at


def _equal(t_s: FloatArray, stamps: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index pairs (into `t_s`, into `stamps`) of times that are equal to the microsecond; `t_s` increases."""
    known = np.flatnonzero(np.isfinite(stamps))
    key = np.round(t_s * 1e6).astype(np.int64)
    wanted = np.round(stamps[known] * 1e6).astype(np.int64)
    row = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
    equal = key[row] == wanted
    return row[equal], known[equal]


def _no_positions(name: str, all_gga: int) -> InputError:
    return InputError("no-positions.no-positions", name=name, all_gga=all_gga or None)


def _no_date(t_s: FloatArray, name: str) -> InputError:
    return InputError("no-date.no-date", name=name, t_s=time_of_day(t_s[0]), t_s_last=time_of_day(t_s[-1]))


def time_of_day(t_s: float) -> str:
    """Time of day hh:mm:ss.sss of seconds since any midnight."""
    ms = round(float(t_s) * 1000.0) % (DAY_S * 1000)
    return f"{ms // 3_600_000:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d}.{ms % 1000:03d}"


def _note_clock_set(gga: Sentences, positions: Sentences, notices: list[Notice], name: str) -> None:
    """Note that the receiver's clock was set at its first fix; the times before are invalid."""
    if not len(positions):
        return
    tod = gga.column(Kind.GGA, "tod_s")[gga.at <= positions.at[0]]
    tod = tod[np.isfinite(tod)]
    ahead = (np.diff(tod) + DAY_S / 2) % DAY_S - DAY_S / 2
    jumps = np.flatnonzero(np.abs(ahead) > CLOCK_SET_S)
    if len(jumps):
        last = int(jumps[-1])
        notices.append(
            Notice(
                "clock-set-at-first-fix",
                name=name,
                tod=time_of_day(tod[last]),
                tod_2=time_of_day(tod[last + 1]),
                tod_3=len(tod) - 1,
            )
        )


def _note_heights(positions: Sentences, notices: list[Notice], name: str) -> None:
    altitude, separation = (positions.column(Kind.GGA, c) for c in ("altitude_m", "separation_m"))
    if len(positions) and not np.isfinite(altitude + separation).any():
        notices.append(Notice("no-ellipsoidal-height", name=name, is_altitude=bool(np.isfinite(altitude).any())))
