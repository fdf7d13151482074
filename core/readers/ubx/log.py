"""UBX logs of u-blox receivers: positions from NAV-PVT or NAV-HPPOSLLH."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import midnights_utc_s, no_week, week_times
from furrowmap.core.readers.framed_messages import FLETCHER, Framing, MessageCounts, Messages, at_equal, layout, paired
from furrowmap.core.readers.position_log import LoggedPositions, ReceiverLog, has_position, no_valid_positions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s, nearest_in_cycle, utc_to_gps_s
from furrowmap.core.values.gnss import Fix

NAV_PVT: Final = 0x0107
NAV_HPPOSLLH: Final = 0x0114
NAV_COV: Final = 0x0136
NAV_DOP: Final = 0x0104
NAV_STATUS: Final = 0x0103
NAV_TIMEGPS: Final = 0x0120
NAV_TIMEUTC: Final = 0x0121
RXM_RAWX: Final = 0x0215
NAV_RELPOSNED: Final = 0x013C
"""Class and id of the messages that are read."""
UBX_LAYOUTS: Final = {
    NAV_PVT: layout(
        84, itow=(0, "u4"), year=(4, "u2"), month=(6, "u1"), day=(7, "u1"), hour=(8, "u1"), minute=(9, "u1"),
        second=(10, "u1"), valid=(11, "u1"), nano=(16, "i4"), kind=(20, "u1"), flags=(21, "u1"), satellites=(23, "u1"),
        lon=(24, "i4"), lat=(28, "i4"), height=(32, "i4"), h_acc=(40, "u4"), v_acc=(44, "u4"), speed=(60, "i4"),
        course=(64, "i4"), flags3=(78, "u2"),
    ),
    NAV_HPPOSLLH: layout(
        36, flags=(3, "u1"), itow=(4, "u4"), lon=(8, "i4"), lat=(12, "i4"), height=(16, "i4"), lon_hp=(24, "i1"),
        lat_hp=(25, "i1"), height_hp=(26, "i1"), h_acc=(28, "u4"), v_acc=(32, "u4"),
    ),
    NAV_COV: layout(64, itow=(0, "u4"), valid=(5, "u1"), nn=(16, "f4"), ee=(28, "f4"), dd=(36, "f4")),
    NAV_DOP: layout(18, itow=(0, "u4"), hdop=(12, "u2")),
    NAV_STATUS: layout(16, itow=(0, "u4"), kind=(4, "u1"), flags=(5, "u1"), flags2=(7, "u1")),
    NAV_TIMEGPS: layout(16, itow=(0, "u4"), week=(8, "i2"), valid=(11, "u1")),
    NAV_TIMEUTC: layout(
        20, itow=(0, "u4"), year=(12, "u2"), month=(14, "u1"), day=(15, "u1"), hour=(16, "u1"), minute=(17, "u1"),
        second=(18, "u1"), valid=(19, "u1"),
    ),
    RXM_RAWX: layout(16, tow=(0, "f8"), week=(8, "u2")),
    NAV_RELPOSNED: layout(64, version=(0, "u1"), itow=(4, "u4"), heading=(24, "i4"), flags=(60, "u4")),
}  # fmt: skip
"""Fields that are read of each message, all of them in every protocol version."""

AGE_S: Final = np.array([np.nan, 1, 2, 5, 10, 15, 20, 30, 45, 60, 90, 120, 120, 120, 120, 120], np.float64)
"""Age of corrections by its class in NAV-PVT: the upper limit of the class; 120 s for the open one."""
_FIXED_HEADING: Final = 0b1_0011_1101, 0b1_0011_0101
"""Mask and value of NAV-RELPOSNED's flags for a heading from a moving base with fixed ambiguities: heading and position
valid, moving, carrier solution 2, fix within the receiver's limits."""
_DEAD_RECKONING: Final = 1
_2D = 2
_3D = 3
_COMBINED: Final = 4
_FIX_TYPES: Final = {0: "none", 1: "dead reckoning", 2: "2D", 3: "3D", 4: "GNSS and dead reckoning", 5: "time only"}


