"""Logs of receivers, trajectories, states of the tool and task data."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import pysbf2
import pyubx2

from furrowmap.core.readers.novatel.log import crc
from tests.core.coverage.section_tasks import elements_xml
from tests.core.readers.isoxml.time_logs import Record, header, task_data
from tests.core.readers.test_gsof import epoch, transmission
from tests.core.readers.test_novatel import BINARY, TEXT, bestnav, bestpos, unicore_binary
from tests.core.readers.test_sbet import records
from tests.core.readers.test_sbf import pvt
from tests.fuzz.mutations import Files
from tests.fuzz.reading import EACH_WAY, OF_THE_FOLDER
from tests.fuzz.trials import Entry

_NOVATEL_TEXT = re.compile(rb"([#%])([^#*\r\n]*)\*[0-9A-Fa-f]{8}")
_SENTENCE = re.compile(rb"\$([^*\r\n]*)\*[0-9A-Fa-f]{2}")


def nmea(count: int = 6) -> bytes:
    """GGA, RMC, GST, HDT, PASHR and PUBX of a receiver."""
    lines = []
    for k in range(count):
        time = f"0804{k:02d}.00"
        lines += [
            f"$GNGGA,{time},4303.{5000 + 7 * k:04d},N,14120.{4000 + 9 * k:04d},E,4,20,0.6,55.5,M,29.1,M,1.0,0000*00",
            f"$GNRMC,{time},A,4303.{5000 + 7 * k:04d},N,14120.{4000 + 9 * k:04d},E,2.1,53.1,110626,,,R*00",
            f"$GNGST,{time},1.0,0.02,0.01,40.0,0.011,0.012,0.025*00",
            f"$GNHDT,{53.1 + 0.1 * k:.2f},T*00",
            f"$PASHR,{time},{53.1 + 0.1 * k:.2f},T,+01.50,-00.50,+00.00,0.1,0.1,0.2,2,1*00",
            f"$PUBX,00,{time},4303.5,N,14120.4,E,84.6,D3,0.1,0.2,7.5,53.1,-0.01,1,0.6,0.9,0.5,20,0,0*00",
        ]
    return mend_nmea("\r\n".join([*lines, ""]).encode())


def mend_nmea(data: bytes) -> bytes:
    """With right checksums."""

    def mended(match: re.Match[bytes]) -> bytes:
        total = 0
        for byte in match[1]:
            total ^= byte
        return b"$%s*%02X" % (match[1], total)

    return _SENTENCE.sub(mended, data)


def ubx(count: int = 10) -> bytes:
    """NAV-PVT of a receiver."""
    frames = []
    for k in range(count):
        payload = bytearray(92)
        struct.pack_into("<IHBBBBBBIi", payload, 0, 360_000_000 + 1000 * k, 2026, 6, 11, 8, 4, k, 7, 20, 0)
        place = (1_413_400_000, 430_500_000 + 90 * k, 84_600, 55_500, 14, 20)
        struct.pack_into("<BBBBiiiiII", payload, 20, 3, 0x83, 0, 20, *place)
        frames.append(pyubx2.UBXMessage(b"\x01", b"\x07", pyubx2.GET, payload=bytes(payload)).serialize())
    return b"".join(frames)


def mend_ubx(data: bytes) -> bytes:
    out, at = bytearray(data), data.find(b"\xb5\x62")
    while at >= 0 and at + 8 <= len(out):
        end = at + 6 + int.from_bytes(out[at + 4 : at + 6], "little")
        if end + 2 <= len(out):
            out[end : end + 2] = pyubx2.calc_checksum(bytes(out[at + 2 : end]))
        at = out.find(b"\xb5\x62", at + 2)
    return bytes(out)


def mend_sbf(data: bytes) -> bytes:
    out, at = bytearray(data), data.find(b"$@")
    while at >= 0 and at + 8 <= len(out):
        end = at + int.from_bytes(out[at + 6 : at + 8], "little")
        if at + 8 < end <= len(out):
            out[at + 2 : at + 4] = pysbf2.calc_crc(bytes(out[at + 4 : end])).to_bytes(2, "little")
        at = out.find(b"$@", at + 2)
    return bytes(out)


def mend_novatel(data: bytes) -> bytes:
    def mended(match: re.Match[bytes]) -> bytes:
        return b"%s%s*%08x" % (match[1], match[2], crc(match[2]))

    out = bytearray(_NOVATEL_TEXT.sub(mended, data))
    for sync in (b"\xaaD\x12", b"\xaaD\xb5"):
        at = out.find(sync)
        while at >= 0 and at + 10 <= len(out):
            header, length_at = (out[at + 3], 8) if sync[2] == 0x12 else (24, 6)
            end = at + header + int.from_bytes(out[at + length_at : at + length_at + 2], "little")
            if end + 4 <= len(out):
                out[end : end + 4] = crc(bytes(out[at:end])).to_bytes(4, "little")
            at = out.find(sync, at + 3)
    return bytes(out)


def gsof() -> bytes:
    """Transmissions of a receiver, of two pages each."""
    return b"".join(b"".join(transmission(epoch(k), k)) for k in range(8))


def mend_gsof(data: bytes) -> bytes:
    out, at = bytearray(data), data.find(2)
    while at >= 0 and at + 4 <= len(out):
        end = at + out[at + 3] + 6
        if end <= len(out) and out[end - 1] == 3:
            out[end - 2] = sum(out[at + 1 : end - 2]) & 0xFF
            at = end - 1
        at = out.find(2, at + 1)
    return bytes(out)


def pos() -> bytes:
    head = "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"
    rows = [
        f"2026/06/11 08:04:{k:02d}.000   43.05{k:07d}  141.34{k:07d}  84.6  1  20  0.01  0.01  0.02" for k in range(15)
    ]
    return (head + "\n".join(rows) + "\n").encode()


def poses() -> bytes:
    head = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
    rows = [f"{1781141019.8 + k / 100:.4f},{100 + k},200.5,30.25,1.5,-0.5,{(359 + k) % 360}" for k in range(20)]
    return "\n".join([head, *rows, ""]).encode()


def imu() -> bytes:
    head = "time_gps_s,gyro_x_dps,gyro_y_dps,gyro_z_dps,accel_x_g,accel_y_g,accel_z_g"
    rows = [f"{194530.8 + k / 200:.4f},{k},-0.5,{3 * k},0.01,-0.02,{1 + k / 100}" for k in range(20)]
    return "\n".join([head, *rows, ""]).encode()


def novatel_seeds(folder: Path) -> list[Files]:
    unicore = b"".join(unicore_binary(2118, bestnav(43.0 + 1e-6 * k), 2400, 1000 * k) for k in range(12))
    ins = TEXT.splitlines(keepends=True)[3].replace(b",1984,450849.", b",2400,345600.")
    return [
        {"gnss.gps": mend_novatel(b"".join(bestpos(k) for k in range(12)) + ins)},
        {"gnss.bin": BINARY + TEXT},
        {"gnss.dat": unicore + mend_novatel(ins)},
    ]


STATES = b"time,state\n2026-06-11T08:00:00Z,up\n2026-06-11T08:00:10.5Z,down\n2026-06-11T17:01:00+09:00,unknown\n"


def task_seeds(folder: Path) -> list[Files]:
    position = {"A": 430500000, "B": 1413400000, "D": 4}
    rows = [Record(29_000_000 + 1000 * k, 16967, position | {"A": 430500000 + 200 * k}, {0: k % 2}) for k in range(15)]
    body = '<TSK A="TSK1" G="4"><TLG A="TLG00001"/></TSK><DVC A="DVC1"><DET A="DET-1" B="1" C="1" E="0" F="0"/></DVC>'
    log = (header([(141, "DET-1")]), b"".join(row.pack() for row in rows))
    made = task_data(folder / "TASKDATA", body, {"TLG00001": log})
    return [{path.name: path.read_bytes() for path in sorted(made.iterdir())}, *section_seeds(folder)]


def section_seeds(folder: Path) -> list[Files]:
    """A drawn drill with four sections: condensed states, states of two of them, and widths in the header."""
    tractor = [("1", 1, 0, {}), ("7", 2, 1, {134: 900, 135: 100}), ("6", 3, 1, {134: -1100, 157: 1})]
    parts = [("4", 10 + k, 3, {135: 1000 * k - 1500, 134: -1200}) for k in range(4)]
    drill = [("1", 1, 0, {}), ("6", 2, 1, {134: 4500, 157: 1}), ("2", 3, 1, {}), *parts]
    machines = elements_xml("DVC-1", tractor, name="tractor") + elements_xml("DVC-2", drill, name="drill")
    joined = '<CNN A="DVC-1" B="DVC-1-3" C="DVC-2" D="DVC-2-2"/>'
    names = [f"DVC-2-{10 + k}" for k in range(4)]
    channels = [(161, "DVC-2-3"), (141, names[0]), (141, names[1]), *((67, name) for name in names)]
    rows = [
        Record(
            29_000_000 + 1000 * k, 16967, {"A": 430500000 + 200 * k, "B": 1413400000, "D": 4}, {0: 85 >> k % 9, 1: 1}
        )
        for k in range(15)
    ]
    log = header(channels, constants={3 + k: 1000 for k in range(4)}), b"".join(row.pack() for row in rows)
    body = f'{machines}<TSK A="TSK1" G="4">{joined}<TLG A="TLG00001"/></TSK>'
    made = task_data(folder / "SECTIONS", body, {"TLG00001": log})
    return [{path.name: path.read_bytes() for path in sorted(made.iterdir())}]


POSITIONS = (
    Entry("nmea", lambda folder: [{"gnss.nmea": nmea()}], EACH_WAY, mend_nmea),
    Entry("ubx", lambda folder: [{"gnss.ubx": ubx()}], EACH_WAY, mend_ubx),
    Entry("sbf", lambda folder: [{"gnss.sbf": b"".join(pvt(1000 * k) for k in range(12))}], EACH_WAY, mend_sbf),
    Entry("gsof", lambda folder: [{"gnss.gsof": gsof()}], EACH_WAY, mend_gsof),
    Entry("novatel", novatel_seeds, EACH_WAY, mend_novatel),
    Entry("rtklib-pos", lambda folder: [{"solution.pos": pos()}], EACH_WAY),
    Entry("pose-csv", lambda folder: [{"trajectory.csv": poses()}], EACH_WAY),
    Entry("imu-csv", lambda folder: [{"imu.csv": imu()}], EACH_WAY),
    Entry("states-csv", lambda folder: [{"states.csv": STATES}], EACH_WAY),
    Entry("sbet", lambda folder: [{"mission.sbet": records(40).astype("<f8").tobytes()}], EACH_WAY),
    Entry("task-data", task_seeds, OF_THE_FOLDER),
)
