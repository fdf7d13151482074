"""SBF logs of Septentrio receivers: positions from PVTGeodetic or PVTCartesian."""

from collections.abc import Callable, Mapping
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.framed_messages import CRC, Framing, MessageCounts, Messages, at_equal, layout
from furrowmap.core.readers.position_log import LoggedPositions, ReceiverLog, dated_positions, has_position
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s
from furrowmap.core.values.earth import east_north_up, geodetic, variances_enu
from furrowmap.core.values.gnss import Fix

GEODETIC: Final = 4007
CARTESIAN: Final = 4006
COV_GEODETIC: Final = 5906
COV_CARTESIAN: Final = 5905
ATT_EULER: Final = 5938
DOP_BLOCK: Final = 4001
"""Numbers of the blocks that are read."""
_STAMP: Final = {"tow": (8, "u4"), "week": (12, "u2")}
_PVT: Final = _STAMP | {
    "mode": (14, "u1"), "error": (15, "u1"), "course": (56, "f4"), "satellites": (74, "u1"), "age": (78, "u2"),
}  # fmt: skip
SBF_LAYOUTS: Final = {
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
    ATT_EULER: layout(24, **_STAMP, error=(15, "u1"), mode=(16, "u2"), heading=(20, "f4")),
    DOP_BLOCK: layout(24, **_STAMP, hdop=(20, "u2")),
}  # fmt: skip
"""Fields that are read of each block, all of them in every revision (SBF reference guide, offsets from ``$``)."""
_NO_WEEK: Final = 0xFFFF
_DO_NOT_USE: Final = -2e10
"""The "Do-Not-Use" value of floating-point fields."""
SBF_FIXES: Final = {1: Fix.SINGLE, 2: Fix.DGPS, 3: Fix.MANUAL, 4: Fix.FIXED, 5: Fix.FLOAT, 6: Fix.DGPS, 7: Fix.FIXED,
                8: Fix.FLOAT, 10: Fix.PPP}  # fmt: skip
"""Fix by the type of solution (bits 0 to 3 of Mode); all others are none."""
_SOLUTIONS: Final = {
    0: "none", 1: "stand-alone", 2: "differential", 3: "fixed location", 4: "RTK fixed", 5: "RTK float",
    6: "SBAS", 7: "moving-base RTK fixed", 8: "moving-base RTK float", 10: "PPP",
}  # fmt: skip
SBF: Final = Framing(
    sync_1=0x24, sync_2=0x40, kind_high_at=5, kind_low_at=4, kind_mask=0x1FFF, length_at=6, extra=0, least=8,
    most=1 << 15, multiple=4, content_at=0, checksum=CRC,
)  # fmt: skip
"""The kind of a block is its number without the revision. Measurement epochs of all satellites have a quarter of
`most` bytes."""
_NUMBERS_AND_NAMES: Final = (
    "4000MeasExtra 4001DOP 4002GALNav 4003GALAlm 4004GLONav 4005GLOAlm 4006PVTCartesian 4007PVTGeodetic "
    "4012SatVisibility 4013ChannelStatus 4014ReceiverStatus 4015Commands 4017GPSRawCA 4018GPSRawL2C 4019GPSRawL5 "
    "4020GEORawL1 4021GEORawL5 4022GALRawFNAV 4023GALRawINAV 4024GALRawCNAV 4026GLORawCA 4027MeasEpoch "
    "4028BaseVectorGeod 4030GALIon 4031GALUtc 4032GALGstGps 4034GALSARRLM 4036GLOTime 4037ExtEventPVTCartesian "
    "4038ExtEventPVTGeodetic 4040BBSamples 4042GPSCNav 4043BaseVectorCart 4044PosCart 4047BDSRaw 4049RTCMDatum "
    "4052PosLocal 4053NTRIPClientStatus 4058IPStatus 4059DiskStatus 4066QZSRawL1CA 4067QZSRawL2C 4068QZSRawL5 "
    "4075ASCIIIn 4076PVTSupport 4079PVTSupportA 4081BDSNav 4082QualityInd 4090InputLink 4091OutputLink 4092RFStatus "
    "4093NAVICRaw 4094PosProjected 4095QZSNav 4097EncapsulatedOutput 4103RxMessage 4105DynDNSStatus 4109Meas3Ranges "
    "4110Meas3CN0HiRes 4111Meas3Doppler 4112Meas3PP 4113Meas3MP 4116QZSAlm 4119BDSAlm 4120BDSIon 4121BDSUtc "
    "4122NTRIPServerStatus 4201LBandTrackerStatus 4204LBandBeams 4211FugroDDS 4212LBandRaw 4214FugroStatus "
    "4217ExtEventBaseVectGeod 4218BDSRawB1C 4219BDSRawB2a 4221GPSRawL1C 4227QZSRawL1C 4228QZSRawL1S "
    "4237ExtEventAttEuler 4238P2PPStatus 4242BDSRawB2b 4245GALAuthStatus 4246QZSRawL5S 4251BDSCNav1 4252BDSCNav2 "
    "4253BDSCNav3 4254NavICLNav 4270QZSRawL6D 4271QZSRawL6E 4272NavCart 4275NavGeod 5891GPSNav 5892GPSAlm 5893GPSIon "
    "5894GPSUtc 5896GEONav 5897GEOAlm 5902ReceiverSetup 5905PosCovCartesian 5906PosCovGeodetic 5907VelCovCartesian "
    "5908VelCovGeodetic 5911xPPSOffset 5914ReceiverTime 5917GEOServiceLevel 5918GEONetworkTime 5919DiffCorrIn "
    "5921EndOfPVT 5922EndOfMeas 5924ExtEvent 5925GEOMT00 5926GEOPRNMask 5927GEOFastCorr 5928GEOIntegrity "
    "5929GEOFastCorrDegr 5930GEODegrFactors 5931GEOIGPMask 5932GEOLongTermCorr 5933GEOIonoDelay "
    "5934GEOClockEphCovMatrix 5936Comment 5938AttEuler 5939AttCovEuler 5942AuxAntPositions 5943EndOfAtt "
    "5949BaseStation"
)

