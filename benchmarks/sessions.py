"""`furrowmap run` on simulated sessions: how far trajectories are from the truth, and whether sigmas say so.

sessions.toml beside this file is the table of the sessions: twenty of all kinds, whose errors over sigmas are pooled,
and some after them that are known to be hard. They are simulated once (ten minutes, 2 GB) and kept in the user's cache
folder, again when the table changed; of every result, field.gpkg and report.json are kept there.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from trajectory_error import SIGMAS, Errors, Period, judge, load_simulation, load_trajectory, rms

from furrowmap.core.simulator.drive import plan_path
from furrowmap.core.simulator.noise import random_for
from furrowmap.core.simulator.scenario import Scenario, as_toml
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.simulator.site import lay_out

FloatArray = NDArray[np.float64]

TABLE = Path(__file__).with_suffix(".toml")
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "furrowmap" / "benchmarks"
KEPT = ("field.gpkg", "report.json")
POOLED = 20
"""The first so many sessions of the table stand for what users drive; what follows is there because it is hard."""
BEYOND = 3.0
"""Errors of so many sigmas are counted."""
HEAD = """\
                          length  points |   shape: roll  pitch  height | offset (oracle)  tilt (oracle) \
| heading: moving standing |   x (GNSS)    y (GNSS) | outage   float
                               s       M |          deg    deg      mm |       mm            deg       \
|             deg      deg |         mm          mm |     cm      cm"""


def main() -> int:
    sessions = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    options = _options()
    if unknown := set(options.only) - set(sessions):
        print(f"no such session: {', '.join(sorted(unknown))}; there are {', '.join(sessions)}", file=sys.stderr)
        return 2
    found: dict[str, dict[str, object]] = {}
    ratios: dict[str, Mapping[str, FloatArray]] = {}
    failed = []
    print(HEAD, flush=True)
    for name in options.only or sessions:
        recording = simulated(name, sessions[name])
        try:
            field = run(recording, keep=options.keep)
        except subprocess.CalledProcessError as error:
            failed.append(name)
            print(f"{name:24}  {error.stderr.decode(errors='replace').strip()}", flush=True)
            continue
        simulation = load_simulation(recording)
        errors, ratios[name] = judge(*load_trajectory(field), simulation)
        found[name] = {
            "length_s": simulation.duration_s,
            "points": simulation.points,
            "errors": errors,
            "error_over_sigma": over_sigma(ratios[name]),
        }
        print(f"{name:24}{simulation.duration_s:8.1f}{simulation.points / 1e6:8.1f} {line(errors)}", flush=True)
    if found:
        usual = [ratios[name] for name in list(sessions)[:POOLED] if name in ratios] or list(ratios.values())
        pooled = over_sigma({key: np.concatenate([ratio[key] for ratio in usual]) for key in SIGMAS})
        print_over_sigma({**{name: over_sigma(ratio) for name, ratio in ratios.items()}, "pooled": pooled})
        if options.json:
            options.json.write_bytes(
                msgspec.json.format(msgspec.json.encode({"sessions": found, "pooled": pooled}), indent=1) + b"\n"
            )
    return 1 if failed else 0


def simulated(name: str, keys: Mapping[str, object]) -> Path:
    """The folder of a session's recording, simulated at the first call and when its table has changed."""
    scenario = msgspec.convert({"name": name, **keys}, Scenario)
    folder = CACHE / "sessions" / name
    there = folder / "scenario.toml"
    wanted = as_toml(lay_out(scenario, plan_path(scenario.drive, random_for(scenario.seed, "driver"))))
    if not there.exists() or there.read_text(encoding="utf-8") != wanted:
        print(f"simulating {name}, once …", file=sys.stderr)
        simulate(scenario, folder)
        shutil.rmtree(results(folder), ignore_errors=True)
    return folder


def results(recording: Path) -> Path:
    """Where what is kept of a recording's result lies."""
    return CACHE / "sessions_results" / recording.name


def run(recording: Path, *, keep: bool) -> Path:
    """The field.gpkg of `furrowmap run` on a recording; with `keep` an old one where there is one.

    Raises:
        CalledProcessError: the run failed.
    """
    kept = results(recording)
    if not (keep and (kept / "field.gpkg").exists()):
        kept.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=kept) as folder:
            furrowmap, session = Path(sys.executable).with_name("furrowmap"), recording / "session.toml"
            subprocess.run([furrowmap, "run", session, "-o", f"{folder}/out", "-q"], check=True, capture_output=True)
            for product in KEPT:
                Path(folder, "out", product).replace(kept / product)
    return kept / "field.gpkg"


def line(errors: Errors) -> str:
    """The figures of a session, as columns below `HEAD`."""

    def worst_cm(periods: tuple[Period, ...]) -> str:
        if any(period.scans == 0 for period in periods):
            return f"{'no pose':>8}"
        return f"{100 * max(period.horizontal_rmse_m for period in periods):8.1f}" if periods else f"{'–':>8}"

    def mm(value_m: float, oracle_m: float) -> str:
        return f"{1000 * value_m:6.1f} ({1000 * oracle_m:3.0f})"

    return " | ".join(
        [
            f"{errors.shape_roll_rms_deg:14.3f} {errors.shape_pitch_rms_deg:6.3f} "
            f"{1000 * errors.shape_antenna_height_rms_m:7.1f}",
            f"{mm(abs(errors.absolute.offset_m), abs(errors.oracle.offset_m))}    "
            f"{errors.absolute.tilt_deg:6.3f} ({errors.oracle.tilt_deg:5.3f})",
            f"{errors.heading_moving_rms_deg:14.3f} {errors.heading_standing_rms_deg:8.3f}",
            f"{mm(errors.x_rmse_m, errors.gnss_x_rmse_m)} {mm(errors.y_rmse_m, errors.gnss_y_rmse_m)}",
            f"{worst_cm(errors.outages)}{worst_cm(errors.floats)}",
        ]
    )


def over_sigma(ratios: Mapping[str, FloatArray]) -> dict[str, dict[str, float]]:
    """RMS of errors over their sigmas, and the share of them beyond `BEYOND`."""
    return {
        key: {"rms": rms(values), "share_beyond": float(np.mean(np.abs(values) > BEYOND)) if len(values) else np.nan}
        for key, values in ratios.items()
    }


def print_over_sigma(rows: Mapping[str, Mapping[str, Mapping[str, float]]]) -> None:
    names = "".join(f"{key.rsplit('_', 1)[0]:>9}" for key in SIGMAS)
    print(f"\n{'':24}{'RMS of error over sigma':>54} | {f'scans beyond {BEYOND:.0f} sigma, %':>54}")
    print(f"{'':24}{names} | {names}")
    for label, row in rows.items():
        ratios = "".join(f"{row[key]['rms']:9.2f}" for key in SIGMAS)
        shares = "".join(f"{100 * row[key]['share_beyond']:9.1f}" for key in SIGMAS)
        print(f"{label:24}{ratios} | {shares}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these sessions instead of all")
    parser.add_argument("--keep", action="store_true", help="judge the results there are, run only what is missing")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE as well")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
