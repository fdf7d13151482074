"""Solution files (``.pos``) of RTKLIB, CLASLIB, MADOCALIB and others in the same format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import midnights_utc_s
from furrowmap.core.readers.position_log import LoggedPositions, PositionLog, file_at
from furrowmap.core.readers.reader import recording_name
from furrowmap.core.readers.rtklib.rows import ROWS, Form, Header, Rows, finished, read_rows
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import GPS_EPOCH_S, HOUR_S, WEEK_S, gps_to_utc_s
from furrowmap.core.values.earth import geodetic, variances_enu
from furrowmap.core.values.gnss import Fix

FloatArray = NDArray[np.float64]

FIXES: Final = {1: Fix.FIXED, 2: Fix.FLOAT, 3: Fix.DGPS, 4: Fix.DGPS, 5: Fix.SINGLE, 6: Fix.PPP, 7: Fix.ESTIMATED}
"""Quality of a position by its flag Q (fix, float, SBAS, DGPS, single, PPP, dead reckoning)."""
MOST_AHEAD: Final = 0.5
"""Share of steps back in time above which a solution was written from end to start."""


class RtklibPos(PositionLog):
    """The positions of a solution file, in either of its two time styles.

    Times are GPS time unless the header states UTC or JST. A standard deviation of 0, 0 satellites, and an age that is
    always 0 mean that they are unknown. Heights above the geoid are ignored. A solution that was written in reverse, by
    a backward filter, is reversed.

    Args:
        paths: the files of one recording, in the order of time.
        options: not used.
    """

    format: ClassVar[str] = "rtklib-pos"
    title: ClassVar[str] = "RTKLIB solution (.pos)"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with a header; likely if the first lines are rows."""
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

    def _read(self, paths: list[Path]) -> LoggedPositions:
        gathered, ends = None, []
        for source in self._sources(paths):
            gathered = read_rows(source, gathered)
            ends.append(gathered.lines)
        assert gathered is not None
        rows = finished(gathered)
        name = recording_name(paths)
        if rows.damaged:
            self.notices.append(Notice("lines-damaged", name=name, damaged=rows.damaged, lines=rows.lines))

        def place(row: int) -> str:
            path, line = file_at(paths, ends, int(rows.line[row]) - 1)
            return f"{path}, line {line + 1}"

        header = rows.header
        facts = {
            "program": header.program or "unknown",
            "positioning": header.mode or "unknown",
            "time_style": "week and seconds" if rows.time.shape[1] == 2 else "calendar",
            "time_scale": header.time or "not stated",
            "written_as": header.form.value,
            "lines_damaged": rows.damaged,
        }
        positions = _solutions(rows, name, place)
        return replace(positions, facts=facts, scale=header.time or "assumed to be GPST")


def _solutions(rows: Rows, name: str, place: Callable[[int], str]) -> LoggedPositions:
    """The positions of the rows; `place` describes where a row is in the files."""
    notices: list[Notice] = []
    try:
        columns = _columns(rows, name, notices)
        usable = columns["fix"] != Fix.NONE
        usable &= np.isfinite(columns["t_s"] + columns["lon_deg"] + columns["lat_deg"])
        if not usable.any():
            raise _no_positions(rows, name)
        kept = np.flatnonzero(usable)
        if len(kept) > 1 and np.mean(np.diff(columns["t_s"][kept]) < 0) > MOST_AHEAD:
            kept = kept[::-1]
            notices.append(Notice("written-backward", name=name))
    except InputError as fault:
        return replace(LoggedPositions.none(name, fault), notices=tuple(notices))
    return LoggedPositions.in_order(
        {column: values[kept] for column, values in columns.items()},
        lambda k: place(int(kept[k])),
        name=name,
        service=rows.header.service,
        without_position=int(np.sum(~usable)),
        notices=notices,
    )


def _no_positions(rows: Rows, name: str) -> InputError:
    return InputError("no-positions.no-positions-2", name=name, line=len(rows.line) or None)


def _columns(rows: Rows, name: str, notices: list[Notice]) -> dict[str, NDArray[Any]]:
    """The columns of a track, and `t_s`; nan where a value is invalid."""
    header, values = rows.header, rows.values
    if header.form is Form.BASELINE:
        raise InputError("pos-baseline", name=name)
    if len(rows.line) and not header.time:
        notices.append(Notice("time-scale-assumed", name=name))
    if header.form is Form.SEXAGESIMAL:
        values = np.column_stack([_sexagesimal(values[:, :3]), _sexagesimal(values[:, 3:6]), values[:, 6:]])
    lat, lon, height = values[:, 0], values[:, 1], values[:, 2]
    north, east, up = (_positive(values[:, k]) for k in (5, 6, 7))
    vn, ve = values[:, 13], values[:, 14]  # after age and ratio, if velocities were requested
    if header.form is Form.CARTESIAN:
        lon, lat, height = geodetic(values[:, :3])
        north, east, up = _turned_sigmas(values, lon, lat)
        vn = ve = np.full(len(values), np.nan)
    with np.errstate(invalid="ignore"):
        speed = np.hypot(vn, ve)
    if header.geodetic_height and len(values):
        height = np.full(len(values), np.nan)
        notices.append(Notice("no-ellipsoidal-height.columns", name=name))
    quality = np.where((values[:, 3] >= 0) & (values[:, 3] <= 7), values[:, 3], 0).astype(np.int64)
    satellites = np.where((values[:, 4] >= 1) & (values[:, 4] <= 999), values[:, 4], -1)
    return {
        "t_s": _utc(rows),
        "lon_deg": lon,
        "lat_deg": lat,
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
    """UTC (n,) of the rows' times; nan for invalid dates."""
    time = rows.time
    if time.shape[1] == 2:
        gps_s = time[:, 0] * WEEK_S + time[:, 1]
    else:
        usable = (time[:, 3] < 24) & (time[:, 4] < 60) & (time[:, 5] < 61)
        midnight_s = midnights_utc_s(*time[:, :3].T.astype(np.int64))
        clock_s = midnight_s + time[:, 3] * HOUR_S + time[:, 4] * 60.0 + time[:, 5]
        gps_s = np.where(usable, clock_s - GPS_EPOCH_S, np.nan)
    scale = rows.header.time
    if scale in ("UTC", "JST"):
        return gps_s + GPS_EPOCH_S - (9 * HOUR_S if scale == "JST" else 0)
    known = np.isfinite(gps_s)
    return np.where(known, gps_to_utc_s(np.where(known, gps_s, 0.0)), np.nan)


def _positive(sigma: FloatArray) -> FloatArray:
    """Standard deviations; nan if they are not stated."""
    return np.where(sigma > 0.0, sigma, np.nan)


def _sexagesimal(parts: FloatArray) -> FloatArray:
    """Degrees (n,) of degrees, minutes and seconds (n, 3); the degrees have the sign."""
    size = np.abs(parts[:, 0]) + parts[:, 1] / 60.0 + parts[:, 2] / 3600.0
    return np.where(np.signbit(parts[:, 0]), -size, size)


def _turned_sigmas(values: FloatArray, lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standard deviations north, east and up from those in x, y, z.

    The values off the diagonal are square roots of covariances, with their sign (RTKLIB manual, appendix B.1).
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
    variance = variances_enu(matrix, lon, lat)
    with np.errstate(invalid="ignore"):
        sigma = np.where(variance > 0.0, np.sqrt(np.abs(variance)), np.nan)
    return sigma[:, 1], sigma[:, 0], sigma[:, 2]
