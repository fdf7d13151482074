"""Positions from RINEX by RTKLIB, against the stations' own coordinates."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError
from furrowmap.recordings import open_recording
from tests.conftest import installed
from tests.core.readers.test_antex import antex

ROVER_XYZ = (-3976219.5082, 3382372.5671, 3652512.9849)
BASE_XYZ = (-3978242.4348, 3382841.1715, 3649902.7667)


@pytest.fixture(scope="module")
def rtklib() -> str:
    return installed("RTKLIB", "tools_of_tests.py", "rtklib")


@pytest.fixture
def rinex(tmp_path: Path, shared_data: Path) -> tuple[Path, Path, Path]:
    for name in ("07590920.05o", "30400920.05o", "07590920.05n"):
        shutil.copyfile(shared_data / "gnss" / "rinex" / name, tmp_path / name)
    return tmp_path / "07590920.05o", tmp_path / "30400920.05o", tmp_path / "07590920.05n"


def test_sample__is_solved_to_decimetres_of_the_station(rtklib: str, rinex: tuple[Path, Path, Path]) -> None:
    """The header of the rover is good to decimetres; an independent run was 11 cm east and 12 cm above it."""
    solved = furrowmap.solve_gnss(*rinex[:2], [rinex[2]])
    assert solved.path == rinex[0].with_suffix(".pos")
    assert solved.by_fix["fixed"] >= 115
    assert [notice.code for notice in solved.notices] == ["base-position-assumed"]
    track = open_recording(solved.path).track()  # type: ignore[attr-defined]
    assert len(track) == solved.epochs
    to_earth = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    xyz = np.column_stack(to_earth.transform(track.lon_deg, track.lat_deg, track.height_m))[track.fix == 4]
    off = np.median(xyz, axis=0) - ROVER_XYZ
    assert np.linalg.norm(off) == pytest.approx(0.163, abs=0.03)
    assert np.linalg.norm(xyz - np.median(xyz, axis=0), axis=1).mean() < 0.03


def test_base_position__moves_the_solution_with_it(
    rtklib: str, rinex: tuple[Path, Path, Path], capfd: pytest.CaptureFixture[str]
) -> None:
    lon, lat, height = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*BASE_XYZ)
    heights = []
    for k, up in enumerate((0.0, 5.0)):
        out = rinex[0].with_name(f"{k}.pos")
        place = f"{lat:.9f},{lon:.9f},{height + up:.4f}"
        assert (
            command_line(["gnss", "solve", *map(str, rinex), "-o", str(out), "--base-position", place, "--json"]) == 0
        )
        assert json.loads(capfd.readouterr().out)["by_fix"]["fixed"] >= 100
        heights.append(float(np.median(open_recording(out).track().height_m)))  # type: ignore[attr-defined]
    assert heights[1] - heights[0] == pytest.approx(5.0, abs=0.02)


def test_existing_solution__is_not_replaced(rtklib: str, rinex: tuple[Path, Path, Path]) -> None:
    rinex[0].with_suffix(".pos").write_text("mine", encoding="utf-8")
    with pytest.raises(RefusedError):
        furrowmap.solve_gnss(*rinex[:2], [rinex[2]])


def test_nothing_solved__is_an_error_and_leaves_no_file(rtklib: str, rinex: tuple[Path, Path, Path]) -> None:
    base = rinex[1]
    text = base.read_text(encoding="ascii")
    base.write_text(text.replace("\n 05  4  2", "\n 05  4  9"), encoding="ascii")
    with pytest.raises(InputError) as caught:
        furrowmap.solve_gnss(rinex[0], base, [rinex[2]])
    assert caught.value.code == "gnss-unsolved"
    assert all(caught.value.lines)
    assert not rinex[0].with_suffix(".pos").exists()


@pytest.mark.parametrize(
    ("order", "words"), [((0, 2, 1), "but not of observations"), ((0, 1, 0), "but not of navigation messages")]
)
def test_files_in_the_wrong_order__are_named(
    rtklib: str, rinex: tuple[Path, Path, Path], order: tuple[int, int, int], words: str
) -> None:
    rover, base, nav = (rinex[k] for k in order)
    with pytest.raises(InputError, match=words) as caught:
        furrowmap.solve_gnss(rover, base, [nav])
    assert caught.value.code == "not-rinex"


@pytest.mark.parametrize(
    ("line", "words"),
    [("1.0                 COMPACT RINEX FORMAT".ljust(60) + "CRINEX VERS   / TYPE", "crx2rnx"), ("$GNGGA", "convbin")],
)
def test_other_files__say_how_to_convert_them(rtklib: str, tmp_path: Path, line: str, words: str) -> None:
    (tmp_path / "a").write_text(f"{line}\n", encoding="ascii")
    with pytest.raises(InputError) as caught:
        furrowmap.solve_gnss(tmp_path / "a", tmp_path / "a", [tmp_path / "a"])
    assert words in caught.value.remedy


def test_missing_rtklib__is_three_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FurrowmapError) as caught:
        furrowmap.solve_gnss("a.obs", "b.obs", ["c.nav"])
    assert (caught.value.code, caught.value.exit_status) == ("no-rtklib", 1)
    assert "apt install rtklib" in caught.value.remedy


def test_invalid_base_position__is_a_usage_error(capfd: pytest.CaptureFixture[str]) -> None:
    assert command_line(["gnss", "solve", "a", "b", "c", "--base-position", "141.3,443.0,46"]) == 2
    assert "latitude first" in capfd.readouterr().err


def with_antenna(path: Path, name: str, height_m: float) -> None:
    """Enter another antenna, and its height above the marker, in the header of a file."""
    text = path.read_text(encoding="ascii")
    text = text.replace("TRM29659.00         ", f"{name:20}").replace(
        "        0.0000        0.0000", f"{height_m:14.4f}        0.0000"
    )
    path.write_text(text, encoding="ascii")


def solved_height_m(rinex: tuple[Path, Path, Path], antennas: Path | None) -> float:
    out = rinex[0].with_name("antennas.pos")
    settings = furrowmap.SolveSettings(antennas=antennas)
    furrowmap.solve_gnss(*rinex[:2], [rinex[2]], out, settings, overwrite=True)
    track = open_recording(out).track()  # type: ignore[attr-defined]
    return float(np.median(track.height_m[track.fix == 4]))


def test_antennas__bring_positions_from_marker_to_marker(rtklib: str, rinex: tuple[Path, Path, Path]) -> None:
    """The rover's phase centre is 0.1 m higher in its antenna, which stands 0.25 m above the marker."""
    before = solved_height_m(rinex, None)
    with_antenna(rinex[0], "TALL            NONE", 0.25)
    with_antenna(rinex[1], "FLAT            NONE", 0.0)
    calibrations = rinex[0].with_name("a # b.atx")
    flat = {"G01": (0.0, 0.0, 0.0), "G02": (0.0, 0.0, 0.0)}
    tall = {"G01": (0.0, 0.0, 100.0), "G02": (0.0, 0.0, 100.0)}
    calibrations.write_text(antex(("FLAT            NONE", flat), ("TALL            NONE", tall)), encoding="ascii")
    assert solved_height_m(rinex, calibrations) - before == pytest.approx(-0.35, abs=0.01)


def test_antennas__that_are_unknown_or_unnamed_are_errors(rtklib: str, rinex: tuple[Path, Path, Path]) -> None:
    calibrations = rinex[0].with_name("a.atx")
    calibrations.write_text(antex(("FLAT            NONE", {"G01": (0.0, 0.0, 0.0)})), encoding="ascii")
    with pytest.raises(InputError) as caught:
        solved_height_m(rinex, calibrations)
    assert caught.value.code == "antenna-model-unknown"
    assert "TRM29659.00" in str(caught.value)
    with_antenna(rinex[0], "", 0.0)
    with pytest.raises(InputError) as caught:
        solved_height_m(rinex, calibrations)
    assert caught.value.code == "antenna-unnamed"
