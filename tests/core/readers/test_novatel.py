"""NovAtel and Unicore logs: the maker's decoder, examples of the makers' manuals, and laws of the messages."""

from __future__ import annotations

import struct
from base64 import b85decode
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

from furrowmap.core.readers.framed_messages import MessageCounts
from furrowmap.core.readers.novatel.log import NovatelLog, scan_bytes
from furrowmap.core.readers.reader import ReadOptions, Recognised
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import GPS_EPOCH_S, WEEK_S
from furrowmap.core.values.gnss import Fix

TEXT = b"""\
#BESTPOSA,COM1,0,85.0,FINESTEERING,1984,450849.900,02040008,b1f6,32768;SOL_COMPUTED,NARROW_INT,51.11637049364,\
-114.03827102464,1059.7444,-16.9000,WGS84,1.8734,1.5644,2.8764,"",4.500,0.000,20,14,18,0,00,00,00,11*5724926d\r
#BESTVELA,COM1,0,85.0,FINESTEERING,1984,450849.900,02040008,10a2,32768;SOL_COMPUTED,NARROW_INT,0.000,0.000,2.4000,\
360.000000,0.0206,0.0*8530ec75\r
#HEADING2A,COM1,0,85.0,FINESTEERING,1984,450849.900,02040008,22a5,32768;SOL_COMPUTED,NARROW_INT,1.5004,95.250000000,\
-2.50,0.0,0.4,0.6,"r   ","m   ",18,16,16,10,00,00,00,11*d6f994d5\r
#INSPVAXA,COM1,0,85.0,FINESTEERING,1984,450849.900,02040008,4e77,32768;INS_SOLUTION_GOOD,INS_RTKFIXED,51.11637049364,\
-114.03827102464,1063.6094,-16.9000,-0.0845,-0.0464,-0.0127,0.138023494,0.069459384,94.000923268,0.9428,0.6688,1.4746,\
0.0430,0.0518,0.0521,0.944295466,0.944567084,1.000131845,3,0*5ea6e666\r
%INSPVASA,1984,450849.900;1984,450849.900000000,51.11637049364,-114.03827102464,1046.7094,-0.0845,-0.0464,-0.0127,\
0.138023494,0.069459384,94.000923268,INS_SOLUTION_GOOD*2940ea12\r
"""
BINARY = b85decode(
    "szeeTDgXc=NB{r;s<gldY;4~e2mk~E_OSqf00000G5`Pon=^De<&H@}rOi(WbAnvJl3e~n`i_u5Gc$+5JpcdzlFRQuLO#ep@D?~g00000005"
    "9c000006b=#q0000H=+u<GszeeTV*mgkEC2uis<gldY;4~e2mk~Eq7VRp00000G5`Po0000000000Gcz+YGcyA~000000DyKt4!$s%Dj1bN000"
    "00OG)OPszeeTHw6G7FaQ7ms<gldY;4~e2mk~Er6K@;00000G5`Po8x6oe0D!(i001Ds00000&CJX`nwc3tav&feZ6F{Z5)cpy0000HA#3C9szee"
    "Txdi|qegFUfs<gldY;4~e2mk~EcTNC+0{{R3H~;_un=^De<&H@}rOi(WbAnvJySR-8aGsDrGc$+5ZxVyR%AvKt;G7Yqy}_ryrV2(SbpndNucBxC"
    "z^cJNgD9>R7s#<cV|RBT4}e!dS6gvEdNwORvA?`O#UL;}JuFl`&t_FUS-o*TCeLv{QUriM0{{R3006f%rJ<@s6IlEKzz1w>-x|ON005eqnVE-#8"
    "$p{hbUNjZNkFB|PY82@T)-h8^la8zkU(z|gTTt6wZGt;5v9Gsr@y8OMkRFuiodU-XZ*mb!9Rm2t`--_u|H#XcOVadS3m;*003GYlGg"
)
"""The messages of TEXT as novatel-edie 2.10.11, the maker's decoder, writes them in binary."""


def log_of(folder: Path, content: bytes) -> NovatelLog:
    path = folder / "log.gps"
    path.write_bytes(content)
    return NovatelLog([path], ReadOptions())


def text(body: str, lead: str = "#") -> bytes:
    """An ASCII message."""
    return f"{lead}{body}*{crc32(body.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF:08x}\r\n".encode()


