"""Seconds to read an hour at 10 Hz of each kind of log; with a folder, also the content of every log in it, as a table.

``python benchmarks/gnss_logs.py [FOLDER]``. The hours are of NAV-PVT, NAV-HPPOSLLH and NAV-COV (UBX), of PVTGeodetic,
PosCovGeodetic and AttEuler (SBF), of RTKLIB's calendar style (.pos) and of GGA, RMC and GST (NMEA). Each figure is the
best of three readings, the first one (which may compile) left out; processor time, as others load the machine.
"""

from __future__ import annotations

import functools
import operator
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.reader import GivesTrack, ReadOptions, Recognised
from furrowmap.core.readers.sbf.log import ATT_EULER, COV_GEODETIC, GEODETIC
from furrowmap.core.readers.sbf.log import SBF_LAYOUTS as SBF
from furrowmap.core.readers.ubx.log import NAV_COV, NAV_HPPOSLLH, NAV_PVT
from furrowmap.core.readers.ubx.log import UBX_LAYOUTS as UBX
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix

EPOCHS = 36_000
WEEK, TOW_MS = 2422, 302_400_000
BEGIN = "2026-06-10T12:00:00"
GPS_AHEAD_MS = 18_000
A_TUESDAY = "2025-09-09"
"""The day on which the logs of the week's time alone begin."""
Rows = NDArray[np.uint8]


def rows_of(layout: np.dtype[np.void], size: int, **columns: object) -> Rows:
    """Messages (EPOCHS, size) of bytes."""
    record = np.zeros(EPOCHS, layout)
    for name, values in columns.items():
        record[name] = values
    out = np.zeros((EPOCHS, size), np.uint8)
    fields = layout.fields
    assert fields is not None
    for name, (kind, offset, *_) in fields.items():
        out[:, offset : offset + kind.itemsize] = np.ascontiguousarray(record[name]).view(np.uint8).reshape(EPOCHS, -1)
    return out


def ubx_frames(kind: int, payload: Rows) -> Rows:
    size = payload.shape[1]
    head = np.tile(np.array([0xB5, 0x62, kind >> 8, kind & 255, size & 255, size >> 8], np.uint8), (EPOCHS, 1))
    frame = np.concatenate([head, payload, np.zeros((EPOCHS, 2), np.uint8)], axis=1)
    for column in range(2, size + 6):
        frame[:, -2] += frame[:, column]
        frame[:, -1] += frame[:, -2]
    return frame


def sbf_frames(kind: int, block: Rows) -> Rows:
    size = block.shape[1]
    block[:, :2] = np.frombuffer(b"$@", np.uint8)
    block[:, 4:8] = np.array([kind, size], "<u2").view(np.uint8)
    check = np.zeros(EPOCHS, np.uint16)
    for column in range(4, size):  # CRC-CCITT
        check ^= block[:, column].astype(np.uint16) << 8
        for _ in range(8):
            check = np.where(check & 0x8000, (check << 1) ^ 0x1021, check << 1).astype(np.uint16)
    block[:, 2:4] = check[:, None].astype("<u2").view(np.uint8)
    return block


def interleaved(frames: list[Rows]) -> bytes:
    return np.concatenate(frames, axis=1).tobytes()


def ubx_hour() -> bytes:
    k = np.arange(EPOCHS)
    tow = TOW_MS + GPS_AHEAD_MS + 100 * k
    seconds = k // 10
    lon, lat, height = 1_400_000_000 + k, 361_000_000 + k, 60_000 + k % 7
    place = {"lon": lon, "lat": lat, "height": height, "h_acc": 14, "v_acc": 20}
    pvt = rows_of(
        UBX[NAV_PVT], 92, itow=tow, year=2026, month=6, day=10, hour=12 + seconds // 3600, minute=seconds // 60 % 60,
        second=seconds % 60, valid=7, nano=k % 10 * 100_000_000, kind=3, flags=0b1000_0011, satellites=20, speed=1500,
        course=9_000_000, **place,
    )  # fmt: skip
    hp = rows_of(UBX[NAV_HPPOSLLH], 36, itow=tow, lon_hp=k % 90, lat_hp=-(k % 90), height_hp=k % 9, **place)
    cov = rows_of(UBX[NAV_COV], 64, itow=tow, valid=1, nn=1e-4, ee=1e-4, dd=4e-4)
    return interleaved([ubx_frames(NAV_PVT, pvt), ubx_frames(NAV_HPPOSLLH, hp), ubx_frames(NAV_COV, cov)])


