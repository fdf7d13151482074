"""Solutions that a processor wrote: the ``.pos`` files of RTKLIB, CLASLIB, MADOCALIB and their kin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import in_order
from furrowmap.core.readers.facts import jump_notices, position_facts, timing_facts, utc_facts
from furrowmap.core.readers.reader import ClockReading, Inspection, ReadOptions
from furrowmap.core.readers.rtklib.rows import ROWS, Form, Header, Rows, finished, read_rows
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.values.clock import DAY_S, GPS_EPOCH_S, HOUR_S, WEEK_S, gps_to_utc_s
from furrowmap.core.values.earth import east_north_up, geodetic
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.scan import Clock

FloatArray = NDArray[np.float64]

FIXES: Final = {1: Fix.FIXED, 2: Fix.FLOAT, 3: Fix.DGPS, 4: Fix.DGPS, 5: Fix.SINGLE, 6: Fix.PPP, 7: Fix.ESTIMATED}
"""Quality of a position by its flag Q (fix, float, SBAS, DGPS, single, PPP, dead reckoning)."""
MOST_AHEAD: Final = 0.5


class RtklibPos:
    """The positions of a solution file, in either of its two time styles.

    Times are GPS time unless the header says UTC or JST. A standard deviation of 0, 0 satellites, and an age that is 0
    throughout are taken for not stated. Heights above the geoid are not taken for ellipsoidal ones. A solution that was
    filtered backward and written so is turned round.

    Args:
        paths: the files of one recording, in the order of time.
        options: not used; the files carry all.
    """

    format: ClassVar[str] = "rtklib-pos"
    title: ClassVar[str] = "solution of RTKLIB or its kin (.pos)"

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        self.paths = list(paths)
        self.options = options
        self.notices: list[Notice] = []

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with a header of its kind; likely where the first lines are rows."""
        if b"\0" in head.data[:4096]:
            return 0.0
        lines = [line.strip() for line in head.data.split(b"\n")[:200]]
        header = Header()
        for line in lines:
            if line.startswith(b"%"):
                header.take(line[:2048].decode("latin-1"))
        if header.time:
            return 0.95
        rows = [line for line in lines[:50] if line and not line.startswith(b"%")][:-1]
        good = sum(any(row.fullmatch(line[:2048]) for row in ROWS.values()) for line in rows)
        return 0.7 if good >= 2 and good >= 0.8 * len(rows) else 0.0

    def track(self) -> GnssTrack:
        """All positions of all files.

        Raises:
            InputError: if there are none, they are no positions on the earth, or two solutions are mixed.
        """
        read = self._read(self.paths)
        if read.fault is not None:
            raise read.fault
        return read.track

    def inspect(self) -> Inspection:
        """Read the first file through and say what it is and holds.

        Raises:
            InputError: if the file cannot be read.
        """
        read = self._read(self.paths[:1])
        track, header = read.track, read.rows.header
        facts: dict[str, Any] = {
            "program": header.program or "unknown",
            "positioning": header.mode or "unknown",
            "time_style": "week and seconds" if read.rows.time.shape[1] == 2 else "calendar",
            "time_scale": header.time or "not stated",
            "written_as": header.form.value,
            "lines_damaged": read.rows.damaged,
            "epochs": len(track),
            "epochs_without_position": read.without_position,
            "epochs_dropped": read.dropped,
        }
        clocks: tuple[ClockReading, ...] = ()
        if len(track):
            facts |= utc_facts(track.t_s)
            note = f"{header.time or 'taken as GPST'}; GPS time is {facts['gps_minus_utc_s']} s ahead of UTC"
            clocks = (ClockReading(Clock.GNSS, float(track.t_s[0]), float(track.t_s[-1]), note),)
        facts |= timing_facts(track.t_s) | position_facts(track)
        notices = list(self.notices)
        if read.fault is not None:
            fault = read.fault
            notices.append(Notice(fault.code, f"{fault.what} {fault.meaning} {fault.remedy}"))
        return Inspection(self.paths[0], self.format, self.title, facts, clocks, tuple(notices))

    def _read(self, paths: list[Path]) -> _Read:
        self.notices = []
        gathered, ends = None, []
        for path in paths:
            with Source(path) as source:
                gathered = read_rows(source, gathered)
                if source.fault:
                    self.notices.append(Notice("stream-cut", f"{path}: {source.fault}; what came before is used."))
            ends.append(gathered.lines)
        assert gathered is not None
        rows = finished(gathered)

        def place(k: int) -> str:
            line = int(rows.line[k])
            file = next(number for number, end in enumerate(ends) if line <= end)
            return f"{paths[file]}, line {line - (ends[file - 1] if file else 0)}"

        name = str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"
        if rows.damaged:
            self.notices.append(
                Notice(
                    "lines-damaged",
                    f"{name}: {rows.damaged} of {rows.lines} lines are neither comments nor whole rows and are not "
                    "used.",
                )
            )
        try:
            columns = _columns(rows, name, self.notices)
            usable = columns["fix"] != Fix.NONE
            usable &= np.isfinite(columns["t_s"] + columns["lon_deg"] + columns["lat_deg"])
            if not usable.any():
                raise _no_positions(rows, name)
            kept = np.flatnonzero(usable)
            if len(kept) > 1 and np.mean(np.diff(columns["t_s"][kept]) < 0) > MOST_AHEAD:
                kept = kept[::-1]
                self.notices.append(
                    Notice("written-backward", f"{name}: its times run back all through; it is read from its end.")
                )
            columns = {column: values[kept] for column, values in columns.items()}
            same = np.zeros(len(kept), bool)
            same[1:] = (np.diff(columns["lon_deg"]) == 0) & (np.diff(columns["lat_deg"]) == 0)
            forward, told = in_order(columns["t_s"], same, name, lambda k: place(int(kept[k])))
        except InputError as fault:
            return _Read(rows, GnssTrack.build(np.empty(0), source=name), 0, 0, fault)
        self.notices += told
        columns = {column: values[forward] for column, values in columns.items()}
        track = GnssTrack.build(columns.pop("t_s"), source=name, service=rows.header.service, **columns)
        self.notices += jump_notices(track)
        return _Read(rows, track, int(np.sum(~usable)), int(np.sum(~forward)), None)


