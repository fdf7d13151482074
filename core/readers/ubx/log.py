"""Logs of u-blox receivers: NAV-PVT, NAV-HPPOSLLH and NAV-COV, with what else belongs to their epochs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import in_order, midnights_utc_s, no_week, week_times
from furrowmap.core.readers.frames import BYTES, Records, Scan, Tally, at_equal, layout, paired
from furrowmap.core.readers.position_log import Positions
from furrowmap.core.readers.receiver_log import ReceiverLog, sound
from furrowmap.core.readers.source import Head
from furrowmap.core.readers.ubx.frames import scan
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s, nearest_in_cycle, utc_to_gps_s
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix, GnssTrack

FloatArray = NDArray[np.float64]

PVT, HPPOSLLH, COV, DOP, STATUS, TIMEGPS, TIMEUTC, RAWX, RELPOSNED = (
    0x0107, 0x0114, 0x0136, 0x0104, 0x0103, 0x0120, 0x0121, 0x0215, 0x013C,
)  # fmt: skip
"""Class and id of the messages that are read."""
LAYOUTS: Final = {
    PVT: layout(
        84, itow=(0, "u4"), year=(4, "u2"), month=(6, "u1"), day=(7, "u1"), hour=(8, "u1"), minute=(9, "u1"),
        second=(10, "u1"), valid=(11, "u1"), nano=(16, "i4"), kind=(20, "u1"), flags=(21, "u1"), satellites=(23, "u1"),
        lon=(24, "i4"), lat=(28, "i4"), height=(32, "i4"), h_acc=(40, "u4"), v_acc=(44, "u4"), speed=(60, "i4"),
        course=(64, "i4"), flags3=(78, "u2"),
    ),
    HPPOSLLH: layout(
        36, flags=(3, "u1"), itow=(4, "u4"), lon=(8, "i4"), lat=(12, "i4"), height=(16, "i4"), lon_hp=(24, "i1"),
        lat_hp=(25, "i1"), height_hp=(26, "i1"), h_acc=(28, "u4"), v_acc=(32, "u4"),
    ),
    COV: layout(64, itow=(0, "u4"), valid=(5, "u1"), nn=(16, "f4"), ee=(28, "f4"), dd=(36, "f4")),
    DOP: layout(18, itow=(0, "u4"), hdop=(12, "u2")),
    STATUS: layout(16, itow=(0, "u4"), kind=(4, "u1"), flags=(5, "u1"), flags2=(7, "u1")),
    TIMEGPS: layout(16, itow=(0, "u4"), week=(8, "i2"), valid=(11, "u1")),
    TIMEUTC: layout(
        20, itow=(0, "u4"), year=(12, "u2"), month=(14, "u1"), day=(15, "u1"), hour=(16, "u1"), minute=(17, "u1"),
        second=(18, "u1"), valid=(19, "u1"),
    ),
    RAWX: layout(16, tow=(0, "f8"), week=(8, "u2")),
    RELPOSNED: layout(64, version=(0, "u1"), itow=(4, "u4"), heading=(24, "i4"), flags=(60, "u4")),
}  # fmt: skip
"""What is read of each message: the part that all protocol versions have."""

AGE_S: Final = np.array([np.nan, 1, 2, 5, 10, 15, 20, 30, 45, 60, 90, 120, 120, 120, 120, 120], np.float64)
"""Age of corrections by its class in NAV-PVT: the end of the class, and 120 s for all beyond."""
_FIXED_HEADING: Final = 0b1_0011_1101, 0b1_0011_0101
"""Flags of NAV-RELPOSNED, and what they are where a moving base shows a heading with ambiguities fixed: heading and
position valid, moving, carrier solution 2, fix within the receiver's limits."""
LEAST_SHARE: Final = 0.02
"""Share of UBX bytes from which on a file without positions is told to be a UBX log."""
_DEAD_RECKONING, _2D, _3D, _COMBINED = 1, 2, 3, 4
_KINDS: Final = {0: "none", 1: "dead reckoning", 2: "2D", 3: "3D", 4: "GNSS and dead reckoning", 5: "time only"}


