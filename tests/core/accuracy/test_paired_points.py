"""Points of a table of measurements against those of a survey, paired by name."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError

SURVEYED = {
    "P1": (651_500.0, 6_133_880.0, 70.0),
    "P2": (651_520.0, 6_133_890.0, 71.0),
    "P3": (651_540.0, 6_133_870.0, 69.0),
}
OFF = {"P1": (0.03, -0.04, 0.01), "P2": (-0.01, 0.02, -0.02), "P3": (0.02, 0.05, 0.03)}


def write(path: Path, points: dict[str, tuple[float, float, float]], head: str = "name,e_m,n_m,h_m") -> Path:
    rows = [f"{name},{x:.9f},{y:.9f},{z:.4f}" for name, (x, y, z) in points.items()]
    path.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return path


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    measured = {name: tuple(np.add(SURVEYED[name], OFF[name]).tolist()) for name in ("P3", "P1", "P2")}
    measured["only here"] = (651_500.0, 6_133_800.0, 70.0)
    return write(tmp_path / "measured.csv", measured), write(tmp_path / "survey.csv", SURVEYED)


def test_differences__are_by_name_and_their_rms_by_axis(files: tuple[Path, Path], tmp_path: Path) -> None:
    found = furrowmap.check_pairs(*files, table=tmp_path / "table.csv")
    off = np.array(list(OFF.values()))
    assert found.name == ("P1", "P2", "P3")
    np.testing.assert_allclose(found.difference_m, off, atol=1e-6)
    np.testing.assert_allclose(found.rms_m, np.sqrt(np.mean(off**2, axis=0)), atol=1e-6)
    np.testing.assert_allclose(found.mean_m, off.mean(axis=0), atol=1e-6)
    assert found.unpaired == ("only here",)
    with (tmp_path / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["P1", "P2", "P3"]
    assert float(rows[1]["difference_z_m"]) == pytest.approx(-0.02, abs=1e-4)


def test_command__prints_the_table_and_json_and_judges(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line(["check", "--pairs", *map(str, files)]) == 0
    said = capsys.readouterr().out
    assert "RMS" in said
    assert "+0.0300" in said
    assert command_line(["check", "--pairs", "--require-vertical", "0.01", "--json", *map(str, files)]) == 4
    answer = json.loads(capsys.readouterr().out)
    assert answer["rms_m"]["z"] == pytest.approx(np.sqrt((1 + 4 + 9) / 3) / 100, abs=1e-4)
    assert answer["verdicts"]["vertical"]["met"] is False


def test_degrees__need_a_plane(files: tuple[Path, Path], tmp_path: Path) -> None:
    lon, lat = Transformer.from_crs(25832, 4258, always_xy=True).transform(*np.array(list(SURVEYED.values())).T[:2])
    degrees = {name: (x, y, SURVEYED[name][2]) for name, x, y in zip(SURVEYED, lon.tolist(), lat.tolist(), strict=True)}
    survey = write(tmp_path / "degrees.csv", degrees, "name,lon_deg,lat_deg,h_m")
    with pytest.raises(InputError) as refused:
        furrowmap.check_pairs(files[0], survey)
    assert refused.value.code == "pairs-need-crs"
    found = furrowmap.check_pairs(files[0], survey, crs="EPSG:25832")
    np.testing.assert_allclose(found.difference_m, list(OFF.values()), atol=1e-3)


def test_names__must_fit_and_be_single(files: tuple[Path, Path], tmp_path: Path) -> None:
    other = write(tmp_path / "other.csv", {"Q": (1.0, 2.0, 3.0)})
    with pytest.raises(InputError) as refused:
        furrowmap.check_pairs(other, files[1])
    assert refused.value.code == "pairs-none"
    other.write_text(other.read_text(encoding="utf-8") + "Q,1,2,3\n", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        furrowmap.check_pairs(files[1], other)
    assert refused.value.code == "pairs-repeated"
