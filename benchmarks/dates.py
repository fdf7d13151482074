"""Ties of dates on simulated fields: what is left of the receivers' errors, soil moved, and whether sigmas say so.

dates.toml beside this file is the table of the fields and of the drives on them, each on the ground that the earlier
ones left. They are simulated and run once (half an hour, 2 GB) and kept in the user's cache folder; the ties are made
anew. Judged against the simulator's ground, cell by cell: what neither date worked, and what was worked between two
dates.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import geopandas as gpd
import msgspec
import numpy as np
import rasterio
from numpy.typing import NDArray

import furrowmap
from furrowmap.core.simulator.scenario import EarlierDrive, Scenario
from furrowmap.core.simulator.simulate import simulate

FloatArray = NDArray[np.float64]

TABLE = Path(__file__).with_suffix(".toml")
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "furrowmap" / "benchmarks" / "dates"
HEIGHT_SIGMA_M = 0.04
"""Standard deviation of the bias of each date's heights."""
CELL_M = 0.05
"""Of the surfaces of runs."""


@dataclass(frozen=True)
class Judged:
    """A change between two dates against the truth.

    Attributes:
        offset_m: by which the heights of the dates differed before the tie.
        untouched_m: median error of the change where neither date worked.
        tilt_deg: of a plane through these errors.
        true_m, found_m, sigma_m: mean change of the ground worked in between.
        level_sigmas: error of the tie over its sigmas: offset in the middle, tilts (as of `level_sigmas`).
        place_m: error of the shift in place, by the mean errors of the two trajectories (the slow error of the
            receivers during a session leaves that open to some millimetres).
        upright: pieces of walls, and posts, that took part.
    """

    offset_m: float
    untouched_m: float
    tilt_deg: float
    true_m: float
    found_m: float
    sigma_m: float
    level_sigmas: FloatArray
    place_m: FloatArray
    upright: int


def main() -> int:
    fields = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fields", nargs="*", default=list(fields))
    ratios: list[float] = []
    moved: list[float] = []
    print(
        "field, dates               before   untouched     tilt | soil moved: true    found        error  over sigma"
        " | place, walls and posts"
    )
    for name in parser.parse_args().fields:
        for words, found in judged_field(results(name, fields[name])):
            error = found.found_m - found.true_m
            ratios += found.level_sigmas.tolist()
            moved.append(error / found.sigma_m)
            print(
                f"{name:16} {words:8} {1e3 * found.offset_m:+8.1f} mm {1e3 * found.untouched_m:+6.2f} mm "
                f"{found.tilt_deg:8.4f}° | {1e3 * found.true_m:+8.2f} {1e3 * found.found_m:+8.2f} ± "
                f"{1e3 * found.sigma_m:4.2f} mm {100 * error / found.true_m:+7.1f} %  {error / found.sigma_m:+.1f} "
                f"        | {1e3 * found.place_m[0]:+5.1f} {1e3 * found.place_m[1]:+5.1f} mm {found.upright}",
                flush=True,
            )
    print(f"error over sigma (RMS): ties {rms(ratios):.2f} ({len(ratios)}), soil moved {rms(moved):.2f} ({len(moved)})")
    return 0


def results(name: str, field: Mapping[str, Any]) -> list[Path]:
    """The results of the drives on a field, simulated and run where they are not kept."""
    common = {key: value for key, value in field.items() if key not in ("drives", "seed")}
    earlier: tuple[EarlierDrive, ...] = ()
    found = []
    for k, drive in enumerate(field["drives"]):
        start = dt.datetime(2026, 6, 11, 1, 23, 40, 300_000, tzinfo=dt.UTC) + dt.timedelta(days=7 * k)
        keys = {
            **common,
            **drive,
            "seed": 100 * field["seed"] + k,
            "name": f"{name}_{k + 1}",
            "title": f"{name} {k + 1}",
            "t0": start.isoformat(),
            "soil": {**common.get("soil", {}), "seed": field["seed"]},
            "gnss": {"clas": {"bias_h_m": HEIGHT_SIGMA_M}},
        }
        scenario = msgspec.structs.replace(msgspec.convert(keys, Scenario), earlier=earlier)
        folder, result = CACHE / f"{name}_{k + 1}", CACHE / "results" / f"{name}_{k + 1}"
        if not (folder / "truth" / "figures.json").exists():
            print(f"simulating {folder.name}, once …", file=sys.stderr)
            simulate(scenario, folder)
        if not (result / "report.json").exists():
            command = Path(sys.executable).with_name("furrowmap")
            subprocess.run([command, "run", folder / "session.toml", "-o", result, "-q"], check=True)
        seed, tool = scenario.seed, scenario.implement
        earlier = (*earlier, EarlierDrive(seed=seed, drive=scenario.drive, soil=scenario.soil, implement=tool))
        found.append(result)
    return found


