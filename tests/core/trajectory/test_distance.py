"""Distance driven and time at a standstill, against the truth of the samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.located import locate
from furrowmap.core.trajectory.vehicle_motion import distance_and_standing
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

SCANS_S = {
    "tractor_loop": (1781141020.92, 1781141080.70),
    "tractor_fishtail": (1781143174.62, 1781143237.29),
    "rover_real": (1766566967.46, 1766567128.93),
}
"""First and last return, as the notes on the samples state them."""


def trajectory_of(session_file: Path) -> Trajectory:
    opened = open_session(session_file)
    return locate(opened.positions(), opened.session, opened.frame).trajectory


def true_way(truth: Path, begin_s: float, end_s: float) -> float:
    table = np.genfromtxt(truth, delimiter=",", names=True)
    chosen = (table["time_unix_s"] >= begin_s) & (table["time_unix_s"] <= end_s)
    return float(np.hypot(np.diff(table["e_m"][chosen]), np.diff(table["n_m"][chosen])).sum())


@pytest.mark.parametrize(("name", "gaps"), [("tractor_loop", 0), ("tractor_fishtail", 1)])
def test_way__of_gnss_is_the_true_one_without_the_gaps(shared_data: Path, name: str, gaps: int) -> None:
    truth = shared_data / name / "truth" / "trajectory.csv"
    trajectory = trajectory_of(shared_data / name / "session.toml")
    distance_m, standing_s = distance_and_standing(trajectory, *SCANS_S[name])
    assert len(trajectory.gaps_s) == gaps
    missed_m = sum(true_way(truth, *gap) for gap in trajectory.gaps_s)
    assert distance_m == pytest.approx(true_way(truth, *SCANS_S[name]) - missed_m, rel=0.005)
    assert 3.0 < standing_s < 9.0


def test_way__goes_on_where_the_scans_pause(shared_data: Path, tmp_path: Path) -> None:
    # 45.2 m is the sum of all steps of 10 ms, whose noise adds two metres to the way.
    (tmp_path / "session.toml").write_text(
        'furrowmap = 1\n[recording]\nlidar = ["poses.csv"]\n[crs]\nmap = "EPSG:32634"\n'
        '[trajectory]\nfiles = ["poses.csv"]\n'
    )
    (tmp_path / "poses.csv").write_bytes((shared_data / "rover_real" / "reference_poses.csv").read_bytes())
    distance_m, standing_s = distance_and_standing(trajectory_of(tmp_path / "session.toml"), *SCANS_S["rover_real"])
    assert 42.5 < distance_m < 45.2
    assert standing_s < 0.09 * 161.5  # moving 91 % of the time


def test_way__of_noise_at_a_stand_and_outside_the_scans_is_nothing() -> None:
    t_s = np.arange(0.0, 100.0, 0.1)
    east = np.where(t_s < 50.0, t_s, 50.0) + np.random.default_rng(1).normal(0, 0.01, len(t_s))
    trajectory = trajectory_from_attitude(
        t_s,
        np.column_stack([east, 0 * t_s, 0 * t_s]),
        0.0,
        0.0,
        90.0,
        max_gap_s=1.0,
        motion=(t_s < 50.0).astype(np.int8),
    )
    assert distance_and_standing(trajectory, 10.0, 99.0) == (
        pytest.approx(40.0, abs=0.15),
        pytest.approx(49.0, abs=0.15),
    )
    assert distance_and_standing(trajectory, 10.02, 10.38)[0] == pytest.approx(0.36, abs=0.05)  # between knots
    assert distance_and_standing(trajectory, 200.0, 300.0) == (0.0, 0.0)
