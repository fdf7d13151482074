"""Recordings of scanners of several kinds, played as they came in."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import furrowmap
from furrowmap.core.readers.reader import GivesPoses, ReadOptions, open_recording
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from tests.one_pass import SCENARIO


@pytest.mark.parametrize("model", ["OS1-32", "Mid-360"])
def test_live__follows_the_recording_of_any_scanner(model: str, tmp_path: Path) -> None:
    """Packets of an Ouster, and messages of a Livox in a bag."""
    (tmp_path / "scenario.toml").write_text(SCENARIO + f'[lidar]\nmodel = "{model}"\n')
    simulated = furrowmap.simulate(tmp_path / "scenario.toml", tmp_path / "drive")
    seen: list[dict[str, Any]] = []
    options: dict[str, Any] = {"play": math.inf, "port": None, "nmea_port": None}
    summary = furrowmap.live(simulated.session, on_scan=seen.append, **options)
    opened = open_session(simulated.session)
    reader = open_recording([simulated.folder / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(reader, GivesPoses)
    truth = trajectory_from_poses(reader.poses(), opened.frame)
    recorded = sum(1 for _ in opened.lidar(truth.span_s[0]).scans())
    assert (summary.dropped, summary.lost_packets) == (0, 0)
    assert recorded - 2 <= summary.scans <= recorded  # the last revolution has no end
    posed = [scan for scan in seen if "e_m" in scan]
    assert len(posed) > 0.4 * recorded  # the first pose comes after 1.5 m
    true_m = truth.at(np.array([scan["t_s"] for scan in posed])).xyz_m
    off_m = np.hypot(*(np.array([[scan["e_m"], scan["n_m"]] for scan in posed]) - true_m[:, :2]).T)
    assert np.sqrt((off_m**2).mean()) < 0.07  # the errors of the positions counted in


def test_live__needs_scans_and_positions(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    session = tmp_path / "session.toml"
    text = simulated.session.read_text().replace('gnss = ["gnss.nmea"]', "")
    session.write_text(text + '[trajectory]\nfiles = ["truth/trajectory.csv"]\ntime = "utc"\n')
    shutil.copytree(simulated.folder, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("session.toml"))
    with pytest.raises(furrowmap.UsageError, match="no recording of a scanner"):
        furrowmap.live(session, play=math.inf, port=None, nmea_port=None)


FRONT = """
[second_lidar]
xyz_m = [1.9, -0.05, 2.25]
rpy_deg = [0.0, 35.0, 0.0]
max_range_m = 12.0
"""


def test_live__of_two_scanners_follows_that_at_the_implement_whichever_is_first(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text(SCENARIO.replace("pass_m = [3.2]", "pass_m = [6.4]") + FRONT)
    simulated = furrowmap.simulate(tmp_path / "scenario.toml", tmp_path / "drive")
    first = simulated.session.read_text()
    head, rear, front = first.partition("[implement]")[0].split("[[lidar]]")
    front_first = (
        head.replace("recording.pcap", "second.pcap")
        + "[[lidar]]"
        + front.replace('files = ["second.pcap"]\n', "").replace("minus_gnss_s = 0.0\n", "")
        + "[[lidar]]"
        + rear.replace("\n", '\nfiles = ["recording.pcap"]\n', 1)
        + "[implement]"
        + first.partition("[implement]")[2]
    )
    (simulated.folder / "front_first.toml").write_text(front_first)
    summary = furrowmap.live(simulated.folder / "front_first.toml", play=math.inf, port=None, nmea_port=None)
    truth = json.loads((simulated.folder / "truth" / "figures.json").read_text())
    assert summary.worked_m2 == pytest.approx(truth["worked_area_m2"], rel=0.06)  # 0.13 m between scans, along 6 m
