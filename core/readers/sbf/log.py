"""Logs of Septentrio receivers: PVTGeodetic or PVTCartesian, their covariances, AttEuler and DOP."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import in_order
from furrowmap.core.readers.frames import BYTES, Records, Scan, Tally, at_equal, layout
from furrowmap.core.readers.position_log import Positions
from furrowmap.core.readers.receiver_log import ReceiverLog, sound
from furrowmap.core.readers.sbf.frames import scan
from furrowmap.core.readers.source import Head
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s
from furrowmap.core.values.earth import east_north_up, geodetic, variances_enu
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix, GnssTrack

FloatArray = NDArray[np.float64]

GEODETIC, CARTESIAN, COV_GEODETIC, COV_CARTESIAN, ATTITUDE, DOP = 4007, 4006, 5906, 5905, 5938, 4001
"""Numbers of the blocks that are read."""
_STAMP: Final = {"tow": (8, "u4"), "week": (12, "u2")}
_PVT: Final = _STAMP | {
    "mode": (14, "u1"), "error": (15, "u1"), "course": (56, "f4"), "satellites": (74, "u1"), "age": (78, "u2"),
}  # fmt: skip
LAYOUTS: Final = {
    GEODETIC: layout(
        84, **_PVT, lat=(16, "f8"), lon=(24, "f8"), height=(32, "f8"), vn=(44, "f4"), ve=(48, "f4"),
    ),
    CARTESIAN: layout(
        84, **_PVT, x=(16, "f8"), y=(24, "f8"), z=(32, "f8"), vx=(44, "f4"), vy=(48, "f4"), vz=(52, "f4"),
    ),
    COV_GEODETIC: layout(28, **_STAMP, error=(15, "u1"), nn=(16, "f4"), ee=(20, "f4"), hh=(24, "f4")),
    COV_CARTESIAN: layout(
        48, **_STAMP, error=(15, "u1"), xx=(16, "f4"), yy=(20, "f4"), zz=(24, "f4"), xy=(32, "f4"), xz=(36, "f4"),
        yz=(44, "f4"),
    ),
    ATTITUDE: layout(24, **_STAMP, error=(15, "u1"), mode=(16, "u2"), heading=(20, "f4")),
    DOP: layout(24, **_STAMP, hdop=(20, "u2")),
}  # fmt: skip
"""What is read of each block: the part that all revisions have (SBF reference guide, offsets from ``$``)."""
_NO_WEEK: Final = 0xFFFF
_NO_TOW: Final = 0xFFFFFFFF
_NOTHING: Final = -2e10
"""What a block says where it has nothing to say ("Do-Not-Use")."""
FIXES: Final = {1: Fix.SINGLE, 2: Fix.DGPS, 3: Fix.MANUAL, 4: Fix.FIXED, 5: Fix.FLOAT, 6: Fix.DGPS, 7: Fix.FIXED,
                8: Fix.FLOAT, 10: Fix.PPP}  # fmt: skip
"""Quality of a position by the type of its solution (bits 0 to 3 of Mode); 0 and all others are none."""
_TYPES: Final = {0: "none", 1: "stand-alone", 2: "differential", 3: "fixed location", 4: "RTK fixed", 5: "RTK float",
                 6: "SBAS", 7: "moving-base RTK fixed", 8: "moving-base RTK float", 10: "PPP"}  # fmt: skip
LEAST_SHARE: Final = 0.02
"""Share of SBF bytes from which on a file without positions is told to be an SBF log."""


class SbfLog(ReceiverLog):
    """The positions in a log of Septentrio's blocks.

    PVTGeodetic makes the epoch, or PVTCartesian where it alone is there; covariances, heading and dilution join it by
    their equal time stamp. Times are GPS time of week and week. AttEuler's heading is that of the receiver's two
    antennas, with the offset the receiver was told. Heights are above the ellipsoid.
    """

    format: ClassVar[str] = "sbf"
    title: ClassVar[str] = "Septentrio SBF log"
    messages: ClassVar[str] = "blocks"
    layouts: ClassVar[Mapping[int, np.dtype[np.void]]] = LAYOUTS
    find: ClassVar[Scan] = staticmethod(scan)

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with positions; possible where there are other blocks."""
        if b"$@" not in head.data:
            return 0.0
        frames, counts, _ = scan(np.frombuffer(head.data, np.uint8), True)  # noqa: FBT003
        if np.isin(frames[:, 0], (GEODETIC, CARTESIAN)).any():
            return 0.95
        return 0.3 if counts[BYTES] >= LEAST_SHARE * len(head.data) else 0.0

    def _names(self, kinds: Sequence[int]) -> dict[int, str]:
        from pysbf2 import SBF_MSGIDS

        return {kind: SBF_MSGIDS[kind][0] if kind in SBF_MSGIDS else str(kind) for kind in kinds}

    def _epochs(
        self, records: Mapping[int, Records], tally: Tally, name: str, place: Callable[[int], str]
    ) -> Positions:
        is_geodetic = bool(len(records[GEODETIC]))
        pvt = records[GEODETIC if is_geodetic else CARTESIAN]
        if not len(pvt):
            return Positions.none(name, self._no_positions(tally, name))
        columns = _columns(pvt, records, is_geodetic=is_geodetic)
        kinds = np.bincount(pvt.values["mode"] & 15, minlength=16)
        facts = {"solutions": {_TYPES.get(k, f"type {k}"): n for k, n in enumerate(kinds.tolist()) if n}}
        positioned = (columns["fix"] != Fix.NONE) & sound(columns)
        positioned &= (pvt.values["week"] != _NO_WEEK) & (pvt.values["tow"] < 1000 * WEEK_S)
        without = int(np.sum(~positioned))
        if not positioned.any():
            fault = InputError(
                f"{name}: none of its {len(pvt)} position blocks states a position at a time (no solution, "
                "or an error).",
                "There is nothing to place scans with, and nothing to evaluate.",
                "Record under open sky; `furrowmap inspect` tells the kinds of solution.",
                code="no-positions",
            )
            return Positions.none(name, fault, without_position=without)
        columns = {column: values[positioned] for column, values in columns.items()}
        at = pvt.at[positioned]
        t_s = gps_to_utc_s(pvt.column("week")[positioned] * WEEK_S + pvt.column("tow", 1e-3)[positioned])
        try:
            forward, notices = in_order(t_s, columns["lon_deg"], columns["lat_deg"], name, lambda k: place(int(at[k])))
        except InputError as fault:
            return Positions.none(name, fault, without_position=without)
        if np.any((pvt.values["mode"][positioned] & 128) > 0):
            count = int(np.sum((pvt.values["mode"][positioned] & 128) > 0))
            notices.append(
                Notice("positions-2d", f"{name}: {count} positions are two-dimensional; their height is assumed.")
            )
        track = GnssTrack.build(
            t_s[forward],
            source=name,
            service="sbas" if np.mean((pvt.values["mode"][positioned] & 15) == 6) > 0.5 else "",
            **{column: values[forward] for column, values in columns.items()},
        )
        return Positions(
            track=track,
            dated=True,
            without_position=without,
            dropped=int(np.sum(~forward)),
            facts=facts,
            notices=tuple(notices),
            fault=None,
        )

    def _no_positions(self, tally: Tally, name: str) -> InputError:
        names = self._names([kind for kind, _ in tally.kinds.most_common(4)])
        held = f"its blocks are {', '.join(names.values())}" if names else "not one of its blocks is intact"
        return InputError(
            f"{name}: an SBF log without positions ({held}).",
            "Positions stand in PVTGeodetic or PVTCartesian, and neither is there; raw observations (MeasEpoch) have "
            "to be processed first.",
            "Let the receiver write PVTGeodetic, PosCovGeodetic and AttEuler; or process the observations and give the "
            ".pos file.",
            code="no-positions",
        )


