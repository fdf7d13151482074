"""The recording of a flight, and the files that a tractor with an IMU or a moving mount has as well."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from furrowmap.core.runtime.progress import Progress
from furrowmap.core.simulator.flight import duration_s, fly, lay_out_flight
from furrowmap.core.simulator.flight_scenario import Flight, ScenarioImu
from furrowmap.core.simulator.flight_truth import make_crop, write_flight_trajectory, write_ground, write_mounting
from furrowmap.core.simulator.gnss import receive, report, sentences
from furrowmap.core.simulator.inertial import measure, write_biases, write_imu
from furrowmap.core.simulator.line_scanner import record_lines
from furrowmap.core.simulator.motion import SimulatedMotion
from furrowmap.core.simulator.moving_mount import SimulatedMountMotion
from furrowmap.core.simulator.noise import random_for
from furrowmap.core.simulator.recording import SCANNERS, World, record, recording_file, second_file
from furrowmap.core.simulator.scenario import Scenario, ScenarioLidar
from furrowmap.core.simulator.site import find_site
from furrowmap.core.simulator.soil import make_ground


@dataclass(frozen=True)
class Written:
    """A recording that was written; `recording` is the name of the capture or table of scans."""

    scenario: Scenario
    recording: str
    figures: dict[str, Any]


def write_flight(folder: Path, scenario: Scenario, flight: Flight, progress: Progress) -> Written:
    """The recording of an aircraft and its truth, into `folder` and its folder "truth".

    Raises:
        InputError: the scenario describes no possible place, or too much ground.
    """
    scenario = lay_out_flight(scenario, flight)
    assert scenario.flight is not None
    flight, site, ground = scenario.flight, find_site(scenario), make_ground(scenario, [])
    middle = np.array([0.5 * scenario.field.size_e_m, 0.5 * scenario.field.size_n_m, flight.height_m])
    motion = fly(scenario, flight, site.map_scale(middle), random_for(scenario.seed, "flight"))
    crop = make_crop(scenario, flight, ground)
    world = World(scenario, site, ground, motion, None if crop is None else crop[0], moving(scenario))
    length_s = duration_s(flight)
    end_s, truth = length_s + scenario.lidar.stop_s, folder / "truth"
    capture = "scans.csv" if scenario.line else recording_file(scenario.lidar)
    (folder / "session.toml").write_text(session_head(scenario, capture), encoding="utf-8")
    fixes = receive(scenario.gnss.rtk, scenario.antenna.xyz_m, site, motion, end_s, scenario.seed, "gnss.nmea")
    (folder / "gnss.nmea").write_text(sentences(fixes, site, "0001"), encoding="ascii", newline="")
    write_sensors(folder, world, end_s)
    if scenario.line is not None:
        lidar = record_lines(folder / capture, world, scenario.line, length_s, progress)
    else:
        lidar, _ = record(folder / capture, world, length_s, progress)
    progress("truth", 0.0)
    write_flight_trajectory(truth / "trajectory.csv", motion, site)
    write_mounting(truth / "mounting_truth.toml", scenario.lidar)
    found = write_ground(folder, world, None if crop is None else crop[1])
    figures = {
        "name": scenario.name,
        "seed": scenario.seed,
        "t0_unix_s": site.t0_s,
        "duration_s": round(length_s, 3),
        **flight_figures(motion),
        **found,
        **lidar,
        "gnss": {"gnss.nmea": report(fixes)},
    }
    return Written(scenario, capture, figures)


def moving(scenario: Scenario) -> SimulatedMountMotion | None:
    """The motion of the mount; None where it is rigid."""
    return (
        SimulatedMountMotion.with_random_phases(scenario.mount, scenario.seed) if scenario.mount is not None else None
    )


def write_sensors(folder: Path, world: World, end_s: float) -> None:
    """The log of the IMU and the file of the mount, and the truth of the biases, where there are such."""
    scenario, site = world.scenario, world.site
    if scenario.imu is not None:
        log = measure(scenario.imu, world.motion, site, end_s, scenario.seed)
        write_imu(folder / "imu.csv", log, scenario.imu, site)
        write_biases(folder / "truth" / "imu_bias.csv", log, scenario.imu, site)
    if world.mount is not None:
        world.mount.write(folder / "mount.csv", site, end_s, scenario.seed)


def flight_figures(motion: SimulatedMotion) -> dict[str, Any]:
    """Length and tilt of a flight."""
    tilt = np.degrees(np.hypot(motion.roll_rad, motion.pitch_rad))
    return {
        "length_m": round(float(np.hypot(*np.diff(motion.xyz_m[:, :2], axis=0).T).sum()), 1),
        "tilt_max_deg": round(float(tilt.max()), 2),
        "tilt_rms_deg": round(float(np.sqrt((tilt**2).mean())), 2),
    }


def session_head(scenario: Scenario, capture: str) -> str:
    """The session as its user states it, but for an implement and a field."""
    second, line = scenario.second_lidar, scenario.line is not None
    scanner = _lidar_table("[lidar]\n", scenario.lidar, line=line)
    if second is not None:
        first, other = (f"[[lidar]]\nname = {json.dumps(name)}\n" for name in (second.first_name, second.name))
        other += f'files = ["{second_file(second)}"]\nminus_gnss_s = {second.minus_gnss_s!r}\n'
        scanner = _lidar_table(first, scenario.lidar) + "\n" + _lidar_table(other, second)
    parts = [
        f"""\
furrowmap = 1
name = {json.dumps(scenario.title, ensure_ascii=False)}

[recording]
lidar = ["{capture}"]
gnss = ["gnss.nmea"]
lidar_minus_gnss_s = {scenario.clock.lidar_minus_gnss_s!r}

[crs]
map = {json.dumps(scenario.place.crs)}
heights = "ellipsoidal"
coordinates = "as-recorded"

[antenna]
xyz_m = {list(scenario.antenna.xyz_m)}

{scanner}"""
    ]
    if scenario.imu is not None:
        parts.append(_imu_table(scenario.imu))
    if scenario.mount is not None:
        parts.append('\n[mount]\nattitude = "mount.csv"\n')
    return "".join(parts)


def _lidar_table(head: str, lidar: ScenarioLidar, *, line: bool = False) -> str:
    stated = "" if line else SCANNERS[lidar.model].stated
    model = f'model = "{stated}"\n' if stated else ""
    return f"{head}{model}xyz_m = {list(lidar.xyz_m)}\nrpy_deg = {list(lidar.rpy_deg)}\n"


def _imu_table(imu: ScenarioImu) -> str:
    """`[imu]` with the figures of its data sheet; those that are zero are left to the class."""
    stated = {
        "gyro_deg_s_rthz": imu.gyro_noise_deg_s_rthz,
        "accel_mg_rthz": imu.accel_noise_mg_rthz,
        "gyro_bias_deg_s": imu.gyro_bias_deg_s,
        "accel_bias_mg": imu.accel_bias_mg,
        "gyro_walk_deg_s_rts": imu.gyro_walk_deg_s_rts,
        "accel_walk_mg_rts": imu.accel_walk_mg_rts,
    }
    noise = ", ".join(f"{key} = {value!r}" for key, value in stated.items() if value > 0.0)
    return f"""
[imu]
files = ["imu.csv"]
xyz_m = {list(imu.xyz_m)}
rpy_deg = {list(imu.rpy_deg)}
class = {json.dumps(imu.kind)}
noise = {{ {noise} }}
"""
