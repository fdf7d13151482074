"""Files beside the recordings of a flight that `furrowmap init` names in the session."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.session_file import load_session


@pytest.fixture
def flight(shared_data: Path, tmp_path: Path) -> Path:
    """Without a scanner, whose recording takes longer to read."""
    folder = tmp_path / "flight"
    folder.mkdir()
    for name in ("imu.csv", "gnss.nmea", "images.csv", "parcels.geojson", "treatments.csv", "check_points.csv"):
        shutil.copyfile(shared_data / "uav_wheat" / name, folder / name)
    return folder


@pytest.mark.parametrize("given", [(".",), ("imu.csv", "gnss.nmea"), ("imu.csv", "gnss.nmea", "images.csv")])
def test_files_of_a_trial__given_or_beside(
    given: tuple[str, ...], flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line(["init", *(str(flight / name) for name in given), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    session = load_session(flight / "session.toml")
    assert session.camera is not None
    assert session.camera.table == "images.csv"
    assert session.parcels is not None
    assert (session.parcels.file, session.parcels.treatments) == ("parcels.geojson", "treatments.csv")
    unused = [notice["text"].split()[0] for notice in answer["missing"] if notice["code"] == "recording-unused"]
    assert unused == (["check_points.csv"] if given == (".",) else [])


def test_images_without_intrinsics__are_known_as_such(flight: Path) -> None:
    furrowmap.propose_session([flight / "imu.csv", flight / "gnss.nmea"])
    with pytest.raises(InputError) as refused:
        open_session(flight / "session.toml").camera()
    assert refused.value.code == "no-camera"
    assert "no intrinsics" in str(refused.value)


def test_table_of_images_alone__is_no_recording(flight: Path) -> None:
    with pytest.raises(InputError) as refused:
        furrowmap.propose_session([flight / "images.csv"])
    assert refused.value.code == "no-recording"
