"""`[field] control_points`, from the session to the products."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest

import furrowmap
from furrowmap.core.runtime.errors import InputError
from tests.one_pass import SCENARIO

UP_M = 0.05
"""By which positions are off."""
TARGETS = {
    "board": ("checkerboard", 6.5, 9.0),
    "other board": ("checkerboard", 10.0, 4.5),
    "disc": ("disc", 7.0, 4.5),
    "barn": ("corner", 6.0, 11.5),
    "ground": ("ground", 8.0, 5.0),
}
"""Target, and place from the corner of the grid, of points beside the path."""
SCENE = """
checkerboards = [[6.5, 9.0, 0.6, 20.0, 120.0], [10.0, 4.5, 0.6, 65.0, 120.0]]
discs = [[7.0, 4.5, 0.5, 120.0]]
walls = [[4.0, 11.65, 0.0, 4.0, 0.3, 2.5, 5.0], [5.85, 13.5, 90.0, 4.0, 0.3, 2.5, 5.0]]
"""


def session_with(simulated: furrowmap.Simulated, name: str, keys: str, *, placed: bool = False) -> Path:
    """A session with some keys of the field; `placed` by the true trajectory, which is too high."""
    text = simulated.session.read_text(encoding="utf-8").replace("[field]\n", f"[field]\n{keys}\n")
    if placed:
        true = pd.read_csv(simulated.folder / "truth" / "trajectory.csv")
        true.h_m += UP_M
        true = true.assign(sigma_e_m=0.02, sigma_n_m=0.02, sigma_h_m=0.02)
        true = true.assign(sigma_roll_deg=0.02, sigma_pitch_deg=0.02, sigma_heading_deg=0.05)
        true.to_csv(simulated.session.with_name("high.csv"), index=False)
        lines = [line for line in text.splitlines() if not line.startswith("gnss = ")]
        text = "\n".join([*lines, "", "[trajectory]", 'files = ["high.csv"]', ""])
    session = simulated.session.with_name(f"{name}.toml")
    session.write_text(text, encoding="utf-8")
    return session


def survey(simulated: furrowmap.Simulated, name: str, gross_m: float = 0.0) -> None:
    """Eight points of control and four to check, on ground that is not worked, beside and behind the path."""
    track = np.loadtxt(simulated.folder / "truth" / "trajectory.csv", delimiter=",", skiprows=1)[:, 1:3]
    with np.load(simulated.folder / "truth" / "surface.npz") as truth:
        cell_m = float(truth["cell_m"])
        corner = np.array([float(truth["e0"]), float(truth["n0"])])
        height_m = truth["before"] + float(truth["h0_m"])
        worked = np.isfinite(truth["worked_time"])
    along = (track[-1] - track[0]) / np.hypot(*(track[-1] - track[0]))
    aside = np.array([-along[1], along[0]])
    rows = ["name,e_m,n_m,h_m,sigma_h_m,role"]
    number = 0
    for ahead_m in (-5.0, -4.0, -3.0, -2.0, -1.0, 0.0):
        for side_m in (-1.8, 1.8):
            place = track[0] + ahead_m * along + side_m * aside
            column, row = np.floor((place - corner) / cell_m).astype(int)
            assert not worked[row, column]
            height = float(height_m[row - 3 : row + 4, column - 3 : column + 4].mean())
            height += gross_m if number == 4 else 0.0
            role = "check" if number % 3 == 2 else "control"
            rows.append(f"K{number},{place[0]:.4f},{place[1]:.4f},{height:.4f},0.005,{role}")
            number += 1
    simulated.session.with_name(name).write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def corrected(simulated: furrowmap.Simulated, tmp_path_factory: pytest.TempPathFactory) -> furrowmap.Result:
    survey(simulated, "surveyed.csv", gross_m=0.1)
    session = session_with(simulated, "control", 'control_points = "surveyed.csv"', placed=True)
    return furrowmap.run(session, tmp_path_factory.mktemp("control") / "out")


def test_points__correct_the_trajectory(corrected: furrowmap.Result, simulated: furrowmap.Simulated) -> None:
    told = corrected.report["control_points"]
    assert told["corrected"] == [False, False, True]
    assert told["shift_m"][2] == pytest.approx(-UP_M, abs=0.01)
    true = np.loadtxt(simulated.folder / "truth" / "trajectory.csv", delimiter=",", skiprows=1)
    path = corrected.trajectory
    high, east = (np.interp(path.t_s, true[:, 0], true[:, column]) for column in (3, 1))
    error_m = path.geometry.z.to_numpy() - high
    assert np.abs(error_m).max() < 0.01
    assert np.sqrt(np.mean((error_m / path.sigma_h_m.to_numpy()) ** 2)) < 1.5
    np.testing.assert_allclose(path.geometry.x, east, atol=1e-3)


def test_points__to_check_judge_the_corrected_result(corrected: furrowmap.Result) -> None:
    points = {point["name"]: point for point in corrected.report["control_points"]["points"]}
    checks = [point for point in points.values() if point["state"] == "check"]
    assert len(checks) == 4
    assert max(abs(point["residual_m"][2]) for point in checks) < 0.012
    assert min(point["before_m"][2] for point in checks) > 0.03
    assert corrected.report["check_points"]["points"] == 4
    assert corrected.report["verdict"]["consistent"] is not False


def test_point_in_error__is_named_in_report_page_and_layer(corrected: furrowmap.Result) -> None:
    points = {point["name"]: point for point in corrected.report["control_points"]["points"]}
    assert points["K4"]["state"] == "left-out"
    assert [name for name, point in points.items() if point["state"] == "left-out"] == ["K4"]
    warning = next(one for one in corrected.report["warnings"] if one["code"] == "ground-control-left-out")
    assert "K4" in warning["text"]
    layer = corrected.control_points
    assert layer.set_index("name").state["K4"] == "left-out"
    assert (layer.geometry.z > 0.0).all()
    page = (corrected.path / "report.html").read_text(encoding="utf-8")
    assert "Control points" in page
    assert "left out" in page


def test_same_run__gives_the_same_bits(
    simulated: furrowmap.Simulated, corrected: furrowmap.Result, tmp_path: Path
) -> None:
    again = furrowmap.run(simulated.session.with_name("control.toml"), tmp_path / "out")
    for name in ("cloud.copc.laz", "dsm.tif"):
        assert (again.path / name).read_bytes() == (corrected.path / name).read_bytes()
    one, other = (dict(result.report["control_points"]) for result in (again, corrected))
    assert json.dumps(one) == json.dumps(other)
    first, second = (gpd.read_file(result.path / "field.gpkg", layer="trajectory") for result in (again, corrected))
    assert first.equals(second)


def test_targets__of_every_kind_correct_all_axes(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text(SCENE + SCENARIO, encoding="utf-8")
    simulated = furrowmap.simulate(tmp_path / "scenario.toml", tmp_path / "drive")
    with np.load(simulated.folder / "truth" / "surface.npz") as truth:
        cell_m = float(truth["cell_m"])
        corner = np.array([float(truth["e0"]), float(truth["n0"])])
        height_m = truth["before"] + float(truth["h0_m"])
    rows = ["name,e_m,n_m,h_m,target,sigma_e_m,sigma_n_m,sigma_h_m"]
    for name, (target, *place) in TARGETS.items():
        column, row = np.floor(np.array(place) / cell_m).astype(int)
        e, n = corner + place
        high = height_m[row - 4 : row + 5, column - 4 : column + 5].mean()
        rows.append(f"{name},{e:.4f},{n:.4f},{high:.4f},{target},0.003,0.003,0.005")
    simulated.session.with_name("targets.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    keys = 'control_points = "targets.csv"\ncontrol_disc_m = 0.5\ncontrol_checkerboard_m = 0.6'
    result = furrowmap.run(session_with(simulated, "targets", keys, placed=True), tmp_path / "out")
    told = result.report["control_points"]
    assert told["corrected"] == [True, True, True]
    assert told["shift_m"] == pytest.approx([0.0, 0.0, -UP_M], abs=0.015)
    assert {point["name"]: (point["state"], point["target"]) for point in told["points"]} == {
        name: ("used", target) for name, (target, *_) in TARGETS.items()
    }
    seen = [value for point in told["points"] for value in point["residual_m"] if value is not None]
    assert len(seen) == 3 * 4 + 1
    assert max(map(abs, seen)) < 0.01
    page = (result.path / "report.html").read_text(encoding="utf-8")
    assert page.partition('<div class="pictures">')[2].partition("</div>")[0].count("<figure>") == 4


def test_points_elsewhere__end_the_run_before_the_work(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    simulated.session.with_name("far.csv").write_text("name,e_m,n_m,h_m\nA,0,0,0\n", encoding="utf-8")
    session = session_with(simulated, "far", 'control_points = "far.csv"')
    with pytest.raises(InputError) as refused:
        furrowmap.run(session, tmp_path / "out")
    assert refused.value.code == "ground-control-nowhere"
    assert not (tmp_path / "out").exists()


def test_points_of_a_session_without_a_scanner__take_no_part(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    survey(simulated, "surveyed.csv", gross_m=0.1)
    session = session_with(simulated, "blind", 'control_points = "surveyed.csv"')
    text = session.read_text(encoding="utf-8").replace("[implement]\n", '[implement]\nstates = ["states.csv"]\n')
    lines = [line for line in text.splitlines() if not line.startswith("lidar = ")]
    session.write_text("\n".join(lines) + "\n", encoding="utf-8")
    states = "time,state\n2026-06-11T14:59:58.5Z,down\n2026-06-11T15:00:00.5Z,up\n"
    session.with_name("states.csv").write_text(states, encoding="utf-8")
    report = furrowmap.run(session, tmp_path / "out").report
    assert "ground-control-no-scans" in [warning["code"] for warning in report["warnings"]]