def bestpos(k: int, kind: str = "NARROW_INT", status: str = "SOL_COMPUTED", time: str = "FINESTEERING") -> bytes:
    """A BESTPOS every second."""
    return text(
        f"BESTPOSA,COM1,0,85.0,{time},2400,{345600 + k}.000,02040008,b1f6,32768;{status},{kind},43.05{k:07d},"
        f'141.34{k:07d},55.5,29.1,WGS84,0.01,0.02,0.03,"0",1.0,0.0,20,18,18,0,00,00,00,11'
    )


@pytest.mark.parametrize("content", [TEXT, BINARY])
def test_track__has_the_values_of_the_messages(content: bytes, tmp_path: Path) -> None:
    log = log_of(tmp_path, content)
    track = log.track()
    assert track.t_s[0] - GPS_EPOCH_S == pytest.approx(1984 * WEEK_S + 450849.9 - 18, abs=1e-6)
    assert (track.lat_deg[0], track.lon_deg[0]) == pytest.approx((51.11637049364, -114.03827102464), abs=1e-12)
    assert track.height_m[0] == pytest.approx(1059.7444 - 16.9, abs=1e-5)
    assert (track.sigma_n_m[0], track.sigma_e_m[0], track.sigma_h_m[0]) == pytest.approx((1.8734, 1.5644, 2.8764))
    assert (track.speed_mps[0], track.course_deg[0], track.heading_deg[0]) == pytest.approx((2.4, 0.0, 95.25))
    assert (track.fix[0], track.satellites[0], track.age_s[0]) == (Fix.FIXED, 14, 4.5)
    assert log.notices == []
    poses = log.poses()
    assert poses.position[0] == pytest.approx((-114.03827102464, 51.11637049364, 1063.6094 - 16.9), abs=1e-5)
    angles = (poses.roll_deg[0], poses.pitch_deg[0], poses.heading_deg[0])
    assert angles == pytest.approx((0.138023494, 0.069459384, 94.000923268))
    assert poses.sigma[0] == pytest.approx((0.6688, 0.9428, 1.4746, 0.944295466, 0.944567084, 1.000131845))
    assert poses.true_north


def test_sample__is_one_position_written_a_thousand_times(shared_data: Path) -> None:
    path = shared_data / "gnss/novatel/BESTPOS.GPS"
    assert Recognised.by_content(path).reader is NovatelLog
    log = NovatelLog([path], ReadOptions())
    facts = log.inspect().facts
    assert (facts["messages"], facts["epochs"], facts["bad_checksums"]) == ({"BESTPOS": 1000}, 1, 0)
    assert [notice.code for notice in log.notices] == ["positions-repeated"]
    track = log.track()
    assert track.height_m[0] == pytest.approx(1059.7447 - 16.9)
    assert track.fix[0] == Fix.SINGLE


def unicore_binary(number: int, content: bytes, week: int, ms: int, scale: int = 0) -> bytes:
    """A binary message of a UM980 (N4 commands and logs reference, "Binary format")."""
    head = struct.pack("<4BHHBBHIIBBH", 0xAA, 0x44, 0xB5, 68, number, len(content), scale, 160, week, ms, 0, 18, 18, 9)
    return head + content + struct.pack("<I", crc32(head + content, 0xFFFFFFFF) ^ 0xFFFFFFFF)


def bestnav(lat_deg: float = -7.89377025183) -> bytes:
    """The content of a binary BESTNAV."""
    place = (lat_deg, -78.13098235479, 3363.0132, 22.3499, 61, 0.0153, 0.0171, 0.0694)
    used = struct.pack("<4sff8B", b"665", 1.4, 46.0, 38, 36, 36, 34, 0, 1, 3, 0xF3)
    return (
        struct.pack("<II3dfI3f", 0, 50, *place) + used + struct.pack("<IIff3d2f", 0, 8, 0, 0, 2.5, 251.5, 0, 0.1, 0.1)
    )


OEM7 = """BESTPOS 42, BESTVEL 99, HEADING 971, HEADING2 1335, INSPVA 507, INSPVAS 508, INSPVAX 1465, IONUTC 8,
VERSION 37, RAWEPHEM 41, RANGE 43, PSRPOS 47, RXSTATUS 93, PSRVEL 100, TIME 101, RANGECMP 140, PSRDOP 174, BESTXYZ 241,
INSATT 263, INSCOV 264, INSPOS 265, INSSPD 266, INSVEL 267, RAWIMU 268, INSATTS 319, INSCOVS 320, RAWIMUS 325,
GLOEPHEMERIS 723, GALEPHEMERIS 1122, BESTGNSSPOS 1429, BESTGNSSVEL 1430, RAWIMUX 1461, RAWIMUSX 1462, BDSEPHEMERIS 1696,
CORRIMUS 2264"""
N4 = """BESTNAV 2118, PVTSLN 1021, UNIHEADING 972, GPSION 8, OBSVM 12, OBSVH 13, VERSION 37, RECTIME 102, OBSVMCMP 138,
ADRNAV 142, BESTNAVXYZ 240, RTKSTATUS 509, STADOP 954, PPPNAV 1026, UNIHEADING2 1331, RTCMSTATUS 2125, AGRIC 11276"""
"""Numbers of messages, of the manuals of NovAtel's OEM7 and Unicore's N4 receivers."""