class UbxLog(ReceiverLog):
    """The positions in a log of u-blox messages.

    NAV-PVT makes the epoch; NAV-HPPOSLLH adds digits, NAV-COV standard deviations, NAV-DOP the dilution, each joined by
    its equal time of the week. NAV-RELPOSNED gives the heading of two antennas, from a base that moves along to the
    rover whose log it is, where its ambiguities are fixed; where on the vehicle they stand it does not know. Without
    NAV-COV the horizontal accuracy estimate is shared by east and north. A log with NAV-HPPOSLLH alone has no date, and
    no kind of fix but by NAV-STATUS. Heights are above the ellipsoid.
    """

    format: ClassVar[str] = "ubx"
    title: ClassVar[str] = "u-blox UBX log"
    messages: ClassVar[str] = "messages"
    layouts: ClassVar[Mapping[int, np.dtype[np.void]]] = LAYOUTS
    find: ClassVar[Scan] = staticmethod(scan)

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with NAV-PVT; likely with NAV-HPPOSLLH; possible where there are other UBX messages."""
        if b"\xb5\x62" not in head.data:
            return 0.0
        frames, counts, _ = scan(np.frombuffer(head.data, np.uint8), True)  # noqa: FBT003
        kinds = set(frames[:, 0].tolist())
        if PVT in kinds:
            return 0.95
        if HPPOSLLH in kinds:
            return 0.85  # less than NMEA with its date
        return 0.3 if counts[BYTES] >= LEAST_SHARE * len(head.data) else 0.0

    def _names(self, kinds: Sequence[int]) -> dict[int, str]:
        from pyubx2 import UBX_MSGIDS

        codes = {kind: bytes((kind >> 8, kind & 255)) for kind in kinds}
        return {kind: UBX_MSGIDS.get(code, f"{code[0]:02X}-{code[1]:02X}") for kind, code in codes.items()}

    def _epochs(
        self, records: Mapping[int, Records], tally: Tally, name: str, place: Callable[[int], str]
    ) -> Positions:
        pvt, hp = records[PVT], records[HPPOSLLH]
        if not len(pvt) and not len(hp):
            return Positions.none(name, self._no_positions(tally, name))
        notices: list[Notice] = []
        base = pvt if len(pvt) else hp
        columns = _of_pvt(pvt) if len(pvt) else _of_hpposllh(hp, records[STATUS], notices, name)
        key = base.values["itow"].astype(np.int64)
        _refine(columns, key, records, notices, name, both=len(pvt) > 0)
        facts: dict[str, Any] = {}
        if len(pvt):
            count = np.bincount(pvt.values["kind"], minlength=6)
            facts["kinds_of_fix"] = {words: int(count[kind]) for kind, words in _KINDS.items() if count[kind]}
        positioned = (columns["fix"] != Fix.NONE) & sound(columns)
        without = int(np.sum(~positioned))
        if not positioned.any():
            return Positions.none(
                name,
                InputError(
                    f"{name}: none of its {len(base)} messages on the position states one (the receiver had no fix, or "
                    "called it invalid).",
                    "There is nothing to place scans with, and nothing to evaluate.",
                    "Record under open sky; `furrowmap inspect` tells the kinds of fix.",
                    code="no-positions",
                ),
                without_position=without,
            )
        columns = {column: values[positioned] for column, values in columns.items()}
        at, tow_s = base.at[positioned], key[positioned] / 1000.0
        try:
            t_s = self._times(columns.pop("utc_s"), tow_s, at, records, name)
            dated = t_s is not None
            times = tow_s if t_s is None else t_s
            forward, told = in_order(times, columns["lon_deg"], columns["lat_deg"], name, lambda k: place(int(at[k])))
        except InputError as fault:
            return Positions.none(name, fault, without_position=without)
        columns = {column: values[forward] for column, values in columns.items()}
        track = GnssTrack.build(times[forward], source=name, service="", **columns)
        return Positions(
            track=track,
            dated=dated,
            without_position=without,
            dropped=int(np.sum(~forward)),
            facts=facts,
            notices=(*notices, *told),
            fault=None if dated else no_week(tow_s, name),
        )

    def _times(
        self,
        utc_s: FloatArray,
        tow_s: FloatArray,
        at: NDArray[np.int64],
        records: Mapping[int, Records],
        name: str,
    ) -> FloatArray | None:
        """UTC (n,): of the calendar where the receiver knows it, else of the time of the week; None without a week."""
        dated_s, dated_at = _dated(records)
        if len(dated_s):
            before = np.clip(np.searchsorted(dated_at, at, side="right") - 1, 0, None)
            gps_s: FloatArray | None = nearest_in_cycle(tow_s, dated_s[before], WEEK_S)
        else:
            gps_s = week_times(tow_s, self.options, name)
        if gps_s is None:
            return None if not np.isfinite(utc_s).all() else utc_s
        return np.where(np.isfinite(utc_s), utc_s, gps_to_utc_s(gps_s))

    def _no_positions(self, tally: Tally, name: str) -> InputError:
        names = self._names([kind for kind, _ in tally.kinds.most_common(4)])
        raw = RAWX in tally.kinds
        held = f"its messages are {', '.join(names.values())}" if names else "not one of its messages is intact"
        return InputError(
            f"{name}: a UBX log without positions ({held}).",
            "It holds raw observations, which have to be processed first."
            if raw
            else "Positions stand in NAV-PVT or NAV-HPPOSLLH, and neither is there.",
            "Process the observations with RTKLIB or CLASLIB and give the .pos file."
            if raw
            else "Let the receiver write NAV-PVT (and NAV-HPPOSLLH, NAV-COV), or NMEA with GGA.",
            code="no-positions",
        )


def _of_pvt(pvt: Records) -> dict[str, NDArray[Any]]:
    """The columns of NAV-PVT; the kind of fix as the receiver's own GGA would say it.

    (u-blox F9 HPG interface description, "Position fix flags in NMEA": a fix outside the limits the user set is none.)
    """
    kind, flags, flags3 = (pvt.values[field] for field in ("kind", "flags", "flags3"))
    within, differential, carrier = (flags & 1) > 0, (flags & 2) > 0, flags >> 6
    positioned = np.isin(kind, (_2D, _3D, _COMBINED)) & within & ((flags3 & 1) == 0)
    fix = np.select(
        [
            (kind == _DEAD_RECKONING) & ((flags3 & 1) == 0),
            ~positioned,
            carrier == 2,
            carrier == 1,
            differential,
        ],
        [Fix.ESTIMATED, Fix.NONE, Fix.FIXED, Fix.FLOAT, Fix.DGPS],
        Fix.SINGLE,
    )
    sigma_m = pvt.column("h_acc", 1e-3) / np.sqrt(2.0)
    return {
        "utc_s": _calendar(pvt, 0b111) + pvt.column("nano", 1e-9),
        "lon_deg": pvt.column("lon") / 1e7,
        "lat_deg": pvt.column("lat") / 1e7,
        "height_m": pvt.column("height") / 1e3,
        "fix": fix.astype(np.int8),
        "sigma_e_m": sigma_m,
        "sigma_n_m": sigma_m.copy(),
        "sigma_h_m": pvt.column("v_acc", 1e-3),
        "speed_mps": pvt.column("speed", 1e-3),
        "course_deg": pvt.column("course", 1e-5) % 360.0,
        "satellites": pvt.values["satellites"].astype(np.int16),
        "hdop": np.full(len(pvt), np.nan),
        "age_s": AGE_S[(flags3 >> 1) & 15],
    }


def _of_hpposllh(hp: Records, status: Records, notices: list[Notice], name: str) -> dict[str, NDArray[Any]]:
    """The columns of NAV-HPPOSLLH alone, with the kind of fix of NAV-STATUS."""
    key, of = hp.values["itow"].astype(np.int64), status.values["itow"].astype(np.int64)
    row, other = paired(key, of)
    kind, flags, carrier = (status.values[field][other] for field in ("kind", "flags", "flags2"))
    fix = np.full(len(hp), Fix.SINGLE, np.int8)
    fix[row] = np.select(
        [~np.isin(kind, (1, 2, 3, 4)) | ((flags & 1) == 0), carrier >> 6 == 2, carrier >> 6 == 1, (flags & 2) > 0],
        [Fix.NONE, Fix.FIXED, Fix.FLOAT, Fix.DGPS],
        Fix.SINGLE,
    )
    if len(row) < len(hp):
        notices.append(
            Notice(
                "fix-unknown",
                f"{name}: {len(hp) - len(row)} of {len(hp)} positions (NAV-HPPOSLLH) come without NAV-PVT or "
                "NAV-STATUS, so their kind of fix is unknown; they are taken as single. Their stated accuracy counts.",
            )
        )
    fix[(hp.values["flags"] & 1) > 0] = Fix.NONE
    nothing = np.full(len(hp), np.nan)
    return {
        "utc_s": nothing,
        "fix": fix,
        "lon_deg": hp.column("lon") / 1e7,
        "lat_deg": hp.column("lat") / 1e7,
        "height_m": hp.column("height") / 1e3,
        "sigma_e_m": nothing.copy(),
        "sigma_n_m": nothing.copy(),
        "sigma_h_m": nothing.copy(),
        "hdop": nothing.copy(),
    }


def _refine(
    columns: dict[str, NDArray[Any]],
    key: NDArray[np.int64],
    records: Mapping[int, Records],
    notices: list[Notice],
    name: str,
    *,
    both: bool,
) -> None:
    """Put what NAV-HPPOSLLH, NAV-COV and NAV-DOP know of an epoch in the place of what NAV-PVT does."""

    def take(column: str, kind: int, values: FloatArray, usable: NDArray[np.bool_]) -> None:
        other = records[kind][usable]
        found = at_equal(key, other.values["itow"].astype(np.int64), values[usable])
        columns[column] = np.where(np.isfinite(found), found, columns[column])

    hp, cov = records[HPPOSLLH], records[COV]
    valid = (hp.values["flags"] & 1) == 0
    # Whole units and the hundredths behind them, added as integers: a float64 holds the sum exactly.
    for column, unit in (("lon_deg", 1e9), ("lat_deg", 1e9)):
        part = column[:3]
        take(column, HPPOSLLH, (hp.column(part, 100.0) + hp.column(f"{part}_hp")) / unit, valid)
    take("height_m", HPPOSLLH, (hp.column("height", 10.0) + hp.column("height_hp")) / 1e4, valid)
    for column in ("sigma_e_m", "sigma_n_m"):
        take(column, HPPOSLLH, hp.column("h_acc", 1e-4) / np.sqrt(2.0), valid)
    take("sigma_h_m", HPPOSLLH, hp.column("v_acc", 1e-4), valid)
    stated = (cov.values["valid"] == 1) & np.isfinite(cov.values["nn"]) & np.isfinite(cov.values["ee"])
    for column, field in (("sigma_e_m", "ee"), ("sigma_n_m", "nn"), ("sigma_h_m", "dd")):
        take(column, COV, np.sqrt(np.abs(cov.column(field))), stated)
    columns["heading_deg"] = np.full(len(key), np.nan)
    base = records[RELPOSNED]
    shown = (base.values["version"] >= 1) & ((base.values["flags"] & _FIXED_HEADING[0]) == _FIXED_HEADING[1])
    take("heading_deg", RELPOSNED, base.column("heading", 1e-5) % 360.0, shown)
    dop = records[DOP]
    take("hdop", DOP, dop.column("hdop", 0.01), np.ones(len(dop), bool))
    alone = len(hp) - int(np.isin(hp.values["itow"], key).sum())
    if both and alone:
        notices.append(
            Notice(
                "positions-without-fix",
                f"{name}: {alone} of {len(hp)} positions of NAV-HPPOSLLH have no NAV-PVT of their time beside them and "
                "are not used.",
            )
        )


def _calendar(records: Records, valid: int) -> FloatArray:
    """UTC (n,) to the second of a calendar's fields; nan where the receiver does not vouch for it."""
    value = records.values
    usable = (value["valid"] & valid) == valid
    usable &= (value["hour"] < 24) & (value["minute"] < 60) & (value["second"] < 61)
    seconds = 3600.0 * value["hour"] + 60.0 * value["minute"] + value["second"]
    return np.where(usable, midnights_utc_s(value["year"], value["month"], value["day"]) + seconds, np.nan)


def _dated(records: Mapping[int, Records]) -> tuple[FloatArray, NDArray[np.int64]]:
    """GPS seconds of the messages that carry a date, and where they stand."""
    week = records[TIMEGPS][(records[TIMEGPS].values["valid"] & 0b011) == 0b011]
    raw = records[RAWX]
    raw = raw[np.isfinite(raw.values["tow"]) & (raw.values["week"] > 0)]
    utc = [(_calendar(records[PVT], 0b011), records[PVT].at), (_calendar(records[TIMEUTC], 0b111), records[TIMEUTC].at)]
    parts = [(utc_to_gps_s(t_s), at) for t_s, at in utc]
    parts.append((week.column("week") * WEEK_S + week.column("itow", 1e-3), week.at))
    parts.append((raw.column("week") * WEEK_S + raw.column("tow"), raw.at))
    gps_s, at = (np.concatenate(column) for column in zip(*parts, strict=True))
    known = np.isfinite(gps_s)
    order = np.argsort(at[known], kind="stable")
    return gps_s[known][order], at[known][order]
