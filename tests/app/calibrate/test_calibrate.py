"""What a recording says about its own mounting, and how that gets into the session."""

from __future__ import annotations

import datetime as dt
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

import furrowmap
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.values.rotation import Mounting
from furrowmap.workflows.calibrate.calibrate import Calibration, calibrated_text

ORIGIN = "calibrated with the recording of 2026-06-11: ± 0.20, ± 0.20, ± 0.20 degrees (95 %)"
SESSION = """\
furrowmap = 1
[recording]
lidar = ["a.pcap"]
lidar_minus_gnss_s = 0.1  # by eye

# how it sits
[lidar]
xyz_m = [-0.6, 0.0, 2.4]
rpy_deg = [0.0, 40.0, 180.0]   # measured
[implement]
width_m = 2.0
"""


def found(*, turned: bool, late: bool) -> Calibration:
    return Calibration(
        stated=Mounting((-0.6, 0.0, 2.4), (0.0, 40.0, 180.0)),
        found=Mounting((-0.6, 0.0, 2.4), (0.5, 39.5, 180.25) if turned else (0.0, 40.0, 180.0)),
        sigma_deg=(0.1, 0.1, 0.1),
        facing_shown=True,
        height_m=(0.0, 0.01),
        stated_offset_s=0.1,
        offset_s=(0.25 if late else 0.101, 0.003),
        clock_differs=late,
        date=dt.date(2026, 6, 11),
    )


def test_what_was_found_takes_its_place_and_nothing_else_changes() -> None:
    text = calibrated_text(SESSION, found(turned=True, late=True))
    expected = SESSION.replace("[0.0, 40.0, 180.0]", "[0.500, 39.500, 180.250]").replace("= 0.1 ", "= 0.2500 ")
    assert text == expected.replace("# measured", f"# measured; {ORIGIN}")
    again = calibrated_text(text, found(turned=True, late=True))
    assert again == text


def test_what_was_found_says_where_it_is_from() -> None:
    """As a comment behind the value, also where there was no comment or no line."""
    for before in ("rpy_deg = [0.0, 40.0, 180.0]\n", ""):
        text = SESSION.replace("rpy_deg = [0.0, 40.0, 180.0]   # measured\n", before)
        assert f"rpy_deg = [0.500, 39.500, 180.250]   # {ORIGIN}\n" in calibrated_text(
            text, found(turned=True, late=False)
        )


def test_what_is_right_stays_as_it_is() -> None:
    assert calibrated_text(SESSION, found(turned=False, late=False)) == SESSION


@pytest.mark.parametrize("without", ["rpy_deg", "lidar_minus_gnss_s"])
def test_a_key_that_is_not_there_is_added_to_its_table(without: str) -> None:
    lines = [line for line in SESSION.splitlines(keepends=True) if not line.startswith(without)]
    session = tomllib.loads(calibrated_text("".join(lines), found(turned=True, late=True)))
    assert session["lidar"]["rpy_deg"] == [0.5, 39.5, 180.25]
    assert session["recording"]["lidar_minus_gnss_s"] == 0.25
    assert session["implement"] == {"width_m": 2.0}


def test_clock_of_the_first_scanner__is_written_where_the_session_states_it() -> None:
    own = SESSION.replace("lidar_minus_gnss_s = 0.1  # by eye\n", "")
    own = own.replace("[lidar]\n", '[[lidar]]\nname = "rear"\nminus_gnss_s = 0.1\n')
    session = tomllib.loads(calibrated_text(own, found(turned=True, late=True)))
    assert session["lidar"] == [
        {"name": "rear", "minus_gnss_s": 0.25, "xyz_m": [-0.6, 0.0, 2.4], "rpy_deg": [0.5, 39.5, 180.25]}
    ]
    assert session["recording"] == {"lidar": ["a.pcap"]}


def test_indented_tables_and_keys_are_found() -> None:
    indented = "".join(f"  {line}" if line.strip() else line for line in SESSION.splitlines(keepends=True))
    session = tomllib.loads(calibrated_text(indented, found(turned=True, late=True)))
    assert session["lidar"]["rpy_deg"] == [0.5, 39.5, 180.25]
    assert session["recording"]["lidar_minus_gnss_s"] == 0.25


def test_a_mounting_comes_back_from_its_rotation() -> None:
    mounting = Mounting((0.1, 0.2, 0.3), (3.0, 40.0, 170.0))
    again = Mounting.from_rotation(mounting.xyz_m, mounting.rotation)
    assert np.allclose(again.rpy_deg, mounting.rpy_deg, atol=1e-9)


def test_a_trajectory_from_a_file_is_nothing_to_calibrate_with(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    shutil.copytree(simulated.folder, drive)
    text = (drive / "session.toml").read_text()
    text = text.replace('gnss = ["gnss.nmea"]\n', "") + '\n[trajectory]\nfiles = ["truth/trajectory.csv"]\n'
    (drive / "session.toml").write_text(text)
    with pytest.raises(RefusedError) as caught:
        furrowmap.calibrate(drive / "session.toml", write=True)
    assert caught.value.code == "calibration-refused"
    assert (drive / "session.toml").read_text() == text