_CLASSES_AND_IDS: Final = (
    "01-NAV 01POSECEF 02POSLLH 03STATUS 04DOP 05ATT 06SOL 07PVT 09ODO 10RESETODO 11VELECEF 12VELNED 13HPPOSECEF "
    "14HPPOSLLH 17PVAT 20TIMEGPS 21TIMEUTC 22CLOCK 23TIMEGLO 24TIMEBDS 25TIMEGAL 26TIMELS 27TIMEQZSS 28NMI 30SVINFO "
    "31DGPS 32SBAS 34ORB 35SAT 36COV 39GEOFENCE 3BSVIN 3CRELPOSNED 3DEELL 40EKFSTATUS 42SLAS 43SIG 45DAHEADING "
    "60AOPSTATUS 61EOE 62PL 63TIMENAVIC 64TIMETRUSTED 02-RXM 10RAW 11SFRB 13SFRBX 14MEASX 15RAWX 20SVSI 30ALM 31EPH "
    "32RTCM 33SPARTN 34COR 36SPARTN-KEY 40POSREQ 41PMREQ 59RLM 61IMES 72PMP 73QZSSL6 74TM 80MEASD12 82MEASC12 "
    "84MEAS20 86MEAS50 04-INF 00ERROR 01WARNING 02NOTICE 03TEST 04DEBUG 05-ACK 00NAK 01ACK 06-CFG 00PRT 01MSG 02INF "
    "04RST 06DAT 07TP 08RATE 09CFG 0EFXN 11RXM 12EKF 13ANT 16SBAS 17NMEA 1BUSB 1DTMODE 1EODO 22NVS 23NAVX5 24NAV5 "
    "29ESFGWT 31TP5 32PM 34RINV 39ITFM 3BPM2 3DTMODE2 3EGNSS 41OTP 47LOGFILTER 4CESFA 4DESFG 53TXSLOT 56ESFALG 57PWR "
    "5CHNR 60ESRC 61DOSC 62SMGR 64SPT 69GEOFENCE 70DGNSS 71TMODE3 82ESFWT 84FIXSEED 85DYNSEED 86PMS 88SENIF 8AVALSET "
    "8BVALGET 8CVALDEL 8DSLAS 93BATCH 09-UPD 14SOS 0A-MON 02IO 04VER 06MSGPP 07RXBUF 08TXBUF 09HW 0BHW2 21RXR 27PATCH "
    "28GNSS 2BPT2 2ESMGR 2FSPT 31SPAN 35PMP 36COMMS 37HW3 38RF 39SYS 0B-AID 00REQ 01INI 02HUI 10DATA 30ALM 31EPH "
    "32ALPSRV 33AOP 50ALP 0D-TIM 01TP 03TM2 04SVIN 06VRFY 11DOSC 12TOS 13SMEAS 15VCOCAL 16FCHG 17HOC 10-ESF 02MEAS "
    "03RAW 04CAL 10STATUS 13RESETALG 14ALG 15INS 13-MGA 10SF 80DBD 21-LOG 03ERASE 04STRING 07CREATE 08INFO 09RETRIEVE "
    "0BRETRIEVEPOS 0DRETRIEVESTRING 0EFINDTIME 0FRETRIEVEPOSEXTRA 10RETRIEVEBATCH 11BATCH 27-SEC 01SIGN 03UNIQID "
    "09SIG 0AOSNMA 10SIGLOG 28-HNR 00PVT 01ATT 02INS 29-NAV2 01POSECEF 02POSLLH 03STATUS 04DOP 07PVT 09ODO 11VELECEF "
    "12VELNED 17PVAT 20TIMEGPS 21TIMEUTC 22CLOCK 23TIMEGLO 24TIMEBDS 25TIMEGAL 26TIMELS 27TIMEQZSS 32SBAS 35SAT 36COV "
    "3BSVIN 3DEELL 42SLAS 43SIG 61EOE 63TIMENAVIC"
)
"""Each class, its number before its name, followed by the ids and names of its messages; numbers are hexadecimal
(u-blox, interface descriptions of the M8 and F9 receivers)."""