def sbf_hour() -> bytes:
    k = np.arange(EPOCHS)
    stamp = {"tow": TOW_MS + GPS_AHEAD_MS + 100 * k, "week": WEEK}
    pvt = rows_of(
        SBF[GEODETIC], 96, **stamp, mode=4, lon=np.radians(140 + 1e-7 * k), lat=np.radians(36.1 + 1e-7 * k),
        height=60.0, vn=1.0, ve=1.0, course=45.0, satellites=20, age=100,
    )  # fmt: skip
    cov = rows_of(SBF[COV_GEODETIC], 56, **stamp, nn=1e-4, ee=1e-4, hh=4e-4)
    attitude = rows_of(SBF[ATT_EULER], 44, **stamp, mode=4, heading=45.0)
    return interleaved([sbf_frames(GEODETIC, pvt), sbf_frames(COV_GEODETIC, cov), sbf_frames(ATT_EULER, attitude)])


def clocks(offset_s: int) -> list[np.datetime64]:
    return list(np.datetime64(BEGIN, "ms") + np.timedelta64(offset_s, "s") + 100 * np.arange(EPOCHS))


def pos_hour() -> bytes:
    head = "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n"
    rows = [
        f"{str(t).replace('-', '/').replace('T', ' ')}   {36.1 + 1e-7 * k:.9f}  {140 + 1e-7 * k:.9f}    60.0000   1  20"
        "   0.0100   0.0100   0.0200   0.0000   0.0000   0.0000   1.00   5.0"
        for k, t in enumerate(clocks(18))
    ]
    return (head + "\n".join(rows) + "\n").encode()


def sentence(body: str) -> str:
    return f"${body}*{functools.reduce(operator.xor, body.encode(), 0):02X}\r\n"


def nmea_hour() -> bytes:
    out = []
    for k, t in enumerate(clocks(0)):
        tod = str(t)[11:22].replace(":", "")
        place = f"3606.{k:08d},N,14000.{k:08d},E"
        out.append(sentence(f"GNGGA,{tod},{place},4,20,0.8,20.0,M,40.0,M,1.0,0001"))
        out.append(sentence(f"GNRMC,{tod},A,{place},3.0,45.0,100626,,,R,V"))
        out.append(sentence(f"GNGST,{tod},0.01,0.01,0.01,0.0,0.01,0.01,0.02"))
    return "".join(out).encode()


def best_s(path: Path) -> float:
    """Processor seconds of the fastest of three readings."""
    seconds = []
    for _ in range(4):
        began = time.process_time()
        reader = Recognised.by_content(path).open()
        assert isinstance(reader, GivesTrack)
        track = reader.track()
        seconds.append(time.process_time() - began)
    assert len(track) == EPOCHS, (path, len(track))
    assert (track.fix == Fix.FIXED).all()
    return min(seconds[1:])


def told(path: Path, options: ReadOptions | None = None) -> tuple[str, str]:
    """A log's format, and its content or why it cannot be read; one without a date gets one."""
    try:
        recognised = Recognised.by_content(path)
    except InputError as error:
        return "–", f"error: {error.lines[0]}"
    try:
        reader = recognised.open(options)
        assert isinstance(reader, GivesTrack)
        track = reader.track()
    except InputError as error:
        if error.code == "no-date" and options is None:
            kind, words = told(path, ReadOptions(date=A_TUESDAY))
            return kind, f"needs the date; with it: {words.replace(A_TUESDAY, '…')}"
        return recognised.reader.format, f"error: {error.lines[0]}"
    kinds = Counter(Fix(fix).label for fix in track.fix.tolist()).most_common()
    counts = ", ".join(f"{count:,} {label}" for label, count in kinds)
    return recognised.reader.format, f"{counts}; {iso_utc(float(track.t_s[0]))}, {track.t_s[-1] - track.t_s[0]:,.1f} s"


def main() -> None:
    print("| log of an hour at 10 Hz | MB | s |\n| --- | ---: | ---: |")
    with tempfile.TemporaryDirectory() as folder:
        for name, made in (("ubx", ubx_hour), ("sbf", sbf_hour), ("pos", pos_hour), ("nmea", nmea_hour)):
            path = Path(folder, f"hour.{name}")
            path.write_bytes(made())
            print(f"| {name} | {path.stat().st_size / 1e6:.1f} | {best_s(path):.2f} |", flush=True)
    for root in map(Path, sys.argv[1:]):
        print("\n| log | read as | what it holds |\n| --- | --- | --- |")
        for path in sorted(path for path in root.rglob("*") if path.is_file() and path.suffix not in (".txt", ".csv")):
            kind, words = told(path)
            words = words.replace(f"{path}", path.name).replace("|", "/")
            print(f"| {path.relative_to(root).as_posix()} | {kind} | {words} |")


if __name__ == "__main__":
    main()
