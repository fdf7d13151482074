"""Inertial measurements in CSV, with units in the column names or stated by the session."""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import ClassVar, Final

import numpy as np

from furrowmap.core.readers.attitude_csv import LEVEL_COLUMNS, NORTHS, AttitudeCsv
from furrowmap.core.readers.csv_file import TIME_COLUMN, TIMES, Column, CsvFile, head_columns
from furrowmap.core.readers.epochs import utc_of
from furrowmap.core.readers.inertial_rows import (
    MAX_FORCE_MPS2,
    MAX_RATE_RADPS,
    imu_notices,
    inertial_facts,
    inertial_track,
    inspected_track,
)
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head, look
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.inertial import FORCE_UNITS, RATE_UNITS, UNITS_OF_FORMAT, InertialTrack, StatedUnits
from furrowmap.core.values.pose_track import AttitudeTrack
from furrowmap.core.values.scan import Clock, ClockReading

_LIMITS: Final = {"gyro": MAX_RATE_RADPS, "force": MAX_FORCE_MPS2}
_RATES: Final = {
    "dps": RATE_UNITS["deg/s"],
    "deg_s": RATE_UNITS["deg/s"],
    "radps": RATE_UNITS["rad/s"],
    "rad_s": RATE_UNITS["rad/s"],
}
_FORCES: Final = {
    "mps2": FORCE_UNITS["m/s2"],
    "m_s2": FORCE_UNITS["m/s2"],
    "g": FORCE_UNITS["g"],
    "mg": FORCE_UNITS["mg"],
}
_COLUMN_NAMES: Final = {"gyro": (("gyro", "rate", "gyr"), _RATES), "force": (("force", "accel", "acc"), _FORCES)}
"""Begins of the columns' names, and the units at their ends with the factors to rad/s and m/s²."""


def imu_schema(stated: StatedUnits) -> tuple[Column, ...]:
    """The columns of time, angular rate and specific force, with units by their names or as stated instead."""
    columns = [TIME_COLUMN]
    for kind, (begins, units) in _COLUMN_NAMES.items():
        factors = {unit: stated.factors(factor, factor)[kind == "force"] for unit, factor in units.items()}
        for axis in "xyz":
            names = {f"{begin}_{axis}_{unit}": factor for begin in begins for unit, factor in factors.items()}
            columns.append(Column(names, (-_LIMITS[kind], _LIMITS[kind])))
    return tuple(columns)


IMU_SCHEMA: Final = imu_schema(UNITS_OF_FORMAT)
ISO: Final = "iso"
"""Date and time of day, ISO 8601."""
STATED_UNITS: Final = {
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
    "gyro": RATE_UNITS,
    "force": FORCE_UNITS,
}
QUANTITIES: Final = ("time", *(f"{kind}_{axis}" for kind in ("gyro", "force") for axis in "xyz"))
"""Quantities and units of `[imu.columns]`, and the factors of the units to s, rad/s and m/s². Beside them `utc`, which
a time of the device's own clock (s, ms, us) needs."""
_OWN: Final = ("s", "ms", "us")
MIN_UTC_CHANGES: Final = 2
MEASURED_SCATTER_S: Final = 0.05
"""UTC that agrees with the device's clock within this is one of measurement, not of arrival."""