def _columns(pvt: Records, records: Mapping[int, Records], *, is_geodetic: bool) -> dict[str, NDArray[Any]]:
    key = _key(pvt)
    fix = np.array([FIXES.get(kind, Fix.NONE) for kind in range(16)], np.int8)[pvt.values["mode"] & 15]
    fix[pvt.values["error"] != 0] = Fix.NONE
    lon, lat, height, speed = _geodetic(pvt) if is_geodetic else _from_cartesian(pvt)
    sigma = _sigmas(key, records, lon, lat)
    attitude = records[ATTITUDE]
    attitude = attitude[(attitude.values["mode"] > 0) & (attitude.values["error"] == 0)]
    course = _stated(pvt.column("course"))
    satellites = pvt.values["satellites"].astype(np.int16)
    age = pvt.values["age"]
    dop = records[DOP]
    return {
        "lon_deg": lon,
        "lat_deg": lat,
        "height_m": height,
        "fix": fix,
        "sigma_e_m": sigma[0],
        "sigma_n_m": sigma[1],
        "sigma_h_m": sigma[2],
        "speed_mps": speed,
        "course_deg": course % 360.0,
        "heading_deg": at_equal(key, _key(attitude), _stated(attitude.column("heading")) % 360.0),
        "satellites": np.where(satellites == 255, -1, satellites),
        "hdop": at_equal(key, _key(dop), np.where(dop.values["hdop"] > 0, dop.column("hdop", 0.01), np.nan)),
        "age_s": np.where(age != 0xFFFF, age * 0.01, np.nan),
    }