def _list_names() -> dict[int, str]:
    names = {}
    kind = 0
    group = ""
    for word in _CLASSES_AND_IDS.split():
        if word[2] == "-":
            kind = int(word[:2], 16) << 8
            group = word[3:]
        else:
            names[kind | int(word[:2], 16)] = f"{group}-{word[2:]}"
    return names


UBX_NAMES: Final = _list_names()
"""Name of each message by 256 × class + id."""

UBX: Final = Framing(
    sync_1=0xB5, sync_2=0x62, kind_high_at=2, kind_low_at=3, kind_mask=0xFFFF, length_at=4, extra=8, least=0, most=8192,
    multiple=1, content_at=6, checksum=FLETCHER,
)  # fmt: skip
"""The kind of a frame is 256 × class + id. The longest messages (RXM-RAWX) have half of `most` bytes."""


class UbxLog(ReceiverLog):
    """The positions in a log of u-blox's messages.

    NAV-PVT makes the epoch. Joined by equal time of week are the further digits of NAV-HPPOSLLH, the standard
    deviations of NAV-COV, the dilution of NAV-DOP, and the heading of NAV-RELPOSNED: from a moving base to the rover
    that writes the log, if ambiguities are fixed. Without NAV-COV, east and north share the horizontal accuracy
    estimate equally. A log with NAV-HPPOSLLH alone has no date, and its kind of fix comes from NAV-STATUS. Heights are
    above the ellipsoid.
    """

    format: ClassVar[str] = "ubx"
    title: ClassVar[Text] = Text("u-blox UBX log")
    frames_title: ClassVar[str] = "messages"
    framing: ClassVar[Framing] = UBX
    layouts: ClassVar[Mapping[int, np.dtype[np.void]]] = UBX_LAYOUTS
    certainty: ClassVar[Mapping[int, float]] = {
        NAV_PVT: 0.95,
        NAV_HPPOSLLH: 0.85,
    }  # the latter less than NMEA with its date

    @classmethod
    def _name_of(cls, kind: int) -> str:
        return UBX_NAMES.get(kind, f"{kind >> 8:02X}-{kind & 255:02X}")

    def _epochs(self, messages: Mapping[int, Messages], name: str, place: Callable[[int], str]) -> LoggedPositions:
        pvt = messages[NAV_PVT]
        hp = messages[NAV_HPPOSLLH]
        if len(pvt):
            base = pvt
            columns = _read_pvt(pvt)
            notices = _without_fix(hp, pvt, name)
        else:
            base = hp
            columns, notices = _read_hpposllh(hp, messages[NAV_STATUS], name)
        key = base.values["itow"].astype(np.int64)
        _refine(columns, key, messages)
        count = np.bincount(pvt.values["kind"], minlength=6)
        kinds = {kind: int(count[number]) for number, kind in _FIX_TYPES.items() if count[number]}
        facts = {"kinds_of_fix": kinds} if kinds else {}
        stated = has_position(columns)
        without = int(np.sum(~stated))
        if not stated.any():
            fault = no_valid_positions(name, len(base), "NAV-PVT or NAV-HPPOSLLH messages")
            return replace(LoggedPositions.none(name, fault, without_position=without), facts=facts)
        columns = {column: values[stated] for column, values in columns.items()}
        at = base.at[stated]
        tow_s = key[stated] / 1000.0
        try:
            t_s = self._times(columns.pop("utc_s"), tow_s, at, messages, name)
        except InputError as fault:
            return replace(LoggedPositions.none(name, fault, without_position=without), facts=facts)
        positions = LoggedPositions.in_order(
            columns | {"t_s": tow_s if t_s is None else t_s},
            lambda k: place(int(at[k])),
            name=name,
            without_position=without,
            notices=notices,
            fault=no_week(tow_s, name) if t_s is None else None,
        )
        return replace(positions, facts=facts)

    def _times(
        self, utc_s: FloatArray, tow_s: FloatArray, at: NDArray[np.int64], messages: Mapping[int, Messages], name: str
    ) -> FloatArray | None:
        """UTC (n,) from the calendar where the receiver knows it, else from the time of week; None without a week."""
        dated_s, dated_at = _find_dates(messages)
        if len(dated_s):
            before = np.clip(np.searchsorted(dated_at, at, side="right") - 1, 0, None)
            gps_s: FloatArray | None = nearest_in_cycle(tow_s, dated_s[before], WEEK_S)
        else:
            gps_s = week_times(tow_s, self.options, name)
        if gps_s is None:
            return None if not np.isfinite(utc_s).all() else utc_s
        return np.where(np.isfinite(utc_s), utc_s, gps_to_utc_s(gps_s))

    def _no_position_messages(self, name: str, frames: Words, counts: MessageCounts[int]) -> InputError:
        raw = RXM_RAWX in counts.kinds
        return InputError("no-positions.no-position-messages-2", name=name, frames=frames, raw=bool(raw))