def judged_field(folders: Sequence[Path]) -> list[tuple[str, Judged]]:
    """Each change of a field, judged."""
    with tempfile.TemporaryDirectory() as made:
        account = furrowmap.tie(folders, Path(made) / "tie")
        rows = []
        for change in account["changes"]:
            one, other = (
                CACHE / Path(account["dates"][change[key] - 1]["folder"]).name for key in ("date_a", "date_b")
            )
            pair = (change["date_a"], change["date_b"])
            tie = next((row for row in account["ties"] if (row["date_a"], row["date_b"]) == pair), None)
            found = _judged(Path(made) / "tie" / change["raster"], truth(one), truth(other), change, tie, account)
            if tie:
                found = replace(found, level_sigmas=level_sigmas(one, other, tie, account["middle_m"]))
            place = np.full(2, np.nan)
            if tie:
                moved = np.array([tie["east_m"], tie["north_m"]])
                place = moved + place_error(other) - place_error(one)
            found = replace(found, place_m=place, upright=tie["upright"] if tie else 0)
            rows.append((f"{pair[0]} to {pair[1]}", found))
    return rows


def place_error(recording: Path) -> FloatArray:
    """Mean error (2,) of the positions of a run, east and north."""
    found = gpd.read_file(CACHE / "results" / recording.name / "field.gpkg", layer="trajectory")
    true = np.genfromtxt(recording / "truth" / "trajectory.csv", delimiter=",", names=True)
    t_s = found["time"].dt.tz_convert(None).to_numpy().astype("datetime64[us]").astype(np.int64) / 1e6
    at = (np.interp(t_s, true["time_unix_s"], true[name]) for name in ("e_m", "n_m"))
    off = [np.mean(place - truth) for place, truth in zip((found.geometry.x, found.geometry.y), at, strict=True)]
    return np.array(off)


def truth(recording: Path) -> dict[str, FloatArray]:
    """The simulator's ground."""
    with np.load(recording / "truth" / "surface.npz") as stored:
        return {name: stored[name] for name in stored.files}


def _judged(
    raster: Path,
    one: Mapping[str, FloatArray],
    other: Mapping[str, FloatArray],
    change: Mapping[str, Any],
    tie: Mapping[str, Any] | None,
    account: Mapping[str, Any],
) -> Judged:
    with rasterio.open(raster) as opened:
        values, to_map = opened.read(1).astype(np.float64), opened.transform
    rows, columns = values.shape
    x = to_map.c + to_map.a * (np.arange(columns) + 0.5)
    y = to_map.f + to_map.e * (np.arange(rows) + 0.5)
    column = np.floor((x - one["e0"]) / one["cell_m"]).astype(int)
    row = np.floor((y - one["n0"]) / one["cell_m"]).astype(int)
    height, width = one["before"].shape
    there = ((row >= 0) & (row < height))[:, None] & ((column >= 0) & (column < width))[None]
    at = np.ix_(row.clip(0, height - 1), column.clip(0, width - 1))
    error = values - (other["after"] - one["after"])[at]
    worked = np.isfinite(one["worked_time"]) | np.isfinite(other["worked_time"])
    still = there & np.isfinite(error) & ~worked[at]
    east, north = np.meshgrid(x - account["middle_m"][0], y - account["middle_m"][1])
    design = np.column_stack([np.ones(still.sum()), east[still], north[still]])
    plane = robust_plane(design, error[still])
    between = np.isfinite(other["worked_time"])
    return Judged(
        offset_m=-tie["height_m"] if tie else np.nan,
        untouched_m=float(np.median(error[still])),
        tilt_deg=float(np.degrees(np.hypot(plane[1], plane[2]))),
        true_m=float((other["after"] - one["after"])[between].mean()),
        found_m=change["mean_change_m"],
        sigma_m=change["mean_change_sigma_m"],
        level_sigmas=np.full(3, np.nan),
        place_m=np.full(2, np.nan),
        upright=0,
    )


