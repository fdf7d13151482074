"""A tractor with a scanner behind and one in front: one cloud, and the mounting of one against the other by truth."""

from __future__ import annotations

import json

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import furrowmap
from furrowmap.core.session.session_file import load_session
from furrowmap.core.simulator.scenario import Scenario, ScenarioDrive, ScenarioField, ScenarioLidar, SecondLidar
from furrowmap.core.simulator.simulate import simulate

REAR = ScenarioLidar(max_range_m=20.0)
FRONT = SecondLidar(
    xyz_m=(1.9, -0.05, 2.25),
    rpy_deg=(0.0, 35.0, 0.0),
    true_xyz_m=(1.9, -0.05, 2.235),
    true_rpy_deg=(0.7, 35.9, -0.8),
    true_minus_gnss_s=0.012,
    max_range_m=20.0,
)
SCENARIO = Scenario(
    name="twins",
    title="Two scanners",
    seed=4,
    field=ScenarioField(size_e_m=20.0, size_n_m=20.0),
    walls=((10.0, 18.5, 5.0, 12.0, 1.0, 3.5, 5.0), (18.5, 12.0, 95.0, 6.0, 0.2, 2.0, 4.0)),
    drive=ScenarioDrive(
        passes=2,
        pass_m=(5.0,),
        speed_work_mps=1.4,
        speed_turn_mps=1.6,
        accel_mps2=1.5,
        stand_start_s=0.4,
        stand_end_s=0.4,
        gear_s=0.5,
    ),
    lidar=REAR,
    second_lidar=FRONT,
)
"""Two passes see the same ground again; a single one of 5 to 8 m leaves angles up to 0.2° off."""
FIRST_PASS_S = 5.0
"""From the start to the end of the first pass."""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> furrowmap.Result:
    folder = tmp_path_factory.mktemp("twins")
    session = simulate(SCENARIO, folder / "drive").session
    session.write_text(session.read_text("utf-8") + '\n[report]\nlanguage = "ja"\n', "utf-8")
    return furrowmap.run(session, folder / "result")


@pytest.fixture(scope="module")
def cloud(result: furrowmap.Result) -> laspy.LasData:
    return laspy.read(result.path / "cloud.copc.laz")


def rotation(rpy_deg: tuple[float, float, float]) -> NDArray[np.float64]:
    """Sensor to vehicle."""
    roll, pitch, yaw = rpy_deg
    matrix: NDArray[np.float64] = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()
    return matrix


def test_front_scanner__is_mounted_as_it_truly_is_against_the_rear_one(result: furrowmap.Result) -> None:
    found = result.report["calibration"]["scanners"]["front"]
    assert found["used"]
    wrong = rotation(found["rpy_deg"]) @ rotation(FRONT.true_rpy_deg).T
    assert np.degrees(Rotation.from_matrix(wrong).as_rotvec()) == pytest.approx(np.zeros(3), abs=0.05)
    assert found["xyz_m"] == pytest.approx(FRONT.true_xyz_m, abs=0.01)
    assert found["correction"]["clock_s"]["value"] == pytest.approx(0.012, abs=0.001)
    texts = [warning["text"] for warning in result.report["warnings"] if warning["code"] == "scanner-mounting-off"]
    assert len(texts) == 2
    assert all(text.startswith("front: ") for text in texts)


def test_cloud__has_the_points_of_both_on_the_same_ground(result: furrowmap.Result, cloud: laspy.LasData) -> None:
    scanner, ground = np.asarray(cloud["scanner"]), np.asarray(cloud.classification) == 2
    told = result.report["figures"]["scanners"]
    assert [one["name"] for one in told] == ["rear", "front"]
    assert [one["points"] for one in told] == [int((scanner == k).sum()) for k in (0, 1)]
    column, row = np.floor(np.array([cloud.x, cloud.y]) / 0.25).astype(int)
    cell = (row - row.min()) * (np.ptp(column) + 1) + column - column.min()
    chosen = [ground & (scanner == k) for k in (0, 1)]
    size, height = int(cell.max()) + 1, np.asarray(cloud.z)
    count = np.array([np.bincount(cell[one], minlength=size) for one in chosen])
    total = np.array([np.bincount(cell[one], height[one], size) for one in chosen])
    both = (count >= 20).all(axis=0)
    assert both.sum() > 200
    apart = total[1, both] / count[1, both] - total[0, both] / count[0, both]
    assert np.median(apart) == pytest.approx(0.0, abs=0.003)
    # On a pass each alone leaves ground that the other sees, which only the turn shows to both.
    first_pass = np.asarray(cloud.gps_time) < cloud.gps_time.min() + FIRST_PASS_S
    seen = np.array([np.bincount(cell[one & first_pass], minlength=size) for one in chosen]) >= 5
    assert (seen.any(axis=0)).sum() > 1.15 * seen.sum(axis=1).max()


def test_session_and_page_of_the_result__name_both(result: furrowmap.Result) -> None:
    lidars = load_session(result.path / "session.toml").lidars
    assert [(lidar.name, lidar.files) for lidar in lidars] == [
        ("rear", ("recording.pcap",)),
        ("front", ("second.pcap",)),
    ]
    page = (result.path / "report.html").read_text("utf-8")
    assert "<h2>スキャナの一覧</h2>" in page
    assert ">基準<" in page
    assert "作業機はrearのスキャンから追跡しています" in page


def test_tool__is_followed_by_the_second_scanner_where_the_first_does_not_show_it(result: furrowmap.Result) -> None:
    drive = result.path.parent / "drive"
    head, rear, rest = (drive / "session.toml").read_text("utf-8").split("[[lidar]]")
    front, implement = rest.split("[implement]")
    stated = 'files = ["second.pcap"]\nminus_gnss_s = 0.0\n'
    front = front.replace(stated, "").replace("[0.0, 35.0, 0.0]", "[0.7, 35.9, -0.8]")
    rear = rear.replace('"rear"\n', '"rear"\n' + stated.replace("second", "recording"))
    head = head.replace("recording.pcap", "second.pcap").replace("minus_gnss_s = 0.0", "minus_gnss_s = 0.012")
    swapped = drive / "swapped.toml"
    swapped.write_text(f"{head}[[lidar]]{front}[[lidar]]{rear}[implement]{implement}", "utf-8")
    figures = furrowmap.run(swapped, result.path.parent / "swapped").report["figures"]
    assert [(one["name"], one["shows_implement"]) for one in figures["scanners"]] == [("front", False), ("rear", True)]
    truth = json.loads((drive / "truth" / "figures.json").read_text("utf-8"))
    assert figures["worked_area_m2"] == pytest.approx(truth["worked_area_m2"], rel=0.01)