@dataclass(frozen=True)
class _Read:
    rows: Rows
    track: GnssTrack
    without_position: int
    dropped: int
    fault: InputError | None


def _no_positions(rows: Rows, name: str) -> InputError:
    what = f"none of its {len(rows.line)} rows states a position" if len(rows.line) else "there is not one row in it"
    return InputError(
        f"{name}: {what}.",
        "The processor found no solution, or the file was cut behind its header.",
        "Look at the processor's settings and inputs, and let it write again.",
        code="no-positions",
    )


def _columns(rows: Rows, name: str, notices: list[Notice]) -> dict[str, NDArray[Any]]:
    """The columns of a track, and `t_s`; nan where a value cannot be."""
    header, values = rows.header, rows.values
    if header.form is Form.BASELINE:
        raise InputError(
            f"{name}: its positions are baselines from a base station (east, north, up), not coordinates.",
            "Without the base station's coordinates they lie nowhere on the earth.",
            "Let the processor write latitude, longitude and height (out-solformat = llh).",
            code="pos-baseline",
        )
    if len(rows.line) and not header.time:
        text = f"{name}: no header says whether its times are GPS time, UTC or JST; they are taken as GPS time."
        notices.append(Notice("time-scale-assumed", text))
    if header.form is Form.SEXAGESIMAL:
        values = np.column_stack([_sexagesimal(values[:, :3]), _sexagesimal(values[:, 3:6]), values[:, 6:]])
    lat, lon, height = values[:, 0], values[:, 1], values[:, 2]
    north, east, up = (_positive(values[:, k]) for k in (5, 6, 7))
    vn, ve = values[:, 13], values[:, 14]  # behind age and ratio, where velocities were asked for
    if header.form is Form.CARTESIAN:
        lon, lat, height = geodetic(values[:, :3])
        north, east, up = _turned_sigmas(values, lon, lat)
        vn = ve = np.full(len(values), np.nan)
    with np.errstate(invalid="ignore"):
        there = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0) & ~(np.abs(height) > 1e5)
        speed = np.hypot(vn, ve)
    if header.geodetic_height and len(values):
        height = np.full(len(values), np.nan)
        text = f"{name}: its heights are above the geoid (geodetic), so there is no ellipsoidal height."
        notices.append(Notice("no-ellipsoidal-height", text))
    quality = np.where((values[:, 3] >= 0) & (values[:, 3] <= 7), values[:, 3], 0).astype(np.int64)
    satellites = np.where((values[:, 4] >= 1) & (values[:, 4] <= 999), values[:, 4], -1)
    return {
        "t_s": _utc(rows),
        "lon_deg": np.where(there, lon, np.nan),
        "lat_deg": np.where(there, lat, np.nan),
        "height_m": height,
        "fix": np.array([FIXES.get(q, Fix.NONE) for q in range(8)], np.int8)[quality],
        "sigma_e_m": east,
        "sigma_n_m": north,
        "sigma_h_m": up,
        "speed_mps": speed,
        "course_deg": np.where(speed > 0.0, np.degrees(np.arctan2(ve, vn)) % 360.0, np.nan),
        "satellites": satellites.astype(np.int16),
        "age_s": values[:, 11] if np.any(values[:, 11] > 0.0) else np.full(len(values), np.nan),
    }