def level_sigmas(one: Path, other: Path, tie: Mapping[str, Any], middle_m: Sequence[float]) -> FloatArray:
    """Errors (3,) of a tie over its standard deviations: offset in the middle, tilts east and north.

    A right tie is the plane through the difference of the errors of both surfaces before the tool, each against its own
    ground, wherever both dates saw any, whether it was worked in between or not.
    """
    (a, west_a, north_a, ground), (b, west_b, north_b, _) = (surface_error(recording) for recording in (one, other))
    west, north = max(west_a, west_b), min(north_a, north_b)
    a, b = a[north_a - north :, west - west_a :], b[north_b - north :, west - west_b :]
    rows, columns = min(a.shape[0], b.shape[0]), min(a.shape[1], b.shape[1])
    differ = b[:rows, :columns] - a[:rows, :columns]
    known = np.isfinite(differ)
    known &= np.abs(differ - np.median(differ[known])) < 0.3
    i, j = np.nonzero(known)
    x, y = CELL_M * (j + west + 0.5) - middle_m[0], CELL_M * (north - i - 0.5) - middle_m[1]
    design = np.column_stack([np.ones(len(x)), x, y])
    slope = robust_plane(design, ground[north_a - north :, west - west_a :][i, j])[1:]
    plane = robust_plane(design, differ[known])
    plane[0] -= slope @ (tie["east_m"], tie["north_m"])  # the tie moves a slope in place as well
    keys = ("height_m", "tilt_east_deg", "tilt_north_deg")
    moved, sigma = (np.array([tie[f"{key}{end}"] for key in keys]) for end in ("", "_sigma"))
    return np.asarray((moved + plane * [1.0, np.degrees(1.0), np.degrees(1.0)]) / sigma)


def surface_error(recording: Path) -> tuple[FloatArray, int, int, FloatArray]:
    """Heights before the tool less the true ones (rows, columns), cells to the western and northern edge, true ones."""
    with rasterio.open(CACHE / "results" / recording.name / "dsm_before.tif") as opened:
        values, to_map = opened.read(1, masked=True).astype(np.float64).filled(np.nan), opened.transform
    ground, (rows, columns) = truth(recording), values.shape
    column = np.floor((to_map.c + to_map.a * (np.arange(columns) + 0.5) - ground["e0"]) / ground["cell_m"]).astype(int)
    row = np.floor((to_map.f + to_map.e * (np.arange(rows) + 0.5) - ground["n0"]) / ground["cell_m"]).astype(int)
    height, width = ground["before"].shape
    there = ((row >= 0) & (row < height))[:, None] & ((column >= 0) & (column < width))[None]
    true = ground["before"][np.ix_(row.clip(0, height - 1), column.clip(0, width - 1))]
    edges = round(to_map.c / CELL_M), round(to_map.f / CELL_M)
    return np.where(there, values - true, np.nan), *edges, true


def robust_plane(design: FloatArray, values: FloatArray) -> FloatArray:
    """Offset and slopes of a plane through values, by least absolute differences."""
    weight = np.ones(len(values))
    for _ in range(8):
        plane = np.linalg.lstsq(design * weight[:, None], values * weight, rcond=None)[0]
        weight = 1.0 / np.sqrt(np.maximum(np.abs(values - design @ plane), 0.002))
    return np.asarray(plane, np.float64)


def rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    sys.exit(main())