SBF_NAMES: Final = {int(block[:4]): block[4:] for block in _NUMBERS_AND_NAMES.split()}
"""Name of each block by its number, as `inspect` reports them (Septentrio, SBF reference guides)."""


class SbfLog(ReceiverLog):
    """The positions in a log of Septentrio's blocks.

    PVTGeodetic makes the epoch, or PVTCartesian if there is none; covariances, heading and dilution are joined by equal
    time stamp. Times are GPS week and time of week. The heading is AttEuler's, of the receiver's two antennas with the
    offset configured in the receiver. Heights are above the ellipsoid.
    """

    format: ClassVar[str] = "sbf"
    title: ClassVar[Text] = Text("Septentrio SBF log")
    frames_title: ClassVar[str] = "blocks"
    framing: ClassVar[Framing] = SBF
    layouts: ClassVar[Mapping[int, np.dtype[np.void]]] = SBF_LAYOUTS
    certainty: ClassVar[Mapping[int, float]] = {GEODETIC: 0.95, CARTESIAN: 0.95}

    @classmethod
    def _name_of(cls, kind: int) -> str:
        return SBF_NAMES.get(kind, str(kind))

    def _epochs(self, messages: Mapping[int, Messages], name: str, place: Callable[[int], str]) -> LoggedPositions:
        is_geodetic = len(messages[GEODETIC]) > 0
        pvt = messages[GEODETIC if is_geodetic else CARTESIAN]
        key = _key(pvt)
        fix = np.array([SBF_FIXES.get(kind, Fix.NONE) for kind in range(16)], np.int8)[pvt.values["mode"] & 15]
        fix[pvt.values["error"] != 0] = Fix.NONE
        if is_geodetic:
            lon, lat = (np.degrees(_stated(pvt.column(name))) for name in ("lon", "lat"))
            height = _stated(pvt.column("height"))
            speed = np.hypot(_stated(pvt.column("ve")), _stated(pvt.column("vn")))
        else:
            lon, lat, height = geodetic(np.column_stack([_stated(pvt.column(name)) for name in "xyz"]))
            velocity = np.column_stack([_stated(pvt.column(name)) for name in ("vx", "vy", "vz")])
            local = np.einsum("nij,nj->ni", east_north_up(lon, lat), velocity)
            speed = np.hypot(local[:, 0], local[:, 1])
        sigma = _sigmas(key, messages, lon, lat)
        attitude = messages[ATT_EULER]
        attitude = attitude[(attitude.values["mode"] > 0) & (attitude.values["error"] == 0)]
        course = _stated(pvt.column("course"))
        satellites = pvt.values["satellites"].astype(np.int16)
        age = pvt.values["age"]
        dop = messages[DOP_BLOCK]
        columns = {
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
        kinds = np.bincount(pvt.values["mode"] & 15, minlength=16)
        facts = {"solutions": {_SOLUTIONS.get(k, f"type {k}"): n for k, n in enumerate(kinds.tolist()) if n}}
        known = (pvt.values["week"] != _NO_WEEK) & (pvt.values["tow"] < 1000 * WEEK_S)
        columns["t_s"] = np.where(known, gps_to_utc_s(pvt.column("week") * WEEK_S + pvt.column("tow", 1e-3)), np.nan)
        mode = pvt.values["mode"][has_position(columns) & known]
        flat = int(np.sum((mode & 128) > 0))
        return dated_positions(
            columns,
            pvt.at,
            place,
            name=name,
            what=Text("position blocks"),
            facts=facts,
            service="sbas" if 2 * np.sum((mode & 15) == 6) > len(mode) else "",
            notices=[Notice("positions-2d", name=name, flat=flat)] if flat else [],
        )

    def _no_position_messages(self, name: str, frames: Words, counts: MessageCounts[int]) -> InputError:  # noqa: ARG002
        return InputError("no-positions.of-sbf", name=name, frames=frames)


def _key(messages: Messages) -> NDArray[np.int64]:
    """Time stamps (n,) as milliseconds of GPS time."""
    return messages.values["week"].astype(np.int64) * (1000 * WEEK_S) + messages.values["tow"].astype(np.int64)


def _stated(values: FloatArray) -> FloatArray:
    """`values` with nan for "Do-Not-Use"."""
    return np.where(np.isfinite(values) & (values > 0.5 * _DO_NOT_USE), values, np.nan)


def _sigmas(
    key: NDArray[np.int64], messages: Mapping[int, Messages], lon: FloatArray, lat: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standard deviations (n,) east, north and up, from the geodetic covariances, else from the Cartesian ones."""
    cov = messages[COV_GEODETIC]
    cov = cov[cov.values["error"] == 0]
    if len(cov):
        east, north, up = (at_equal(key, _key(cov), _root(_stated(cov.column(name)))) for name in ("ee", "nn", "hh"))
        return east, north, up
    cov = messages[COV_CARTESIAN]
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
