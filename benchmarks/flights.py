"""`furrowmap run` on simulated flights: errors of trajectory and boresight, and whether sigmas say so.

flights.toml beside this file is the table of the flights: ten, of many kinds, whose errors over sigmas are pooled. They
are simulated once and kept in the user's cache folder; again when the table changed. With --trajectories, flights
without scans are simulated, in seconds, as often as --repeat says with other seeds.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import furrowmap
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.simulator.scenario import Scenario, as_toml
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.simulator.simulate_flight import lay_out_flight

FloatArray = NDArray[np.float64]

TABLE = Path(__file__).with_suffix(".toml")
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "furrowmap" / "benchmarks" / "flights"
COMMON = {
    "place": {"lon_lat_deg": (11.3885, 55.328), "height_m": 70.0, "geoid_m": 36.621, "crs": "EPSG:25832"},
    "gnss": {"rtk": {"white_m": 0.008, "white_h_m": 0.015, "gm_m": 0.005, "gm_h_m": 0.005}},
    "imu": {},
    "lidar": {"xyz_m": (0.0, 0.013, -0.304)},
}
"""What all flights share, unless their table says otherwise."""
AXES = ("e_m", "n_m", "h_m", "roll_deg", "pitch_deg", "heading_deg")
HEAD = f"{'':14}{'e':>6}{'n':>6}{'h':>6} mm{'roll':>8}{'pitch':>8}{'heading':>9} deg   boresight x, y, z (sigma), deg"


@dataclass(frozen=True)
class Judged:
    """The errors of a flight.

    Attributes:
        error: (n, 6) easting, northing, height (m), roll, pitch, heading (deg) of each pose.
        over_sigma: (n, 6) the same in standard deviations.
        boresight_deg: (3,) error of the mounting about the vehicle's axes.
        boresight_sigma_deg: (3,) its standard deviations; inf where the mounting was not found.
        seconds: that the run took.
        verdict: likely cause of a contradiction, which a right flight does not have; empty without one.
    """

    error: FloatArray
    over_sigma: FloatArray
    boresight_deg: FloatArray
    boresight_sigma_deg: FloatArray
    seconds: float
    verdict: str


def main() -> int:
    flights = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    options = _options()
    if unknown := set(options.only) - set(flights):
        print(f"no such flight: {', '.join(sorted(unknown))}; there are {', '.join(flights)}", file=sys.stderr)
        return 2
    judged: dict[str, Judged] = {}
    print(HEAD, flush=True)
    for number in range(options.repeat if options.trajectories else 1):
        for name in options.only or flights:
            shown = f"{name}{f'+{number}' if number else ''}"
            try:
                judged[shown] = judge(simulated(name, flights[name], number, scans=not options.trajectories))
            except FurrowmapError as error:
                print(f"{shown:14}{error}", flush=True)
                continue
            print(line(shown, judged[shown]), flush=True)
    if judged:
        print_pooled(list(judged.values()))
    return 0 if judged else 1


def simulated(name: str, keys: Mapping[str, object], number: int, *, scans: bool) -> Path:
    """The folder of a flight's recording, simulated at the first call and when its table has changed."""
    scenario = msgspec.convert({"name": name, **_merged(COMMON, keys)}, Scenario)
    assert scenario.flight is not None
    folder = CACHE / name
    if not scans:
        replace = msgspec.structs.replace
        never = replace(scenario.lidar, start_s=1e6)
        scenario = replace(scenario, seed=scenario.seed + 1000 * number, lidar=never)
        folder = CACHE / f"{name}_trajectory_{number}"
    there = folder / "scenario.toml"
    if not there.exists() or there.read_text(encoding="utf-8") != as_toml(lay_out_flight(scenario, scenario.flight)):
        shutil.rmtree(folder, ignore_errors=True)
        simulate(scenario, folder)
        if not scans:
            session = folder / "session.toml"
            text = session.read_text(encoding="utf-8").replace('lidar = ["recording.pcap"]\n', "")
            session.write_text(text, encoding="utf-8")
    return folder


