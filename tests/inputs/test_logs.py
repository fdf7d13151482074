"""Logs of positions in text, written in the ways of others, in every place that takes them: the same positions."""

from __future__ import annotations

import codecs
import gzip
import lzma
import re
from collections.abc import Callable, Mapping
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from furrowmap.core.readers.reader import GivesTrack, ReadOptions, Recognised, open_recording
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.workflows.gnss.evaluate import evaluate_gnss
from tests.inputs.texts import zstd

EPOCHS = 20
LAT_DEG = 52.0 + 1e-6 * np.arange(EPOCHS)


def sentence(body: str) -> str:
    return f"${body}*{reduce(lambda a, b: a ^ b, body.encode()):02X}\n"


def nmea() -> str:
    lines = ""
    for k, lat in enumerate(LAT_DEG.tolist()):
        minutes = f"52{60 * (lat - 52.0):010.7f},N,01000.0000000,E"
        lines += sentence(f"GNZDA,0900{k:02d}.00,12,05,2026,00,00")
        lines += sentence(f"GNGGA,0900{k:02d}.00,{minutes},4,12,0.6,55.0,M,45.0,M,1.0,0001")
    return lines


def pos() -> str:
    head = "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  age(s)  ratio\n"
    return head + "".join(
        f"2026/05/12 09:00:{k:02d}.000 {lat:.9f} 10.000000000 100.0000 1 9 0.01 0.01 0.02 0.00 0.00 0.00 0.50 9.9\n"
        for k, lat in enumerate(LAT_DEG.tolist())
    )


FORMATS: Mapping[str, Callable[[], str]] = {"NMEA 0183": nmea, "RTKLIB's .pos": pos}
WAYS: Mapping[str, Callable[[str], bytes]] = {
    "newlines": lambda text: text.encode(),
    "carriage returns": lambda text: text.replace("\n", "\r\n").encode(),
    "a byte order mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "UTF-16, little-endian": lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le"),
    "UTF-16, big-endian": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
    "UTF-16 without a byte order mark": lambda text: text.encode("utf-16-le"),
    "gzip": lambda text: gzip.compress(text.encode()),
    "gzip of several members": lambda text: gzip.compress(text[:400].encode()) + gzip.compress(text[400:].encode()),
    "Zstandard": lambda text: zstd.compress(text.encode()),
    "xz": lambda text: lzma.compress(text.encode()),
    "empty lines": lambda text: text.replace("\n", "\n\n").encode(),
    "the first bytes lost": lambda text: (text[3:] if text.startswith("$") else text).encode(),
}
TAG_BLOCK = r"\\s:r1,c:1778576400*76\\"
"""NMEA 4.10, 7; written as a template of regular expressions."""


def in_feet(text: str) -> str:
    feet = f",{55.0 / 0.3048:.5f},F,{45.0 / 0.3048:.5f},F,"
    lines = [line[1:].split("*")[0].replace(",55.0,M,45.0,M,", feet) for line in text.splitlines()]
    return "".join(map(sentence, lines))


OF_NMEA: Mapping[str, Callable[[str], bytes]] = {
    "no checksums": lambda text: re.sub(r"\*..\n", "\n", text).encode(),
    "spaces after checksums": lambda text: text.replace("\n", "  \n").encode(),
    "times of arrival before the lines": lambda text: re.sub(
        r"^", "2026-05-12T09:00:00Z ", text, flags=re.MULTILINE
    ).encode(),
    "tag blocks before the lines": lambda text: re.sub(r"^", TAG_BLOCK, text, flags=re.MULTILINE).encode(),
    "lower-case checksums": lambda text: re.sub(r"\*..", lambda found: found[0].lower(), text).encode(),
    "altitudes in feet": lambda text: in_feet(text).encode(),
    "binary messages between the lines": lambda text: text.encode().replace(
        b"$GNZDA", b"\xd3\x00\x04\x00\x01$\x02$GNZDA"
    ),
}
ALL = (
    *(f"{form}: {way}" for form in FORMATS for way in WAYS),
    *(f"NMEA 0183: {way}" for way in OF_NMEA),
    *(f"{form}: a symbolic link" for form in FORMATS),
)


def log(folder: Path, stated: str) -> Path:
    form, way = stated.split(": ")
    path = folder / "log"
    if way == "a symbolic link":
        (folder / "target").write_text(FORMATS[form](), newline="")
        path.symlink_to("target")
    else:
        path.write_bytes({**WAYS, **OF_NMEA}[way](FORMATS[form]()))
    return path


def by_session(path: Path) -> FloatArray:
    reader = open_recording([path], ReadOptions())
    assert isinstance(reader, GivesTrack)
    track = reader.track()
    np.testing.assert_allclose(track.height_m, 100.0, atol=1e-4)
    return track.lat_deg


def by_inspect(path: Path) -> FloatArray:
    facts: dict[str, Any] = Recognised.by_content(path).inspect().facts
    assert facts["epochs"] == EPOCHS
    return LAT_DEG


def by_evaluate(path: Path) -> FloatArray:
    """Held against the plain log, and the plain log against it."""
    plain = path.with_name("plain")
    plain.write_text(nmea() if Recognised.by_content(path).reader.format == "nmea" else pos())
    there = evaluate_gnss({"log": path}, plain)["log"]
    back = evaluate_gnss({"log": plain}, path)["log"]
    assert len(there.fix) == len(back.fix) == EPOCHS
    return there.lat_deg


PLACES: Mapping[str, Callable[[Path], FloatArray]] = {
    "[recording] gnss": by_session,
    "inspect, init": by_inspect,
    "gnss evaluate": by_evaluate,
}
PROPERTIES = ALL
REFUSED: tuple[str, ...] = ()


ACROSS = "across 180°"
LON_DEG = 180.0 + 1e-6 * (np.arange(EPOCHS) - 9.5)


def east_of(lon: float) -> float:
    return (lon + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("form", FORMATS)
def test_logs__across_180_degrees_are_one_drive(form: str, tmp_path: Path) -> None:
    lines = FORMATS[form]().splitlines(keepends=True)
    places = (lon for lon in LON_DEG.tolist())
    text = ""
    for line in lines:
        if "01000.0000000,E" in line:
            lon = east_of(next(places))
            body = f"{int(abs(lon)):03d}{60 * (abs(lon) % 1):010.7f},{'E' if lon > 0 else 'W'}"
            line = sentence(line[1:].split("*")[0].replace("01000.0000000,E", body))
        elif " 10.000000000 " in line:
            line = line.replace(" 10.000000000 ", f" {east_of(next(places)):.9f} ")
        text += line
    path = tmp_path / "log"
    path.write_text(text)
    reader = open_recording([path], ReadOptions())
    assert isinstance(reader, GivesTrack)
    off = east_of(np.asarray(reader.track().lon_deg) - LON_DEG)  # type: ignore[arg-type]
    np.testing.assert_allclose(off, 0.0, rtol=0, atol=1e-9)
    place = Recognised.by_content(path).inspect().facts["place"]
    assert abs(place["lon_deg"]) == pytest.approx(180.0, abs=1e-4)
    (tmp_path / "same").write_text(text)
    evaluated = evaluate_gnss({"log": path}, tmp_path / "same")["log"]
    assert len(evaluated.fix) == EPOCHS


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stated", ALL)
def test_positions__do_not_depend_on_how_a_log_is_written(stated: str, place: str, tmp_path: Path) -> None:
    np.testing.assert_allclose(PLACES[place](log(tmp_path, stated)), LAT_DEG, rtol=0, atol=1e-9)
