"""The how-to's reader of a new sensor, taken from the page, in a package of its own."""

from __future__ import annotations

import gzip
import json
import os
import re
import struct
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "add-a-sensor.md"

LOOK = """
import json, sys
from pathlib import Path
from furrowmap.core.readers.reader import GivesScans, ReadOptions, Recognised, open_recording
from furrowmap.core.runtime.errors import FurrowmapError

paths = [Path(p) for p in sys.argv[1:]]
try:
    reader = open_recording(paths, ReadOptions())
    assert isinstance(reader, GivesScans)
    scans = [[s.number, len(s), s.whole, s.t_s[0], s.xyz_m[-1].tolist()] for s in reader.scans()]
    inspection = Recognised.by_content(paths[0]).inspect()
    clock = reader.clocks[0]
    print(json.dumps({
        "scans": scans, "share": reader.share_read, "notices": [n.code for n in reader.notices],
        "title": inspection.title, "facts": inspection.facts, "clock": [clock.clock, clock.first_s, clock.last_s],
    }))
except FurrowmapError as error:
    print(json.dumps({"code": error.code, "lines": error.lines}))
"""


def block(language: str) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return str(found)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder on the import path, with the page's module installed in it as another distribution."""
    site = tmp_path / "site"
    ((group, entries),) = tomllib.loads(block("toml"))["project"]["entry-points"].items()
    about = site / "example_scanner-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: example-scanner\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in entries.items()))
    (site / "example_scanner.py").write_text(block("python"), encoding="utf-8")
    return site


def look(package: Path, *paths: Path) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", LOOK, *paths],
        env=os.environ | {"PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def recording(turns: int, per_turn: int = 100, start_s: float = 1.75e9) -> bytes:
    content = struct.pack("<3sxI", b"EX8", per_turn)
    for i in range(turns * per_turn):
        content += struct.pack("<d3f", start_s + 0.001 * i, np.cos(i), np.sin(i), i)
    return content


def test_example__is_found_and_read(package: Path, tmp_path: Path) -> None:
    path = tmp_path / "drive.ex8.gz"
    path.write_bytes(gzip.compress(recording(3)))
    found = look(package, path)
    assert [scan[:3] for scan in found["scans"]] == [[0, 100, True], [1, 100, True], [2, 100, True]]
    assert found["scans"][1][3] == 1.75e9 + 0.1
    assert found["scans"][1][4] == pytest.approx([np.cos(199), np.sin(199), 199], rel=1e-6)
    assert found["title"] == "Example-8 recording"
    assert found["facts"] == {"scans": 3, "points": 300}
    assert found["clock"] == ["sensor-gps", 1.75e9, pytest.approx(1.75e9 + 0.299)]
    assert (found["share"], found["notices"]) == (1.0, [])


def test_example__of_several_files_one_of_them_cut(package: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "1.ex8", tmp_path / "2.ex8"
    first.write_bytes(recording(2)[:-1010])
    second.write_bytes(recording(1, start_s=1.76e9))
    found = look(package, first, second)
    assert [scan[:3] for scan in found["scans"]] == [[0, 100, True], [1, 49, False], [2, 100, True]]
    assert found["notices"] == ["cut-recording"]
    assert found["facts"] == {"scans": 2, "points": 149}


def test_example__refuses_in_three_sentences(package: Path, tmp_path: Path) -> None:
    path = tmp_path / "bad.ex8"
    path.write_bytes(recording(1, per_turn=1)[:4] + bytes(30))
    found = look(package, path)
    assert found["code"] == "damaged-header"
    assert len(found["lines"]) == 3
