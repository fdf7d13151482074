"""A run whose results contradict each other, from the command line to the products."""

from __future__ import annotations

import json
import tomllib
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

import furrowmap
from furrowmap.cli.main import command_line


def test_promise_12__results_that_contradict_each_other_are_marked_everywhere(
    simulated: furrowmap.Simulated, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A scanner that is stated upside down."""
    text = simulated.session.read_text(encoding="utf-8")
    roll = tomllib.loads(text)["lidar"]["rpy_deg"][0]
    wrong = simulated.session.with_name("wrong.toml")
    wrong.write_text(text.replace(f"rpy_deg = [{roll}", f"rpy_deg = [{roll + 180.0}"), encoding="utf-8")
    assert command_line(["run", str(wrong), "-o", str(tmp_path / "out"), "-q"]) == 0
    report = furrowmap.open_result(tmp_path / "out").report
    assert report["warnings"][0]["code"] == "contradiction"
    assert report["verdict"]["consistent"] is False
    assert "upside down" in report["verdict"]["text"]
    assert report["accuracy"]["sigma_e_m"]["median"] > 1.0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.index('class="alarm"') < page.index("<section")
    item = json.loads((tmp_path / "out" / "item.json").read_text(encoding="utf-8"))
    assert item["properties"]["furrowmap:contradiction"] == report["verdict"]["text"]


def test_surveyed_check_points__that_contradict_the_heights_are_named(
    simulated: furrowmap.Simulated, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Points on the true ground, half a metre too high."""
    with np.load(simulated.folder / "truth" / "surface.npz") as truth:
        cell_m, height_m = float(truth["cell_m"]), truth["before"] + float(truth["h0_m"])
        row, column = (at.ravel() for at in np.indices(height_m.shape)[:, ::40, ::40])
        east, north = float(truth["e0"]) + cell_m * (column + 0.5), float(truth["n0"]) + cell_m * (row + 0.5)
        rows = np.column_stack([east, north, height_m[row, column] + 0.5])
    points = simulated.session.with_name("points.csv")
    np.savetxt(points, rows, "%.3f", ",", header="e_m,n_m,h_m", comments="")
    text = simulated.session.read_text(encoding="utf-8")
    session = simulated.session.with_name("points.toml")
    session.write_text(text.replace("[field]\n", '[field]\ncheck_points = "points.csv"\n'), encoding="utf-8")
    assert command_line(["run", str(session), "-o", str(tmp_path / "out"), "--strict", "-q"]) == 4
    assert "contradict each other" in capsys.readouterr().err
    report = furrowmap.open_result(tmp_path / "out").report
    assert report["verdict"]["cause"] == "check-points"
    assert report["check_points"]["off_m"] == pytest.approx(-0.5, abs=0.15)
    assert report["accuracy"]["sigma_h_m"]["median"] > 0.4


def test_heights_of_two_levels__are_as_uncertain_as_these_differ(
    simulated: furrowmap.Simulated, tmp_path: Path
) -> None:
    """The second half of the log holds altitudes as if they were heights above the ellipsoid."""
    text = simulated.session.read_text(encoding="utf-8")
    log = simulated.session.with_name(tomllib.loads(text)["recording"]["gnss"][0])
    sentences = log.read_text(encoding="ascii").splitlines()
    for k in range(len(sentences) // 2, len(sentences)):
        fields = sentences[k].partition("*")[0].lstrip("$").split(",")
        if fields[0].endswith("GGA"):
            fields[9] = f"{float(fields[9]) - 40.0:.3f}"
            body = ",".join(fields)
            checksum = reduce(xor, body.encode("ascii"))
            sentences[k] = f"${body}*{checksum:02X}"
    log.with_name("levels.nmea").write_text("\r\n".join(sentences) + "\r\n", encoding="ascii")
    session = simulated.session.with_name("levels.toml")
    session.write_text(text.replace(f'"{log.name}"', '"levels.nmea"'), encoding="utf-8")
    report = furrowmap.run(session, tmp_path / "out").report
    assert (report["verdict"]["consistent"], report["verdict"]["cause"]) == (False, "positions")
    said = [report["verdict"]["text"], *report["verdict"]["doubts"]]
    assert any("heights jump 1 time " in text for text in said)
    assert 39.0 < report["accuracy"]["sigma_h_m"]["median"] < 41.0