class ImuCsv(FileReader):
    """Angular rate and specific force from CSV files.

    The columns are `time_unix_s` (UTC) or `time_gps_s`, three of the angular rate such as `gyro_x_dps` and three of the
    specific force such as `force_x_mps2`: `gyro`, `gyr` or `rate` with `dps`, `deg_s`, `radps` or `rad_s`, and `force`,
    `accel` or `acc` with `mps2`, `m_s2`, `g` or `mg`. Rows with an empty field are dropped with a notice.
    """

    format: ClassVar[str] = "imu-csv"
    title: ClassVar[Text] = Text("inertial measurements in CSV")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of time, angular rate and specific force."""
        names = head_columns(head)
        if not set(names) & set(TIMES):
            return 0.0
        found = sum(not column.names.keys().isdisjoint(names) for column in IMU_SCHEMA[1:])
        return {6: 1.0, 5: 0.7, 4: 0.7, 3: 0.7}.get(found, 0.0)

    def inertial(self) -> InertialTrack:
        """All measurements of all files.

        InputError if columns are missing, fields no numbers, or times do not increase.
        """
        return self._inertial(self.options.units)

    def _inertial(self, units: StatedUnits) -> InertialTrack:
        parts = [self._read(path, units) for path in self.paths]
        t_s, values = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        track, late = inertial_track(t_s, values, self.name)
        self.notices += late
        return track

    def inspect(self) -> Inspection:
        """Read the whole first file and report rates, span, and the mean of the specific force."""
        reader = ImuCsv(self.paths[:1], self.options)
        track = inspected_track(reader._inertial, self.options.units)
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), "from its time column")
        angles = [name for name in head_columns(look(self.paths[0])) if name in (*LEVEL_COLUMNS, *NORTHS)]
        facts = {**inertial_facts(track), "attitude": angles or "none"}
        notices = (*dict.fromkeys(reader.notices), *imu_notices(track))
        return Inspection(self.paths[0], self.format, self.title, facts, (clock,), notices)

    def attitude(self) -> AttitudeTrack:
        """The attitudes in columns beside the measurements, as in an attitude log; InputError if there are none."""
        log = AttitudeCsv(self.paths, self.options)
        track = log.attitude()
        self._add_notices(*log.notices)
        return track

    def _read(self, path: Path, units: StatedUnits) -> tuple[FloatArray, FloatArray]:
        """UTC (n,), and angular rate and specific force (n, 6)."""
        with CsvFile(path) as file:
            schema = imu_schema(units)
            scale = file.time_scale
            if self.options.columns:
                if units != UNITS_OF_FORMAT:
                    what = Text(
                        "`imu.columns` states units and scales, and so do `imu.rate_unit` and the keys beside it"
                    )
                    raise _bad_columns(what, Text("Leave the latter out."))
                schema, scale = _stated_schema(file.written, self.options.columns, path)
            rows = file.rows(schema, "missing-column.of-measurements", "value-out-of-range.imu-columns")
        self._add_notices(*file.notices)
        if len(schema) > len(IMU_SCHEMA):
            t_s, tied = _tie_to_utc(rows[:, 0], rows[:, 7], str(path))
            self.notices.append(tied)
            return t_s, rows[:, 1:7]
        return utc_of(rows[:, 0], scale, str(path), self.options), rows[:, 1:]


def _stated_schema(
    names: Sequence[str], stated: Mapping[str, tuple[str, str, float]], path: Path
) -> tuple[tuple[Column, ...], str]:
    """The columns that a session states, those of :data:`IMU_SCHEMA` and perhaps UTC, and the scale of the time."""
    found: dict[str, tuple[str, str, float]] = {}
    for name, (quantity, unit, scale) in stated.items():
        known = STATED_UNITS.get(quantity.partition("_")[0], {}) if quantity in (*QUANTITIES, "utc") else {}
        if name not in names:
            near = get_close_matches(name, names, 3, 0.4) or list(names[:8])
            raise _bad_columns(
                Text("{path}, line 1: no column {name!r}", path=path, name=name), Text("There are {near}.", near=near)
            )
        if quantity not in (*QUANTITIES, "utc"):
            what = Text("`imu.columns`: {name!r} is stated to be {quantity!r}", name=name, quantity=quantity)
            raise _bad_columns(what, Text("Quantities are {known}.", known=(*QUANTITIES, "utc")))
        if unit not in known:
            what = Text(
                "`imu.columns`: {name!r} ({quantity}) is stated in {unit!r}", name=name, quantity=quantity, unit=unit
            )
            raise _bad_columns(what, Text("Units of it are {known}.", known=tuple(known)))
        if quantity in found:
            what = Text(
                "`imu.columns`: {first!r} and {name!r} are both {quantity}",
                first=found[quantity][0],
                name=name,
                quantity=quantity,
            )
            raise _bad_columns(what, Text("State one."))
        found[quantity] = (name, unit, scale)
    missing = [quantity for quantity in QUANTITIES if quantity not in found]
    if missing:
        raise _bad_columns(Text("`imu.columns` has no {missing}", missing=missing), Text("State the column of each."))
    time, unit, _ = found["time"]
    if (unit in _OWN) != ("utc" in found):
        what = Text(
            "`imu.columns`: the time {time!r} is in {unit!r}, and {utc:a|no} column is `utc`",
            time=time,
            unit=unit,
            utc="utc" in found,
        )
        remedy = Text("A device's own clock ({units}) needs a column of `utc`, others none.", units=tuple(_OWN))
        raise _bad_columns(what, remedy)
    schema = [Column({time: STATED_UNITS["time"][unit]}, iso=unit == ISO)]
    for quantity in QUANTITIES[1:]:
        name, axis_unit, scale = found[quantity]
        kind = quantity.partition("_")[0]
        schema.append(Column({name: scale * STATED_UNITS[kind][axis_unit]}, (-_LIMITS[kind], _LIMITS[kind])))
    if "utc" in found:
        schema.append(Column({found["utc"][0]: 1.0}, sparse=True, iso=True))
    return tuple(schema), "gps" if unit.startswith("gps") else "unix"


def _bad_columns(what: Words, remedy: Words) -> InputError:
    return InputError("imu-columns", what=what, remedy=remedy)


def _tie_to_utc(clock_s: FloatArray, utc_s: FloatArray, name: str) -> tuple[FloatArray, Notice]:
    """UTC (n,) of a device's own clock (n,) by a column of UTC (n,) that changes now and then; median over changes."""
    known = np.isfinite(utc_s)
    at = np.flatnonzero(known)
    changes = at[1:][np.diff(utc_s[at]) > 0]
    if len(changes) < MIN_UTC_CHANGES:
        raise InputError("not-a-time.tied-to-utc", name=name, changes=len(changes))
    offset = utc_s[changes] - clock_s[changes]
    middle = float(np.median(offset))
    scatter = float(np.median(np.abs(offset - middle)))
    tied = Notice(
        "imu-clock-tied", name=name, changes=len(changes), is_scatter=scatter < MEASURED_SCATTER_S, scatter_s=scatter
    )
    return clock_s + middle, tied