def judge(recording: Path) -> Judged:
    """Run a flight and compare its poses and its mounting with the truth.

    Raises:
        FurrowmapError: the run failed.
    """
    begin = perf_counter()
    with tempfile.TemporaryDirectory(dir=CACHE) as folder:
        result = furrowmap.run(recording / "session.toml", Path(folder) / "out")
        poses, report = result.trajectory, result.report
    seconds = perf_counter() - begin
    truth = np.loadtxt(recording / "truth" / "trajectory.csv", delimiter=",", skiprows=1)
    truth[:, 6] = np.degrees(np.unwrap(np.radians(truth[:, 6])))
    t_s = poses["t_s"].to_numpy()
    true = np.column_stack([np.interp(t_s, truth[:, 0], truth[:, k]) for k in range(1, 7)])
    found = np.column_stack([poses.geometry.x, poses.geometry.y, poses.geometry.z, *(poses[a] for a in AXES[3:])])
    error = found - true
    error[:, 5] = (error[:, 5] + 180.0) % 360.0 - 180.0
    sigma = np.column_stack([poses[f"sigma_{axis}"] for axis in AXES])
    lidar = (report.get("calibration") or {}).get("lidar") or {}
    mounting = tomllib.loads((recording / "truth" / "mounting_truth.toml").read_text(encoding="utf-8"))["lidar"]
    stated = tomllib.loads((recording / "session.toml").read_text(encoding="utf-8"))["lidar"]["rpy_deg"]
    rpy = (
        Rotation.from_euler("ZYX", a[::-1], degrees=True) for a in (lidar.get("rpy_deg", stated), mounting["rpy_deg"])
    )
    off = next(rpy) * next(rpy).inv()
    return Judged(
        error,
        error / sigma,
        np.degrees(off.as_rotvec()),
        np.array(lidar.get("sigma_deg", (np.inf, np.inf, np.inf)), np.float64),
        seconds,
        "" if report["verdict"]["consistent"] is not False else report["verdict"].get("cause", "unknown"),
    )


def rms(values: FloatArray) -> FloatArray:
    """Of each column."""
    out: FloatArray = np.sqrt(np.mean(values**2, axis=0))
    return out


def line(name: str, judged: Judged) -> str:
    """The figures of a flight, as columns below `HEAD`."""
    error = rms(judged.error)
    angles = "  ".join(
        f"{off:+.4f} ({sigma:.4f})" for off, sigma in zip(judged.boresight_deg, judged.boresight_sigma_deg, strict=True)
    )
    places = "".join(f"{1000 * value:6.1f}" for value in error[:3])
    turns = f"{error[3]:8.4f}{error[4]:8.4f}{error[5]:9.4f}"
    return f"{name:14}{places}   {turns}       {angles}   {judged.seconds:.0f} s  {judged.verdict}"


def print_pooled(judged: list[Judged]) -> None:
    """Error over sigma by axis, each flight with the same weight, and that of the boresights."""
    pooled = np.sqrt(np.mean([rms(one.over_sigma) ** 2 for one in judged], axis=0))
    mounting = np.array([one.boresight_deg / one.boresight_sigma_deg for one in judged])
    print(f"\nerror over sigma, pooled over {len(judged)} flights")
    print("  " + ", ".join(f"{axis.rsplit('_', 1)[0]} {value:.2f}" for axis, value in zip(AXES, pooled, strict=True)))
    print(f"  position {rms(pooled[:3]):.2f}, attitude {rms(pooled[3:]):.2f}")
    found = mounting[np.isfinite([one.boresight_sigma_deg[0] for one in judged])]
    if len(found):
        by_axis = ", ".join(f"{value:.2f}" for value in rms(found))
        print(f"  boresight of {len(found)} flights {rms(found.ravel()):.2f} ({by_axis})")


def _merged(common: Mapping[str, object], keys: Mapping[str, object]) -> dict[str, object]:
    out = dict(common)
    for key, value in keys.items():
        there = out.get(key)
        out[key] = _merged(there, value) if isinstance(there, Mapping) and isinstance(value, Mapping) else value
    return out


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trajectories", action="store_true", help="GNSS and IMU alone")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="with other seeds, for --trajectories")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these flights instead of all")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