def _read_pvt(pvt: Messages) -> dict[str, NDArray[Any]]:
    """The columns of NAV-PVT; fixes as in the receiver's own GGA (F9 HPG, "Position fix flags in NMEA")."""
    kind, flags, flags3 = (pvt.values[field] for field in ("kind", "flags", "flags3"))
    within = (flags & 1) > 0
    differential = (flags & 2) > 0
    carrier = flags >> 6
    positioned = np.isin(kind, (_2D, _3D, _COMBINED)) & within & ((flags3 & 1) == 0)
    fix = np.select(
        [(kind == _DEAD_RECKONING) & ((flags3 & 1) == 0), ~positioned, carrier == 2, carrier == 1, differential],
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


def _read_hpposllh(hp: Messages, status: Messages, name: str) -> tuple[dict[str, NDArray[Any]], list[Notice]]:
    """The columns of NAV-HPPOSLLH alone, with the kind of fix of NAV-STATUS."""
    key = hp.values["itow"].astype(np.int64)
    of = status.values["itow"].astype(np.int64)
    row, other = paired(key, of)
    kind, flags, carrier = (status.values[field][other] for field in ("kind", "flags", "flags2"))
    fix = np.full(len(hp), Fix.SINGLE, np.int8)
    fix[row] = np.select(
        [~np.isin(kind, (1, 2, 3, 4)) | ((flags & 1) == 0), carrier >> 6 == 2, carrier >> 6 == 1, (flags & 2) > 0],
        [Fix.NONE, Fix.FIXED, Fix.FLOAT, Fix.DGPS],
        Fix.SINGLE,
    )
    notices = []
    if len(row) < len(hp):
        notices.append(Notice("fix-unknown", name=name, unknown=len(hp) - len(row), positions=len(hp)))
    fix[(hp.values["flags"] & 1) > 0] = Fix.NONE
    nothing = np.full(len(hp), np.nan)
    columns: dict[str, NDArray[Any]] = {
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
    return columns, notices


def _without_fix(hp: Messages, pvt: Messages, name: str) -> list[Notice]:
    """A notice of the positions of NAV-HPPOSLLH at whose times there is no NAV-PVT."""
    alone = len(hp) - int(np.isin(hp.values["itow"], pvt.values["itow"]).sum())
    return [Notice("positions-without-fix", name=name, alone=alone, positions=len(hp))] if alone else []


def _refine(columns: dict[str, NDArray[Any]], key: NDArray[np.int64], messages: Mapping[int, Messages]) -> None:
    """Replace columns of NAV-PVT where NAV-HPPOSLLH or NAV-COV is more precise; add dilution and heading."""

    def take(column: str, kind: int, values: FloatArray, usable: NDArray[np.bool_]) -> None:
        other = messages[kind][usable]
        found = at_equal(key, other.values["itow"].astype(np.int64), values[usable])
        columns[column] = np.where(np.isfinite(found), found, columns[column])

    hp = messages[NAV_HPPOSLLH]
    cov = messages[NAV_COV]
    valid = (hp.values["flags"] & 1) == 0
    # Units and their hundredths are added as integers: a float64 holds the sum exactly.
    for column, unit in (("lon_deg", 1e9), ("lat_deg", 1e9)):
        part = column[:3]
        take(column, NAV_HPPOSLLH, (hp.column(part, 100.0) + hp.column(f"{part}_hp")) / unit, valid)
    take("height_m", NAV_HPPOSLLH, (hp.column("height", 10.0) + hp.column("height_hp")) / 1e4, valid)
    for column in ("sigma_e_m", "sigma_n_m"):
        take(column, NAV_HPPOSLLH, hp.column("h_acc", 1e-4) / np.sqrt(2.0), valid)
    take("sigma_h_m", NAV_HPPOSLLH, hp.column("v_acc", 1e-4), valid)
    stated = (cov.values["valid"] == 1) & np.isfinite(cov.values["nn"]) & np.isfinite(cov.values["ee"])
    for column, field in (("sigma_e_m", "ee"), ("sigma_n_m", "nn"), ("sigma_h_m", "dd")):
        take(column, NAV_COV, np.sqrt(np.abs(cov.column(field))), stated)
    columns["heading_deg"] = np.full(len(key), np.nan)
    base = messages[NAV_RELPOSNED]
    shown = (base.values["version"] >= 1) & ((base.values["flags"] & _FIXED_HEADING[0]) == _FIXED_HEADING[1])
    take("heading_deg", NAV_RELPOSNED, base.column("heading", 1e-5) % 360.0, shown)
    dop = messages[NAV_DOP]
    take("hdop", NAV_DOP, dop.column("hdop", 0.01), np.ones(len(dop), bool))


def _calendar(messages: Messages, valid: int) -> FloatArray:
    """UTC (n,) to the second from calendar fields; nan where the receiver does not mark them as valid."""
    value = messages.values
    usable = (value["valid"] & valid) == valid
    usable &= (value["hour"] < 24) & (value["minute"] < 60) & (value["second"] < 61)
    seconds = 3600.0 * value["hour"] + 60.0 * value["minute"] + value["second"]
    return np.where(usable, midnights_utc_s(value["year"], value["month"], value["day"]) + seconds, np.nan)


def _find_dates(messages: Mapping[int, Messages]) -> tuple[FloatArray, NDArray[np.int64]]:
    """GPS seconds of the messages with a date, and their offsets in the stream."""
    week = messages[NAV_TIMEGPS][(messages[NAV_TIMEGPS].values["valid"] & 0b011) == 0b011]
    raw = messages[RXM_RAWX]
    raw = raw[np.isfinite(raw.values["tow"]) & (raw.values["week"] > 0)]
    calendars = ((messages[NAV_PVT], 0b011), (messages[NAV_TIMEUTC], 0b111))
    parts = [(utc_to_gps_s(_calendar(dated, valid)), dated.at) for dated, valid in calendars]
    parts.append((week.column("week") * WEEK_S + week.column("itow", 1e-3), week.at))
    parts.append((raw.column("week") * WEEK_S + raw.column("tow"), raw.at))
    gps_s, at = (np.concatenate(column) for column in zip(*parts, strict=True))
    known = np.isfinite(gps_s)
    order = np.argsort(at[known], kind="stable")
    return gps_s[known][order], at[known][order]
