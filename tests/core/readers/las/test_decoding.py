"""The process that decodes points, spoken to directly: what it answers is what laspy reads."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
import pytest

from furrowmap.core.readers.las import decoding
from furrowmap.core.readers.las.cloud import open_cloud
from tests.fuzz.recordings import las

POINTS = 500


def answers(*orders: dict[str, Any]) -> list[tuple[int, bytes]]:
    """Length and content of each answer."""
    done = subprocess.run(
        [sys.executable, decoding.__file__, str(Path(lazrs.__file__).parents[1])],
        input="".join(json.dumps(order) + "\n" for order in orders).encode(),
        capture_output=True,
        check=True,
        timeout=60,
    )
    out, at = [], 0
    while at < len(done.stdout):
        (length,) = struct.unpack_from("<q", done.stdout, at)
        out.append((length, done.stdout[at + 8 : at + 8 + abs(length)]))
        at += 8 + abs(length)
    assert at == len(done.stdout)
    assert done.stderr == b""
    return out


@pytest.mark.parametrize("number", [0, 3, 6])
def test_orders__are_answered_with_the_records_or_why_there_are_none(number: int, tmp_path: Path) -> None:
    path = tmp_path / "a.laz"
    path.write_bytes(las(number, POINTS, compressed=True))
    cloud = open_cloud(path)
    laz = cloud.laz
    assert laz is not None
    begin, end = int(laz.begins[0]), int(laz.begins[-1] + laz.sizes[-1])
    chunks = {
        "what": "chunks", "path": str(path), "begin": begin, "bytes": end - begin, "vlr": laz.vlr.hex(),
        "table": list(zip(laz.points.tolist(), laz.sizes.tolist(), strict=True)), "size": POINTS * laz.record_bytes,
    }  # fmt: skip
    stream = {"what": "stream", "path": str(path), "offset": cloud.header.offset, "vlr": laz.vlr.hex()}
    first, rest = 123 * laz.record_bytes, (POINTS - 123) * laz.record_bytes
    found = answers(
        chunks,
        stream | {"size": first},
        {"what": "more", "size": rest},
        {"what": "else"},
        chunks | {"path": str(tmp_path / "gone.laz")},
        stream | {"size": first},
    )
    with laspy.open(path) as reader:
        whole = reader.read().points.array.tobytes()
    assert found[0] == (len(whole), whole)
    assert found[1] == found[5] == (first, whole[:first])
    assert found[2] == (rest, whole[first:])
    for length, text in found[3:5]:
        assert length == -len(text) < 0
    assert b"gone.laz" in found[4][1]
    assert answers() == []


def test_answer__about_a_fault_is_short(tmp_path: Path) -> None:
    ((length, text),) = answers({"what": "stream", "path": "x" * 200 + "/" * 3000, "offset": 0, "vlr": "", "size": 1})
    assert length == -len(text) == -1000
    assert np.frombuffer(text, np.uint8).max() < 128
