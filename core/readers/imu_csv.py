"""Inertial measurements in CSV, with units in the column names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.attitude_csv import LEVEL, NORTHS, AttitudeCsv
from furrowmap.core.readers.csv_header import columns_of, head_columns
from furrowmap.core.readers.csv_numbers import complete_rows, pieces
from furrowmap.core.readers.imu_check import imu_notices
from furrowmap.core.readers.inertial_rows import first_beyond, inertial_facts, inertial_track, joined_name
from furrowmap.core.readers.iso_times import tied_to_utc, with_unix_times
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.readers.time_scale import utc_of
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.attitude import AttitudeTrack
from furrowmap.core.values.clock_readings import ClockReading
from furrowmap.core.values.inertial import STANDARD_GRAVITY_MPS2, InertialTrack
from furrowmap.core.values.scan import Clock

FloatArray = NDArray[np.float64]

TIMES: Final = {"time_unix_s": "unix", "time_gps_s": "gps"}
RATES: Final = {"dps": np.pi / 180.0, "deg_s": np.pi / 180.0, "radps": 1.0, "rad_s": 1.0}
FORCES: Final = {"mps2": 1.0, "m_s2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2}
"""Units at the end of a column's name, and their factors to rad/s and m/s²."""
NAMES: Final = {"rate": ("gyro", "rate", "gyr"), "force": ("force", "accel", "acc")}
"""Begins of the columns' names."""
ISO: Final = "iso"
"""Date and time of day, ISO 8601."""
UNITS: Final = {
    "time": {
        "unix_s": 1.0,
        "unix_ms": 1e-3,
        "unix_us": 1e-6,
        "unix_ns": 1e-9,
        "gps_s": 1.0,
        "gps_ms": 1e-3,
        ISO: 1.0,
        "s": 1.0,
        "ms": 1e-3,
        "us": 1e-6,
    },
    "utc": {ISO: 1.0},
    "gyro": {"deg/s": np.pi / 180.0, "rad/s": 1.0, "mdeg/s": 1e-3 * np.pi / 180.0, "mrad/s": 1e-3},
    "force": {"m/s2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2},
}
QUANTITIES: Final = ("time", *(f"{kind}_{axis}" for kind in ("gyro", "force") for axis in "xyz"))
"""Quantities and units of `[imu.columns]`, and the factors of the units to s, rad/s and m/s². Beside them `utc`, which
a time of the device's own clock (s, ms, us) needs."""
_OWN: Final = ("s", "ms", "us")


class ImuCsv(FileReader):
    """Angular rate and specific force from CSV files.

    The columns are `time_unix_s` (UTC) or `time_gps_s`, three of the angular rate such as `gyro_x_dps` and three of the
    specific force such as `force_x_mps2`: `gyro`, `gyr` or `rate` with `dps`, `deg_s`, `radps` or `rad_s`, and `force`,
    `accel` or `acc` with `mps2`, `m_s2`, `g` or `mg`. Rows with an empty field are dropped with a notice.
    """

    format: ClassVar[str] = "imu-csv"
    title: ClassVar[str] = "inertial measurements in CSV"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of time, angular rate and specific force."""
        names = head_columns(head) or []
        if not set(names) & set(TIMES):
            return 0.0
        found = sum(_column(names, kind, axis) is not None for kind in NAMES for axis in "xyz")
        return {6: 1.0, 5: 0.7, 4: 0.7, 3: 0.7}.get(found, 0.0)

    def inertial(self) -> InertialTrack:
        """All measurements of all files.

        Raises:
            InputError: if a file has no such columns, a field is no number, or the times do not increase.
        """
        parts = [self._read(path) for path in self.paths]
        t_s, values = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        return inertial_track(t_s, values, joined_name(self.paths), self.notices)

    def inspect(self) -> Inspection:
        """Read the whole first file and report rates, span, and the mean of the specific force.

        Raises:
            InputError: as :meth:`inertial`.
        """
        reader = ImuCsv(self.paths[:1], self.options)
        track = reader.inertial()
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), "from its time column")
        with Source(self.paths[0]) as source:
            names, _ = columns_of(next(pieces(source, []), b"").decode("utf-8", "replace"))
        angles = [name for name in names if name in (*LEVEL, *NORTHS)]
        facts = {**inertial_facts(track), "attitude": angles or "none"}
        notices = (*reader.notices, *imu_notices(track))
        return Inspection(self.paths[0], self.format, self.title, facts, (clock,), notices)

    def attitude(self) -> AttitudeTrack:
        """The attitudes in columns beside the measurements, as in an attitude log.

        Raises:
            InputError: if there are none, or as :meth:`inertial`.
        """
        log = AttitudeCsv(self.paths, self.options)
        track = log.attitude()
        self.notices += [notice for notice in log.notices if notice not in self.notices]
        return track

    def _read(self, path: Path) -> tuple[FloatArray, FloatArray]:
        """UTC (n,), and angular rate and specific force (n, 6)."""
        with Source(path) as source:
            lines = pieces(source, self.notices)
            names, separator = columns_of(next(lines, b"").decode("utf-8", "replace"))
            stated = self.options.columns
            columns = _Columns.stated(names, stated, path) if stated else _Columns.of(names, path)
            if columns.iso:
                lines = with_unix_times(lines, (names, separator), columns.iso, path)
            wanted = (*columns.names, *columns.utc)
            rows = complete_rows(source, lines, (names, separator), wanted, self.notices, len(columns.names))
        utc_s, rows = rows[:, len(columns.names) :], rows[:, : len(columns.names)]
        values = rows[:, 1:] * columns.factors
        rows[:, 0] *= columns.seconds
        beyond = first_beyond(values)
        if beyond is not None:
            count, row, first = beyond
            raise InputError(
                "value-out-of-range.read",
                path=path,
                count=count,
                rows=rows[row, first + 1 : first + 4].tolist(),
                names=columns.names[first + 1],
            )
        if columns.utc:
            return tied_to_utc(rows[:, 0], utc_s[:, 0], str(path), self.notices), values
        return utc_of(rows[:, 0], columns.scale, str(path), self.options), values


@dataclass(frozen=True)
class _Columns:
    """The columns to read.

    Attributes:
        names: of time, angular rate, specific force.
        scale: of the time.
        factors: (6,) to rad/s and m/s².
        seconds: the unit of the time.
        utc: the column that ties the device's own clock to UTC, if there is one.
        iso: columns of ISO 8601.
    """

    names: tuple[str, ...]
    scale: str
    factors: FloatArray
    seconds: float = 1.0
    utc: tuple[str, ...] = ()
    iso: tuple[str, ...] = ()

    @classmethod
    def stated(cls, names: Sequence[str], stated: Mapping[str, tuple[str, str, float]], path: Path) -> _Columns:
        """The columns that the session states."""
        found: dict[str, tuple[str, str, float]] = {}
        for name, (quantity, unit, scale) in stated.items():
            known = UNITS.get(quantity.partition("_")[0], {}) if quantity in (*QUANTITIES, "utc") else {}
            if name not in names:
                near = get_close_matches(name, names, 3, 0.4) or list(names[:8])
                raise _bad_columns(f"{path}, line 1: no column {name!r}", f"There are {', '.join(near)}.")
            if quantity not in (*QUANTITIES, "utc"):
                what = f"`imu.columns`: {name!r} is stated to be {quantity!r}"
                raise _bad_columns(what, f"Quantities are {', '.join(QUANTITIES)}, utc.")
            if unit not in known:
                what = f"`imu.columns`: {name!r} ({quantity}) is stated in {unit!r}"
                raise _bad_columns(what, f"Units of it are {', '.join(known)}.")
            if quantity in found:
                raise _bad_columns(
                    f"`imu.columns`: {found[quantity][0]!r} and {name!r} are both {quantity}", "State one."
                )
            found[quantity] = (name, unit, scale)
        missing = [quantity for quantity in QUANTITIES if quantity not in found]
        if missing:
            raise _bad_columns(f"`imu.columns` has no {', '.join(missing)}", "State the column of each.")
        time, unit, _ = found["time"]
        if (unit in _OWN) != ("utc" in found):
            other = "a" if "utc" in found else "no"
            what = f"`imu.columns`: the time {time!r} is in {unit!r}, and {other} column is `utc`"
            raise _bad_columns(what, f"A device's own clock ({', '.join(_OWN)}) needs a column of `utc`, others none.")
        utc = (found["utc"][0],) if "utc" in found else ()
        iso = (*utc, *((time,) if unit == ISO else ()))
        axes = [found[quantity] for quantity in QUANTITIES[1:]]
        factors = [
            scale * UNITS[quantity.partition("_")[0]][unit]
            for quantity, (_, unit, scale) in zip(QUANTITIES[1:], axes, strict=True)
        ]
        scale_name = "gps" if unit.startswith("gps") else "unix"
        return cls((time, *(name for name, _, _ in axes)), scale_name, np.array(factors), UNITS["time"][unit], utc, iso)

    @classmethod
    def of(cls, names: Sequence[str], path: Path) -> _Columns:
        time = next((name for name in TIMES if name in names), None)
        found = [(kind, axis, _column(names, kind, axis)) for kind in NAMES for axis in "xyz"]
        missing = [f"{NAMES[kind][0]}_{axis}" for kind, axis, column in found if column is None]
        if time is None or missing:
            raise InputError(
                "missing-column.of", path=path, values=", ".join([*missing, *(["time_unix_s"] if time is None else [])])
            )
        units = [(RATES if kind == "rate" else FORCES)[column[1]] for kind, _, column in found if column is not None]
        return cls((time, *(c[0] for _, _, c in found if c is not None)), TIMES[time], np.array(units))


def _bad_columns(what: str, remedy: str) -> InputError:
    return InputError("imu-columns", what=what, remedy=remedy)


def _column(names: Sequence[str], kind: str, axis: str) -> tuple[str, str] | None:
    """The column of an axis, and its unit."""
    units = RATES if kind == "rate" else FORCES
    wanted = {f"{start}_{axis}_{unit}": unit for start in NAMES[kind] for unit in units}
    return next(((name, wanted[name]) for name in names if name in wanted), None)
