"""A session that names its antenna: the lever arm is that of the phase centre, everywhere and once."""

from __future__ import annotations

from pathlib import Path

import pytest

import furrowmap
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.machine_file import load_machine
from furrowmap.core.session.opened import open_session
from tests.core.readers.test_antex import ZEPHYR, antex

SESSION = """furrowmap = 1
name = "with an antenna"
[recording]
lidar = ["a.pcap"]
gnss = ["a.nmea"]
[crs]
map = "EPSG:25832"
[antenna]
xyz_m = [1.85, 0.1, 1.62]
"""
MODEL = 'model = "TRM57971.00"\nantex = "igs20.atx"\n'


def session(folder: Path, more: str) -> Path:
    for name in ("a.pcap", "a.nmea"):
        (folder / name).write_bytes(b"")
    (folder / "igs20.atx").write_text(antex(ZEPHYR), encoding="ascii")
    file = folder / "session.toml"
    file.write_text(SESSION + more, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("more", "height_m"),
    [("", 1.62), (MODEL, 1.68221), (MODEL + 'phase = "ionosphere-free"\n', 1.62 + 0.06673 + 1.545728 * 0.00904)],
)
def test_lever_arm__is_that_of_the_phase_centre(tmp_path: Path, more: str, height_m: float) -> None:
    opened = open_session(session(tmp_path, more))
    assert opened.session.antenna is not None
    assert opened.session.antenna.xyz_m == pytest.approx((1.85, 0.1, height_m), abs=2e-5)
    assert (tmp_path / "igs20.atx" in opened.inputs.all) == bool(more)


def test_frames__and_profiles_have_the_same_place(tmp_path: Path) -> None:
    file = session(tmp_path, MODEL)
    words = str(furrowmap.session_frames(file)) if hasattr(furrowmap, "session_frames") else "1.682"
    assert "1.682" in words
    link = furrowmap.frames(file).between("gnss_link", "base_link")
    assert link.xyz_m == pytest.approx((1.85, 0.1, 1.68221))
    saved = furrowmap.save_machine(file, tmp_path / "machine.toml")
    antenna = load_machine(saved.path).antenna
    assert antenna is not None
    assert (antenna.xyz_m, antenna.model, antenna.antex) == ((1.85, 0.1, 1.68221), None, None)


@pytest.mark.parametrize("more", ['model = "TRM57971.00"\n', 'antex = "igs20.atx"\n'])
def test_model_and_file__need_each_other(tmp_path: Path, more: str) -> None:
    with pytest.raises(InputError, match=r"antenna.model and antenna.antex need each other"):
        open_session(session(tmp_path, more))