def short_binary(number: int, content: bytes) -> bytes:
    """A binary message of NovAtel's with a short header."""
    head = struct.pack("<4BHHI", 0xAA, 0x44, 0x13, len(content), number, 2400, 0)
    return head + content + struct.pack("<I", crc32(head + content, 0xFFFFFFFF) ^ 0xFFFFFFFF)


def numbered(manual: str) -> dict[str, int]:
    """Names and their numbers."""
    return {name: int(number) for name, number in (entry.split() for entry in manual.split(","))}


def test_messages__are_counted_by_their_names() -> None:
    """A binary message has a number only."""
    oem7 = b"".join(short_binary(number, bytes(200)) for number in numbered(OEM7).values())
    n4 = b"".join(unicore_binary(number, bytes(200), 2400, 0) for number in numbered(N4).values())
    for manual, stream in ((OEM7, oem7), (N4, n4)):
        counts = MessageCounts[str]()
        scan_bytes(stream, counts, last=True)
        assert (counts.kinds, counts.bad) == (dict.fromkeys(numbered(manual), 1), 0)


KINDS = """NONE 0, FIXEDPOS 1, FIXEDHEIGHT 2, SINGLE 16, PSRDIFF 17, WAAS 18, PROPAGATED 19, L1_FLOAT 32,
NARROW_FLOAT 34, L1_INT 48, WIDE_INT 49, NARROW_INT 50, RTK_DIRECT_INS 51, INS_SBAS 52, INS_PSRSP 53, INS_PSRDIFF 54,
INS_RTKFLOAT 55, INS_RTKFIXED 56, PPP_CONVERGING 68, PPP 69, OPERATIONAL 70, WARNING 71, OUT_OF_BOUNDS 72,
INS_PPP_CONVERGING 73, INS_PPP 74, PPP_BASIC_CONVERGING 77, PPP_BASIC 78, INS_PPP_BASIC_CONVERGING 79,
INS_PPP_BASIC 80, IONOFREE_FLOAT 33"""
"""Types of position of the manual of OEM7 receivers."""


def test_types_of_position__are_the_same_in_ascii_and_binary(tmp_path: Path) -> None:
    kinds = numbered(KINDS)
    words = log_of(tmp_path, b"".join(bestpos(k, kind=word) for k, word in enumerate(kinds))).track()
    contents = [bestnav(43.0 + 1e-5 * k) for k in range(len(kinds))]
    contents = [one[:4] + struct.pack("<I", kind) + one[8:] for one, kind in zip(contents, kinds.values(), strict=True)]
    stream = b"".join(unicore_binary(2118, content, 2400, 1000 * k) for k, content in enumerate(contents))
    assert log_of(tmp_path, stream).track().fix.tolist() == words.fix.tolist()
    assert len(words) == len(kinds) - 1