def _utc(rows: Rows) -> FloatArray:
    """UTC (n,) of the rows' times; nan where a calendar has no such day."""
    time = rows.time
    if time.shape[1] == 2:
        gps_s = time[:, 0] * WEEK_S + time[:, 1]
    else:
        year, month, day = (time[:, k].astype(np.int64) for k in range(3))
        usable = (year >= 1980) & (year < 2100) & (month >= 1) & (month <= 12) & (day >= 1)
        usable &= (time[:, 3] < 24) & (time[:, 4] < 60) & (time[:, 5] < 61)
        months = np.where(usable, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
        days = months.astype("datetime64[D]") + np.where(usable, day - 1, 0)
        usable &= days.astype("datetime64[M]") == months
        clock_s = days.astype(np.int64) * float(DAY_S) + time[:, 3] * HOUR_S + time[:, 4] * 60.0 + time[:, 5]
        gps_s = np.where(usable, clock_s - GPS_EPOCH_S, np.nan)
    scale = rows.header.time
    if scale in ("UTC", "JST"):
        return gps_s + GPS_EPOCH_S - (9 * HOUR_S if scale == "JST" else 0)
    known = np.isfinite(gps_s)
    return np.where(known, gps_to_utc_s(np.where(known, gps_s, 0.0)), np.nan)


def _positive(sigma: FloatArray) -> FloatArray:
    """Standard deviations that are stated."""
    return np.where(sigma > 0.0, sigma, np.nan)


def _sexagesimal(parts: FloatArray) -> FloatArray:
    """Degrees (n,) of degrees, minutes and seconds (n, 3), of which the first carries the sign."""
    size = np.abs(parts[:, 0]) + parts[:, 1] / 60.0 + parts[:, 2] / 3600.0
    return np.where(np.signbit(parts[:, 0]), -size, size)


def _turned_sigmas(values: FloatArray, lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standard deviations north, east and up of those in x, y, z.

    Off the diagonal stand square roots of covariances with the sign of those (RTKLIB manual, appendix B.1).
    """
    diagonal = values[:, 5:8] ** 2
    xy, yz, zx = (np.sign(values[:, k]) * values[:, k] ** 2 for k in (8, 9, 10))
    matrix = np.stack(
        [
            np.column_stack([diagonal[:, 0], xy, zx]),
            np.column_stack([xy, diagonal[:, 1], yz]),
            np.column_stack([zx, yz, diagonal[:, 2]]),
        ],
        axis=1,
    )
    turn = east_north_up(lon, lat)
    variance = np.einsum("nij,njk,nik->ni", turn, matrix, turn)
    with np.errstate(invalid="ignore"):
        sigma = np.where(variance > 0.0, np.sqrt(np.abs(variance)), np.nan)
    return sigma[:, 1], sigma[:, 0], sigma[:, 2]