def _key(records: Records) -> NDArray[np.int64]:
    """Time stamps (n,) as milliseconds of GPS time."""
    return records.values["week"].astype(np.int64) * (1000 * WEEK_S) + records.values["tow"].astype(np.int64)


def _stated(values: FloatArray) -> FloatArray:
    """`values` with nan for what a block does not state."""
    return np.where(np.isfinite(values) & (values > 0.5 * _NOTHING), values, np.nan)


def _geodetic(pvt: Records) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    lon, lat = (np.degrees(_stated(pvt.column(name))) for name in ("lon", "lat"))
    speed = np.hypot(_stated(pvt.column("ve")), _stated(pvt.column("vn")))
    return lon, lat, _stated(pvt.column("height")), speed


def _from_cartesian(pvt: Records) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    lon, lat, height = geodetic(np.column_stack([_stated(pvt.column(name)) for name in "xyz"]))
    velocity = np.column_stack([_stated(pvt.column(name)) for name in ("vx", "vy", "vz")])
    local = np.einsum("nij,nj->ni", east_north_up(lon, lat), velocity)
    return lon, lat, height, np.hypot(local[:, 0], local[:, 1])


def _sigmas(
    key: NDArray[np.int64], records: Mapping[int, Records], lon: FloatArray, lat: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standard deviations (n,) east, north and up, of the geodetic covariances, else of the Cartesian ones."""
    cov = records[COV_GEODETIC]
    cov = cov[cov.values["error"] == 0]
    if len(cov):
        east, north, up = (at_equal(key, _key(cov), _root(_stated(cov.column(name)))) for name in ("ee", "nn", "hh"))
        return east, north, up
    cov = records[COV_CARTESIAN]
    cov = cov[cov.values["error"] == 0]
    entry = {n: at_equal(key, _key(cov), _stated(cov.column(n))) for n in ("xx", "yy", "zz", "xy", "xz", "yz")}
    rows = [[entry["".join(sorted(a + b))] for b in "xyz"] for a in "xyz"]
    matrix = np.moveaxis(np.array(rows), -1, 0)
    variance = variances_enu(matrix, lon, lat)
    east, north, up = (_root(variance[:, k]) for k in range(3))
    return east, north, up


def _root(variance: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore"):
        return np.where(variance >= 0.0, np.sqrt(np.abs(variance)), np.nan)