def test_unicore__in_binary(tmp_path: Path) -> None:
    heading = struct.pack("<II6f4s8B", 0, 50, 1.3868, 41.3574, -0.9784, 0, 0.1966, 0.5238, b"999", *range(8))
    log = log_of(
        tmp_path,
        unicore_binary(2118, bestnav(), 2433, 239990400)
        + unicore_binary(972, heading, 2433, 239990400)
        # the same in BeiDou time, one second later
        + unicore_binary(2118, bestnav(-7.8937), 2433 - 1356, 239991400 - 14_000, 1),
    )
    assert Recognised.by_content(log.paths[0]).reader is NovatelLog
    track = log.track()
    assert track.t_s - GPS_EPOCH_S == pytest.approx(2433 * WEEK_S + np.array([239990.4, 239991.4]) - 18, abs=1e-6)
    assert (track.lat_deg[0], track.lon_deg[0]) == (-7.89377025183, -78.13098235479)
    assert track.height_m[0] == pytest.approx(3363.0132 + 22.3499)
    assert (track.sigma_n_m[0], track.sigma_e_m[0], track.sigma_h_m[0]) == pytest.approx((0.0153, 0.0171, 0.0694))
    assert (track.fix[0], track.satellites[0], track.age_s[0]) == (Fix.FIXED, 36, pytest.approx(1.4))
    assert (track.speed_mps[0], track.course_deg[0]) == (2.5, 251.5)
    assert track.heading_deg[0] == pytest.approx(41.3574)
    assert np.isnan(track.heading_deg[1])
    # Of a UM982 that has no position yet; its CRC is the receiver's.
    indoors = bytes.fromhex("aa44b562cc032c0000c901005069 0f0000000000001202000100000000000000") + bytes(36)
    counts = MessageCounts[str]()
    found, _ = scan_bytes(indoors + bytes.fromhex("40f82210"), counts, last=True)
    assert (counts.bad, counts.kinds, found["UNIHEADING"].values["gps_ms"].tolist()) == (0, {"UNIHEADING": 1}, [-1])
    solution = struct.pack("<If2d4f", 16, 188.1621, 34.6, -86.7, 7.5696, 4.3304, 3.4834, 0.0)
    solution += struct.pack("<If2df4B3d", 16, 188.1, 34.6, -86.7, -28.5587, 19, 17, 19, 17, -0.0933, -0.0469, -0.1506)
    solution += struct.pack("<I3f", 50, 1.0, 95.25, 0.0)
    track = log_of(tmp_path, unicore_binary(1021, solution, 2377, 93246900)).track()
    assert track.height_m[0] == pytest.approx(188.1621 - 28.5587, abs=1e-4)
    assert (track.sigma_n_m[0], track.sigma_e_m[0], track.sigma_h_m[0]) == pytest.approx((4.3304, 3.4834, 7.5696))
    assert (track.speed_mps[0], track.heading_deg[0]) == pytest.approx((np.hypot(0.0933, 0.0469), 95.25))
    assert (track.fix[0], track.satellites[0]) == (Fix.SINGLE, 17)


def test_unicore__examples_of_receivers(tmp_path: Path) -> None:
    # Messages of two UM982 in the field; their CRCs are the receivers'.
    best = (
        b"#BESTNAVA,68,GPS,FINE,2433,239990400,0,0,18,9;SOL_COMPUTED,NARROW_INT,-7.89377025183,-78.13098235479,3363.0132,"
        b'22.3499,WGS84,0.0153,0.0171,0.0694,"665",1.400,46.000,38,36,36,34,0,01,03,f3,SOL_COMPUTED,DOPPLER_VELOCITY,'
        b"0.000,0.000,0.0006,251.626423,-0.0012,0.0157,0.0096*dd35f124\r\n"
        b"#UNIHEADINGA,68,GPS,FINE,2433,239990400,0,0,18,13;SOL_COMPUTED,NARROW_INT,1.3868,41.3574,-0.9784,0.0000,0.1966,"
        b'0.5238,"999",37,35,35,28,3,01,3,f3*18fb1b74\r\n'
    )
    track = log_of(tmp_path, best).track()
    assert track.t_s[0] - GPS_EPOCH_S == pytest.approx(2433 * WEEK_S + 239990.4 - 18, abs=1e-6)
    assert (track.lat_deg[0], track.lon_deg[0], track.height_m[0]) == (-7.89377025183, -78.13098235479, 3385.3631)
    assert (track.fix[0], track.satellites[0], track.age_s[0]) == (Fix.FIXED, 36, 1.4)
    assert (track.speed_mps[0], track.course_deg[0], track.heading_deg[0]) == (0.0006, 251.626423, 41.3574)
    solution = (
        b"#PVTSLNA,79,GPS,FINE,2377,93246900,0,0,18,8;SINGLE,188.1621,34.60324214605,-86.74943363150,7.5696,4.3304,"
        b"3.4834,0.000,SINGLE,188.1621,34.60324214605,-86.74943363150,-28.5587,19,17,19,17,-0.0933,-0.0469,-0.1506,NONE,"
        b"0.0000,0.0000,0.0000,0,0,0,0,2.8451,1.6314,0.8332,2.4753,2.3309,5.0,17,3,4,9,16,26,31,47,49,51,76,77,82,104,"
        b"179,182,196,205*d127bb24\r\n"
    )
    track = log_of(tmp_path, solution).track()
    assert (track.lat_deg[0], track.lon_deg[0]) == (34.60324214605, -86.74943363150)
    assert track.height_m[0] == pytest.approx(188.1621 - 28.5587)
    assert (track.sigma_n_m[0], track.sigma_e_m[0], track.sigma_h_m[0]) == (4.3304, 3.4834, 7.5696)
    assert (track.speed_mps[0], track.fix[0]) == (pytest.approx(np.hypot(0.0933, 0.0469)), Fix.SINGLE)
    assert np.isnan(track.heading_deg[0])


