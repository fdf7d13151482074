"""Meanings of keys on the page of scenarios, tried on drives and receivers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.simulator.drive import plan_path
from furrowmap.core.simulator.machine_motion import SimulatedMotion
from furrowmap.core.simulator.scenario import Receiver, ScenarioDrive, scenario_from
from furrowmap.core.simulator.simulated_receiver import FLOAT, receive
from furrowmap.core.simulator.site import SimulatedSite

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "reference" / "scenario.md").read_text(encoding="utf-8")


def stated(table: str, key: str, meaning: str) -> None:
    section = PAGE[PAGE.index(f"## `[{table}]`") :]
    (row,) = [line for line in section.partition("\n## ")[0].splitlines() if line.startswith(f"- `{key}` = ")]
    assert row.endswith(f": {meaning}")


def test_speeds__on_passes_in_turns_and_in_reverse() -> None:
    stated("drive", "speed_work_mps", "speed on passes")
    stated("drive", "speed_turn_mps", "speed in turns; 85 % of it in reverse")
    stated("drive", "speed_factors", "factor on speed_work_mps by pass; empty: 1")
    drive = ScenarioDrive(turns="fishtail", passes=2, wander_m=0.0, speed_work_mps=1.5, speed_turn_mps=1.0)
    path = plan_path(drive, np.random.default_rng(0))
    on_pass = np.zeros(len(path.distance_m), bool)
    for begin, end in path.passes:
        on_pass |= (path.distance_m > begin + 0.02) & (path.distance_m < end - 0.02)
    assert set(path.limit_mps[on_pass]) == {1.5}
    assert set(np.round(path.limit_mps[path.gear < 0], 9)) == {0.85}
    inside_turn = (path.gear > 0) & (path.distance_m > path.passes[0][1] + 1.0)
    inside_turn &= path.distance_m < path.passes[1][0] - drive.lead_in_m - 0.05
    assert set(path.limit_mps[inside_turn]) == {1.0}
    slower = plan_path(ScenarioDrive(passes=2, wander_m=0.0, speed_work_mps=1.5, speed_factors=(1.0, 0.5)),
                       np.random.default_rng(0))  # fmt: skip
    middles = [np.interp(np.mean(ends), slower.distance_m, slower.limit_mps) for ends in slower.passes]
    assert middles == pytest.approx([1.5, 0.75])


def test_stops__are_where_and_as_long_as_stated() -> None:
    stated("drive", "stops", "stops while working: [pass (from 0), metres into the pass, seconds]")
    drive = ScenarioDrive(passes=2, wander_m=0.0, stops=((1, 3.0, 7.0),))
    path = plan_path(drive, np.random.default_rng(0))
    ((at_m, stand_s),) = [stop for stop in path.stops if stop[1] == 7.0]
    assert at_m == pytest.approx(path.passes[1][0] + 3.0)
    assert stand_s == 7.0


def test_receivers__outages_and_floats_are_from_and_to_after_the_start() -> None:
    stated("gnss.clas", "outage_s", "outages, [from, to] after t0")
    stated("gnss.clas", "float_s", "float solutions, [from, to] after t0")
    stated("gnss.clas", "float_error_m", "constant horizontal error while float")
    t = np.arange(-0.5, 62.0, 0.5)
    z = np.zeros(len(t))
    site = SimulatedSite("EPSG:6677", 16642.0, 96548.0, 271.4, 41.3, 1_781_143_200_000_000)
    none = {"white_m": 0.0, "gm_m": 0.0, "white_h_m": 0.0, "gm_h_m": 0.0, "bias_h_m": 0.0, "tau_s": 9.0, "tau_h_s": 9.0}
    receiver = Receiver(**none, rate_hz=1, outage_s=((10.0, 15.0),), float_s=((30.0, 40.0),), float_error_m=0.5)
    motion = SimulatedMotion(t, np.zeros((len(t), 3)), z, z, z, z, z)
    fixes = receive(receiver, (0.0, 0.0, 0.0), site, motion, 60.0, 3, "x")
    assert sorted(set(range(61)) - set(np.round(fixes.t_s).astype(int).tolist())) == [10, 11, 12, 13, 14]
    floating = fixes.quality == FLOAT
    assert np.round(fixes.t_s[floating]).astype(int).tolist() == list(range(30, 40))
    assert np.hypot(*fixes.error_m[:, :2].T) == pytest.approx(0.5 * floating)
    assert np.ptp(fixes.error_m[floating], axis=0).max() == 0.0


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        ("[drive]\nramp_m = 3.0\nradius_m = 2.0", "[drive]\nramp_m = 3.1\nradius_m = 2.0", "1.5 times `radius_m`"),
        ("[drive]\npass_m = [3.0, 4.0]\npasses = 2", "[drive]\npass_m = [3.0, 4.0]\npasses = 3", "2 entries for 3"),
        ("[drive]\nspeed_factors = [0.5, 1, 1]", "[drive]\nspeed_factors = [0.0, 1, 1]", "must be positive"),
        ("[drive]\nstops = [[2, 8.0, 1]]", "[drive]\nstops = [[2, 8.1, 1]]", "is on none of the 3 passes"),
        ("[drive]\nstops = [[2, 1.0, 1]]", "[drive]\nstops = [[3, 1.0, 1]]", "is on none of the 3 passes"),
        ("[drive]\nstops = [[0, 1.0, 0]]", "[drive]\nstops = [[0, 1.0, -1]]", "is on none of the 3 passes"),
        (
            "[implement]\nlift_m = 0.2\nworking_depth_m = 0.1",
            "[implement]\nlift_m = 0.1\nworking_depth_m = 0.1",
            "lift_m",
        ),
        ('t0 = "2026-06-11T01:00:00+09:00"', 't0 = "2026-06-11T01:00:00"', "no UTC offset"),
        ("[lidar]\nrpm = 1200", "[lidar]\nrpm = 900", "rpm"),
        ("[lidar]\nmax_range_m = 130.0", "[lidar]\nmax_range_m = 131.0", "max_range_m"),
    ],
)
def test_scenario__that_cannot_be_driven_is_refused(good: str, bad: str, words: str) -> None:
    scenario_from(good, "scenario.toml")
    with pytest.raises(InputError, match=re.escape(words)):
        scenario_from(bad, "scenario.toml")
