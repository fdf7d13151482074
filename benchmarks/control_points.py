"""`[field] control_points` on simulated drives and flights whose positions are 5 cm off, against the truth.

Of twelve surveyed points four correct and eight check; one of the four has a gross error of 0.1 m. On flights each
point lies under a disc or a checkerboard. Printed are the errors of the corrected cloud at the eight against the true
ground and the true middles of the targets, the same over their standard deviations, and which points were left out.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

import furrowmap
from furrowmap.core.simulator.scenario import Scenario
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.simulator.simulate_flight import lay_out_flight

FloatArray = NDArray[np.float64]

CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "furrowmap" / "benchmarks" / "control"
OFF_M: Final = np.array([0.05, -0.05, 0.05])
"""By which positions are off: the surveyed points are moved the other way, which is the same."""
GROSS_M: Final = 0.1
SURVEY_SIGMA: Final = np.array([0.003, 0.003, 0.005])
DISC_M: Final = 0.4
BOARD_M: Final = 0.6
KEYS: Final = {
    "drive": "",
    "discs": f"control_disc_m = {DISC_M}\n",
    "boards": f"control_checkerboard_m = {BOARD_M}\n",
}
"""What is controlled, a drive or flights over targets, and the keys of its session."""
NEAR_M: Final = 4.0
"""Points of a drive lie so near to the path, on ground that is not worked."""
COUNT: Final = 12
CONTROL: Final = 4


@dataclass(frozen=True)
class Trial:
    """Errors at the points to check, (8, 3) in metres and in standard deviations, and the names of points left out."""

    error_m: FloatArray
    over_sigma: FloatArray
    left_out: list[str]
    wrong: str
    seconds: float


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=tuple(KEYS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--right", action="store_true", help="no point has a gross error")
    options = parser.parse_args()
    trials = []
    for seed in options.seeds:
        trial = tried(options.kind, seed, gross=not options.right)
        trials.append(trial)
        worst = 1000.0 * np.nanmax(np.abs(trial.error_m), axis=0)
        print(
            f"{options.kind} {seed}: left out {trial.left_out} (wrong: {trial.wrong}); greatest error of e, n, h "
            f"{worst[0]:.1f}, {worst[1]:.1f}, {worst[2]:.1f} mm; {trial.seconds:.0f} s",
            flush=True,
        )
    error = np.concatenate([trial.error_m for trial in trials])
    ratio = np.concatenate([trial.over_sigma for trial in trials])
    print("RMS of e, n, h (mm):", np.round(1000.0 * rms(error), 1), "error over sigma (RMS):", np.round(rms(ratio), 2))
    return 0


def rms(values: FloatArray) -> FloatArray:
    """Of each column, nan left out; nan for an empty one."""
    out: FloatArray = np.sqrt(np.array([np.mean(column[np.isfinite(column)] ** 2) for column in values.T]))
    return out


def tried(kind: str, seed: int, *, gross: bool) -> Trial:
    """Simulate a recording, run it with control points, and compare with the truth."""
    folder = CACHE / f"{kind}_{seed}"
    if not (folder / "truth" / "figures.json").exists():
        simulate(msgspec.convert({"seed": seed}, Scenario) if kind == "drive" else flight(kind, seed), folder)
    chance = np.random.default_rng([seed, 61])
    true = points_of_drive(folder, chance) if kind == "drive" else points_of_flight(folder, kind, seed)
    control = spread(true[:, :2], CONTROL)
    surveyed = true - OFF_M + chance.normal(size=true.shape) * SURVEY_SIGMA
    wrong = control[int(chance.integers(CONTROL))]
    if gross:
        surveyed[wrong, 2] += GROSS_M * chance.choice([-1.0, 1.0])
    rows = ["name,e_m,n_m,h_m,sigma_e_m,sigma_n_m,sigma_h_m,role\n"]
    for number, place in enumerate(surveyed):
        numbers = ",".join(f"{value:.4f}" for value in (*place, *SURVEY_SIGMA))
        rows.append(f"P{number},{numbers},{'control' if number in control else 'check'}\n")
    (folder / "points.csv").write_text("".join(rows), encoding="ascii")
    text = (folder / "session.toml").read_text(encoding="utf-8")
    keys = f'control_points = "points.csv"\n{KEYS[kind]}'
    text = text.replace("[field]\n", f"[field]\n{keys}") if "[field]\n" in text else f"{text}\n[field]\n{keys}"
    (folder / "control.toml").write_text(text, encoding="utf-8")
    begin = perf_counter()
    with tempfile.TemporaryDirectory(dir=CACHE) as out:
        report = furrowmap.run(folder / "control.toml", Path(out) / "out").report
    points = report["control_points"]["points"]
    checks = [k for k in range(COUNT) if k not in control]
    residual, sigma = (np.array([points[k][name] for k in checks], np.float64) for name in ("residual_m", "sigma_m"))
    left_out = [point["name"] for point in points if point["state"] in ("left-out", "contradicts")]
    # The sigma of a residual holds that of the survey, so that the residual is compared with it.
    error = residual + (surveyed - (true - OFF_M))[checks]
    return Trial(error, residual / sigma, left_out, f"P{wrong}" if gross else "none", perf_counter() - begin)


def spread(places_m: FloatArray, count: int) -> list[int]:
    """So many places (n, 2) as far from each other as a surveyor would choose them."""
    chosen = [int(np.argmax(np.hypot(*(places_m - places_m.mean(axis=0)).T)))]
    while len(chosen) < count:
        away = np.min([np.hypot(*(places_m - places_m[k]).T) for k in chosen], axis=0)
        chosen.append(int(np.argmax(away)))
    return chosen


def flight(kind: str, seed: int) -> Scenario:
    """A flight with two strips across its four, over discs or checkerboards, the latter turned to all sides."""
    keys = {
        "name": "control",
        "seed": seed,
        "flight": {"height_m": 8.0, "strip_m": 40.0, "spacing_m": 6.0},
        "place": {"lon_lat_deg": (11.3885, 55.328), "height_m": 70.0, "geoid_m": 36.621, "crs": "EPSG:25832"},
        "gnss": {"rtk": {"white_m": 0.008, "white_h_m": 0.015, "gm_m": 0.005, "gm_h_m": 0.005}},
        "imu": {},
        "lidar": {"xyz_m": (0.0, 0.013, -0.304)},
    }
    bare = msgspec.convert(keys, Scenario)
    assert bare.flight is not None
    laid = lay_out_flight(bare, bare.flight)
    places = target_places(laid).tolist()
    if kind == "discs":
        return msgspec.structs.replace(bare, discs=tuple((e, n, DISC_M, 120.0) for e, n in places))
    boards = tuple((e, n, BOARD_M, 7.0 * k + 5.0 * seed, 120.0) for k, (e, n) in enumerate(places))
    return msgspec.structs.replace(bare, checkerboards=boards)


def target_places(scenario: Scenario) -> FloatArray:
    """(12, 2) places along and across the strips, from the corner of the grid."""
    assert scenario.flight is not None
    along = math.radians(90.0 - scenario.flight.heading_deg)
    forward = np.array([math.cos(along), math.sin(along)])
    left = np.array([-math.sin(along), math.cos(along)])
    start = np.array(scenario.flight.start_xy_m)
    width_m = scenario.flight.spacing_m * (scenario.flight.strips - 1)
    steps = np.linspace(0.05, 0.95, 4) * scenario.flight.strip_m
    places = [start + a * forward + b * left for a in steps for b in np.linspace(0.0, width_m, 3)]
    return np.array(places)


def points_of_flight(folder: Path, kind: str, seed: int) -> FloatArray:
    """(12, 3) the true middles of the targets."""
    scenario = flight(kind, seed)
    assert scenario.flight is not None
    with np.load(folder / "truth" / "surface.npz") as truth:
        places = target_places(lay_out_flight(scenario, scenario.flight))
        return with_heights(places, truth["soil"], truth)


def points_of_drive(folder: Path, chance: np.random.Generator) -> FloatArray:
    """(12, 3) places on ground that is not worked, near the path."""
    track = np.loadtxt(folder / "truth" / "trajectory.csv", delimiter=",", skiprows=1)[::50, 1:3]
    with np.load(folder / "truth" / "surface.npz") as truth:
        cell_m = float(truth["cell_m"])
        local = track - [float(truth["e0"]), float(truth["n0"])]
        worked = np.isfinite(truth["worked_time"])
        rows, columns = worked.shape
        found: list[FloatArray] = []
        while len(found) < COUNT:
            place = local[chance.integers(len(local))] + chance.uniform(-NEAR_M, NEAR_M, 2)
            column, row = np.floor(place / cell_m).astype(int)
            inside = 10 <= row < rows - 10 and 10 <= column < columns - 10
            if not inside or worked[row - 10 : row + 11, column - 10 : column + 11].any():
                continue
            if min((float(np.hypot(*(place - other))) for other in found), default=np.inf) > 2.0:
                found.append(place)
        return with_heights(np.array(found), truth["before"], truth)


def with_heights(places_m: FloatArray, height_m: NDArray[np.floating], truth: np.lib.npyio.NpzFile) -> FloatArray:
    """Places (n, 2) from the corner of the grid in the map frame, with the mean height within 0.25 m."""
    cell_m = float(truth["cell_m"])
    row, column = np.indices(height_m.shape)
    out = []
    for east, north in places_m:
        near = np.hypot((column + 0.5) * cell_m - east, (row + 0.5) * cell_m - north) <= 0.25
        out.append((east, north, height_m[near].mean()))
    return np.array(out, np.float64) + [float(truth[name]) for name in ("e0", "n0", "h0_m")]


if __name__ == "__main__":
    sys.exit(main())