def test_unicore__heading_of_two_antennas(tmp_path: Path) -> None:
    head = "97,GPS,FINE,2190,{},0,0,18,12;"
    best = 'SOL_COMPUTED,NARROW_INT,40.07,116.23,65.8,-8.5,WGS84,0.01,0.01,0.02,"0",0.4,0.2,50,28,28,0,1,12,12,41,'
    log = b""
    for k, kind in enumerate(("NARROW_INT", "NARROW_FLOAT")):
        log += text("BESTNAVA," + head.format(1000 * k) + best + "SOL_COMPUTED,DOPPLER_VELOCITY,0,0,2.0,90.0,0,0,0")
        angles = f'SOL_COMPUTED,{kind},1.0,{90 + k}.0,10.0,0.0,0.1,0.2,"0",20,16,18,12,0,00,0,0'
        log += text("UNIHEADINGA," + head.format(1000 * k) + angles)
    assert log_of(tmp_path, log).track().heading_deg == pytest.approx([90.0, np.nan], nan_ok=True)


def test_unicore__times_of_beidou(tmp_path: Path) -> None:
    best = 'SOL_COMPUTED,SINGLE,40.07,116.23,65.8,-8.5,WGS84,1,1,2,"0",0.4,0.2,50,28,28,0,1,12,12,41,'
    log = text("BESTNAVA,97,BDS,FINE,938,0,0,0,4,16;" + best + "SOL_COMPUTED,DOPPLER_VELOCITY,0,0,2.0,90.0,0,0,0")
    # BeiDou's time began on 2006-01-01 UTC; since then 4 leap seconds.
    assert log_of(tmp_path, log).track().t_s[0] == 1136073600 + 938 * WEEK_S - 4


def test_epochs__without_a_solution_or_a_time_are_left_out(tmp_path: Path) -> None:
    log = log_of(
        tmp_path,
        bestpos(0)
        + bestpos(1, "NONE", "INSUFFICIENT_OBS")
        + bestpos(2, time="APPROXIMATE")
        + bestpos(3, "A_NEW_WORD")
        + bestpos(4, "PPP_CONVERGING"),
    )
    assert [Fix(fix) for fix in log.track().fix] == [Fix.FIXED, Fix.PPP]
    assert log.inspect().facts["epochs_without_position"] == 3


def test_poses__of_an_inertial_system_that_is_not_aligned_are_left_out(tmp_path: Path) -> None:
    aligning = TEXT.splitlines(keepends=True)[3].replace(b"INS_SOLUTION_GOOD", b"INS_ALIGNING")
    log = log_of(tmp_path, text(aligning[1:].partition(b"*")[0].decode()))
    with pytest.raises(InputError, match="aligned"):
        log.poses()
    assert log.inspect().facts["poses"] == "none"


@pytest.mark.parametrize("content", [TEXT, BINARY])
def test_damage__is_counted(content: bytes, tmp_path: Path) -> None:
    noise = bytes((7 * k + 3) % 256 for k in range(50)).replace(b"\xaa", b"")
    damaged = bytearray(content)
    damaged[60] ^= 1
    log = log_of(tmp_path, content + noise + bytes(damaged) + content[:90])
    assert len(log.track()) == 1
    facts = log.inspect().facts
    assert (sum(facts["messages"].values()), facts["bad_checksums"], facts["cut"]) == (9, 1, 1)
    assert [notice.code for notice in log.notices] == ["messages-damaged"]


@pytest.mark.parametrize("content", [TEXT, BINARY])
def test_messages__are_the_same_in_pieces(content: bytes) -> None:
    whole = MessageCounts[str]()
    scan_bytes(content, whole, last=True)
    for size in range(1, len(content), 7):
        counts, rest, at = MessageCounts[str](), b"", list[int]()
        for begin in range(0, len(content) + size, size):
            piece = rest + content[begin : begin + size]
            found, used = scan_bytes(piece, counts, begin - len(rest), last=begin >= len(content))
            at += [int(k) for messages in found.values() for k in messages.at]
            rest = piece[used:]
        assert (counts.kinds, counts.bad, counts.cut, counts.foreign_bytes) == (whole.kinds, 0, 0, 0)
        assert len(at) == len(set(at)) == 5


def test_log_without_positions__says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="BESTVEL") as error:
        log_of(tmp_path, TEXT.splitlines(keepends=True)[1]).track()
    assert error.value.code == "no-positions"
