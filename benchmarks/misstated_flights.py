"""A flight misstated by one thing at a time: true errors against stated sigmas, and what the verdict says.

    python benchmarks/misstated_flights.py SESSION [--only WORD ...] [--images] [--json FILE [--resume]]

The session is a flight with truth/ beside it (trajectory.csv, and parcels_truth.csv where it has parcels), as the
sample uav_wheat. misstated_flights.toml beside this file holds what is misstated. The figure of merit is the worst
ratio of error to sigma without a verdict that names the cause.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import tomli_w
from misstated import (
    LARGEST,
    conclude,
    finished,
    keep,
    on_lines,
    options_of,
    part_of_ground,
    placed,
    rewrite_product,
    sentence,
)
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from trajectory_error import Poses, load_trajectory, rms

import furrowmap
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.process import keep_kernels

FloatArray = NDArray[np.float64]

TABLE = Path(__file__).with_suffix(".toml")
QUANTITIES = ("east", "north", "height", "roll", "pitch", "heading", "cloud", "crop")
AT_TOP = {
    "imu-clock-off": "clock",
    "imu-scale-off": "scale",
    "imu-frozen": "imu",
    "imu-shaken": "unit",
    "lever-arm-off": "scanner",
    "scanner-clock-off": "clock",
    "gnss-frozen": "positions",
    "gnss-heights": "positions",
    "gnss-steps": "positions",
    "model-differs": "model",
    "camera-times-off": "camera",
    "camera-mounting-off": "camera",
    "camera-tension": "camera",
    "camera-residuals": "camera",
    "images-not-adjusted": "camera",
    "images-unreadable": "camera",
    "control-points-off": "control-points",
    "control-points-unseen": "control-points",
}
"""Codes of what was found and mended, or left out, which reports show beside the verdict, and what they name."""
DEGREE_M = 111_195.0
BELOW_M = np.array([[x, y, -6.3] for x in (-1.0, 1.0) for y in (-4.0, -2.0, 0.0, 2.0, 4.0)])
"""(m, 3) points of the ground under the vehicle, which stand for its cloud."""


@dataclass(frozen=True)
class Judged:
    """One case.

    Attributes:
        causes: any of which the verdict may name; none of a right flight.
        refused: code of the error with which the run ended; empty where there is a result.
        errors: RMS of the true errors by QUANTITIES, in m and degrees.
        sigmas: RMS of the stated sigmas.
        cause: of the report's verdict; None where it finds the flight consistent.
        codes: of the report's warnings.
    """

    causes: Sequence[str]
    refused: str
    errors: Mapping[str, float] = dataclasses.field(default_factory=dict)
    sigmas: Mapping[str, float] = dataclasses.field(default_factory=dict)
    cause: str | None = None
    codes: Sequence[str] = ()

    @property
    def worst(self) -> float:
        """The largest ratio of an error to its sigma."""
        return max((self.errors[key] / self.sigmas[key] for key in self.errors), default=0.0)

    @property
    def named(self) -> bool:
        """Whether the verdict, or a doubt beside it, names what is wrong."""
        return self.cause in self.causes or any(AT_TOP.get(code) in self.causes for code in self.codes)

    @property
    def well(self) -> bool:
        """Whether a right flight is not doubted, and a wrong one is named or as good as it says."""
        if self.causes:
            return bool(self.refused) or self.named or self.worst <= LARGEST
        return not self.refused and self.cause is None and self.worst <= LARGEST


def main() -> int:
    keep_kernels()
    parser = options_of(__doc__)
    parser.add_argument("session", type=Path, help="a flight with truth/ beside it")
    parser.add_argument("--images", action="store_true", help="with the session's images")
    options = parser.parse_args()
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    found = finished(options, Judged)
    print(f"{'':26}" + "".join(f"{key:>15}" for key in QUANTITIES) + f"{'worst':>8}  verdict", flush=True)
    for name, misstated in table.items():
        if options.only and not any(word in name for word in options.only):
            continue
        if name not in found:
            found[name] = case(options.session, misstated, with_images=options.images)
            keep(found, options.json)
        print(line(name, found[name]), flush=True)
    return conclude(found, "verdict")


def case(session: Path, misstated: Mapping[str, Any], *, with_images: bool) -> Judged:
    """Run a flight with what is misstated of it."""
    causes = misstated.get("causes", ())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wrong = misstate(session, folder, misstated, with_images=with_images)
        try:
            furrowmap.run(wrong, folder / "out")
        except FurrowmapError as error:
            return Judged(causes, error.code)
        report = json.loads((folder / "out" / "report.json").read_text(encoding="utf-8"))
        errors, sigmas = judged(session.parent / "truth", folder / "out" / "field.gpkg", report)
        if keep := os.environ.get("KEEP_REPORT"):
            shutil.copy(folder / "out" / "report.json", keep)
    cause = None if report["verdict"]["consistent"] is not False else report["verdict"].get("cause", "unknown")
    return Judged(causes, "", errors, sigmas, cause, sorted({warning["code"] for warning in report["warnings"]}))


def judged(truth: Path, field: Path, report: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, float]]:
    """RMS of errors and of stated sigmas by QUANTITIES; of the crop only where there are parcels."""
    poses, stated = load_trajectory(field)
    columns = np.genfromtxt(truth / "trajectory.csv", delimiter=",", names=True)
    t_s = columns["time_unix_s"]
    known = (poses.t_s >= t_s[0]) & (poses.t_s <= t_s[-1])
    poses, stated = Poses(poses.t_s[known], poses.xyz_m[known], poses.rph_deg[known]), stated[known]
    true = [np.interp(poses.t_s, t_s, columns[key]) for key in ("e_m", "n_m", "h_m", "roll_deg", "pitch_deg")]
    true.append(np.degrees(np.interp(poses.t_s, t_s, np.unwrap(np.radians(columns["heading_deg"])))))
    off = np.column_stack([poses.xyz_m, poses.rph_deg]) - np.column_stack(true)
    off[:, 3:] = (off[:, 3:] + 180.0) % 360.0 - 180.0
    stated = np.where(np.isfinite(stated), stated, 1e3)
    errors = {key: rms(off[:, k]) for k, key in enumerate(QUANTITIES[:6])}
    sigmas = {key: rms(stated[:, k]) for k, key in enumerate(QUANTITIES[:6])}
    if lidar := report["calibration"] and report["calibration"].get("lidar"):
        errors["cloud"], sigmas["cloud"] = _cloud(truth, report, lidar, poses, np.column_stack(true), stated)
    parcels = truth / "parcels_truth.csv"
    if parcels.is_file() and "parcels" in {name for name, _ in pyogrio.list_layers(field)}:
        with parcels.open(encoding="utf-8") as file:
            heights = {row["id"]: float(row["mean_height_m"]) for row in csv.DictReader(file)}
        found = pyogrio.read_dataframe(field, layer="parcels", read_geometry=False)
        differ = found["mean_height_m"] - [heights[str(key)] for key in found["id"]]
        errors["crop"] = rms(differ.fillna(0.0).to_numpy())
        sigmas["crop"] = rms(found["height_sigma_m"].fillna(1e3).to_numpy())
    return errors, sigmas


def _cloud(
    truth: Path,
    report: Mapping[str, Any],
    lidar: Mapping[str, Any],
    poses: Poses,
    true: FloatArray,
    stated: FloatArray,
) -> tuple[float, float]:
    """RMS of the error of the ground's points, all axes together, and the sigma of poses, mounting and place."""
    mounted = tomllib.loads((truth / "mounting_truth.toml").read_text(encoding="utf-8"))["lidar"]
    session = report["session"]["lidar"]
    used = lidar["rpy_deg"] if lidar["used"] else session["rpy_deg"]
    place = lidar["xyz_m"] if lidar["used"] else session["xyz_m"]
    turn = _mounted(used) * _mounted(mounted["rpy_deg"]).inv()
    ours = turn.apply(BELOW_M - np.array(mounted["xyz_m"])) + np.array(place)
    step = max(1, len(poses.t_s) // 500)
    ours_m = placed(ours, Poses(poses.t_s[::step], poses.xyz_m[::step], poses.rph_deg[::step]))
    true_m = placed(BELOW_M, Poses(poses.t_s[::step], true[::step, :3], true[::step, 3:]))
    off_m = np.linalg.norm(ours_m - true_m, axis=2)
    arms = np.sqrt(
        [np.mean(BELOW_M[:, [1, 2]] ** 2) * 2, np.mean(BELOW_M[:, [0, 2]] ** 2) * 2, np.mean(BELOW_M[:, :2] ** 2) * 2]
    )
    angles = np.radians(np.hypot(stated[:, 3:], lidar["sigma_deg"]))
    # What the flight itself shows of the scanner's place: nobody has confirmed the stated one.
    place_m = np.array(lidar["together"]["sigma"][4:])
    own_m2 = (np.hypot(stated[:, :3], place_m) ** 2).sum(axis=1)
    return rms(off_m.ravel()), rms(np.sqrt(own_m2 + ((angles * arms) ** 2).sum(axis=1)))


def misstate(session: Path, folder: Path, misstated: Mapping[str, Any], *, with_images: bool) -> Path:
    """The session in a folder with what is misstated, and its files beside it.

    Where neither positions, parcels nor check points are concerned, a part of the ground is mapped alone.
    """
    keys = tomllib.loads(session.read_text(encoding="utf-8"))
    with_images = with_images or misstated.get("images", False)
    for table in (*misstated.get("without", ()), *(() if with_images else ("camera",))):
        keys.pop(table, None)
    for path in session.parent.iterdir():
        if path.is_file():
            shutil.copy(path, folder / path.name)
    for path, value in misstated.get("session", {}).items():
        table, key = path.split(".")
        keys.setdefault(table, {})[key] = value
    if with_images and "camera" in keys:
        shutil.copytree(session.parent / "images", folder / "images")
    for name, change in (("gnss", _positions), ("imu", _inertial), ("parcels", _parcels), ("points", _points)):
        if name in misstated:
            change(folder, keys, misstated[name])
    if "product" in misstated:
        capture = folder / keys["recording"]["lidar"][0]
        rewrite_product(capture, capture, misstated["product"])
    if not (misstated.keys() & {"gnss", "parcels"}) and misstated and "check_points" not in keys.get("field", {}):
        keys.pop("parcels", None)
        truth = np.loadtxt(session.parent / "truth" / "trajectory.csv", delimiter=",", skiprows=1, usecols=(1, 2))
        part_of_ground(keys, folder, np.median(truth, axis=0))
    out = folder / "misstated.toml"
    out.write_text(tomli_w.dumps(keys), encoding="utf-8")
    return out


def _positions(folder: Path, keys: Mapping[str, Any], what: Mapping[str, Any]) -> None:
    """Change the NMEA log: its times, qualities, standard deviations, geoid separations, or places in seconds."""
    path = folder / what.get("log", keys["recording"]["gnss"][0])
    lines: list[str] = []
    first_s: float | None = None
    frozen: dict[str, list[str]] = {}
    texts = path.read_text(encoding="ascii").splitlines()
    lined_m = on_lines(texts, what["line_s"]) if "line_s" in what else {}
    for number, text in enumerate(texts):
        field = text.partition("*")[0].lstrip("$").split(",")
        kind = field[0][2:]
        if kind in ("GGA", "RMC", "GST"):
            at_s = 3600.0 * int(field[1][:2]) + 60.0 * int(field[1][2:4]) + float(field[1][4:])
            first_s = at_s if first_s is None else first_s
            if "late_s" in what:
                field[1] = _time_of_day(at_s + what["late_s"])
            begin_s, end_s = what.get("seconds", (0.0, np.inf))
            if begin_s <= at_s - first_s < end_s:
                _change_sentence(kind, field, what, at_s - first_s - begin_s)
                if number in lined_m:
                    field[9] = f"{lined_m[number]:.4f}"
                if "frozen" in what:
                    _freeze(field, frozen.setdefault(kind, field.copy()), what["frozen"])
        if kind == "GST" and what.get("without_gst"):
            continue
        lines.append(sentence(field))
    (folder / keys["recording"]["gnss"][0]).write_text("\r\n".join(lines) + "\r\n", encoding="ascii")


def _freeze(field: list[str], first: Sequence[str], what: str) -> None:
    """Put the height, the place or both of a sentence of that kind into another one."""
    if what in ("height", "all") and field[0].endswith("GGA"):
        field[9] = first[9]
    if what in ("place", "all") and field[0][-3:] in ("GGA", "RMC"):
        at = 2 if field[0].endswith("GGA") else 3
        field[at : at + 4] = first[at : at + 4]


def _time_of_day(at_s: float) -> str:
    ms = round(1e3 * at_s) % 86_400_000
    return f"{ms // 3_600_000:02}{ms // 60_000 % 60:02}{ms % 60_000 / 1e3:06.3f}"


def _change_sentence(kind: str, field: list[str], what: Mapping[str, Any], since_s: float) -> None:
    """Change the fields of a sentence in place."""
    if kind == "GGA":
        if "quality" in what:
            field[6] = str(what["quality"])
        if "separation_m" in what:
            field[11] = f"{what['separation_m']:.3f}"
        height_m = float(field[9]) + _moved_m(what, "up", since_s)
        if "up_step_m" in what:
            height_m = what["up_step_m"] * round(height_m / what["up_step_m"])
        field[9] = f"{height_m:.4f}"
    elif kind == "GST" and "sigma_m" in what:
        field[6:9] = [f"{what['sigma_m']:.3f}", f"{what['sigma_m']:.3f}", f"{2.0 * what['sigma_m']:.3f}"]
    if kind in ("GGA", "RMC"):
        at = 2 if kind == "GGA" else 3
        lat_deg = float(field[at][:2]) + float(field[at][2:]) / 60.0
        for i, axis, by in ((at, "north", 1.0), (at + 2, "east", np.cos(np.radians(lat_deg)))):
            move_m = _moved_m(what, axis, since_s)
            width = 2 if axis == "north" else 3
            minutes = float(field[i][width:]) + 60.0 * move_m / (DEGREE_M * by)
            field[i] = f"{field[i][:width]}{minutes:011.8f}"


def _moved_m(what: Mapping[str, Any], axis: str, since_s: float) -> float:
    """By how much an axis is moved: a constant, a creep, a wave of an amplitude and a period, steps of a size."""
    moved_m: float = what.get(f"{axis}_m", 0.0) + what.get(f"{axis}_mps", 0.0) * since_s
    wave_m, period_s = what.get(f"{axis}_wave", (0.0, 1.0))
    step_m, every_s = what.get(f"{axis}_stairs", (0.0, 1.0))
    return float(moved_m + wave_m * np.sin(2.0 * np.pi * since_s / period_s) + step_m * (since_s // every_s))


def _mounted(rpy_deg: Sequence[float]) -> Rotation:
    return Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True)


def _points(folder: Path, _: Mapping[str, Any], what: Mapping[str, Any]) -> None:
    """Change a file of surveyed points: heights of the first two exchanged, all or `only` one of them moved, axes."""
    path = folder / what["file"]
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    cells = [row.split(",") for row in rows]
    if what.get("swapped"):
        cells[0][3], cells[1][3] = cells[1][3], cells[0][3]
    for number, row in enumerate(cells):
        if what.get("only", number) == number:
            for column, axis in ((1, "east_m"), (2, "north_m"), (3, "up_m")):
                row[column] = f"{float(row[column]) + what.get(axis, 0.0):.3f}"
        if what.get("axes") == "exchanged":
            row[1], row[2] = row[2], row[1]
    path.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n", encoding="utf-8")


def _inertial(folder: Path, keys: Mapping[str, Any], what: Mapping[str, Any]) -> None:
    """Change the log of the IMU: its times, units, one axis for some seconds."""
    path = folder / keys["imu"]["files"][0]
    with path.open(encoding="utf-8") as file:
        head, *rows = file.read().splitlines()
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    first_s = values[0, 0]
    values[:, 0] += what.get("late_s", 0.0) + what.get("drift", 0.0) * (values[:, 0] - first_s)
    values[:, 1:4] *= what.get("rate_times", 1.0)
    values[:, 4:7] *= what.get("force_times", 1.0)
    if "order" in what:
        order = np.array(what["order"])
        values[:, 1:7] = np.hstack([values[:, 1 + order], values[:, 4 + order]])
    if "frozen" in what:
        begin_s, end_s = what["seconds"]
        since = values[:, 0] - first_s
        inside = (since >= begin_s) & (since < end_s)
        values[inside, 1 + what["frozen"]] = values[np.argmax(inside), 1 + what["frozen"]]
    if "lost" in what:
        begin_s, end_s = what["lost"]
        values = values[(values[:, 0] - first_s < begin_s) | (values[:, 0] - first_s >= end_s)]
    if "noise_dps" in what:
        values[:, 1:4] += np.random.default_rng(1).normal(0.0, what["noise_dps"], (len(values), 3))
    text = "\n".join(f"{row[0]:.6f}," + ",".join(f"{value:.7g}" for value in row[1:]) for row in values)
    path.write_text(f"{head}\n{text}\n", encoding="utf-8")


def _parcels(folder: Path, keys: Mapping[str, Any], what: Mapping[str, Any]) -> None:
    """Shift the parcels, mirror or turn them, or exchange their names."""
    path = folder / keys["parcels"]["file"]
    layer = json.loads(path.read_text(encoding="utf-8"))
    by = np.array([what.get("east_m", 0.0), what.get("north_m", 0.0)])
    every = np.array([point[:2] for one in layer["features"] for point in one["geometry"]["coordinates"][0]])
    middle = every.mean(axis=0)
    if what.get("ids") == "reversed":
        names = [one["properties"]["id"] for one in layer["features"]]
        for one, name in zip(layer["features"], names[::-1], strict=True):
            one["properties"]["id"] = name

    def moved(rings: list[list[list[float]]]) -> list[list[list[float]]]:
        lat_deg = rings[0][0][1]
        scale = np.array([DEGREE_M * np.cos(np.radians(lat_deg)), DEGREE_M])
        mirror = np.array(what.get("times", (1.0, 1.0)))
        turn = Rotation.from_euler("z", what.get("turned_deg", 0.0), degrees=True).as_matrix()[:2, :2]

        def place(point: list[float]) -> list[float]:
            off_m = turn @ (scale * mirror * (np.array(point[:2]) - middle))
            at = middle + (off_m + by) / scale
            east, north = at.tolist()
            return [north, east] if what.get("swapped") else [east, north]

        return [[[*place(point), *point[2:]] for point in ring] for ring in rings]

    for feature in layer["features"]:
        shape: dict[str, Any] = feature["geometry"]
        change: Callable[[Any], Any] = moved
        shape["coordinates"] = (
            change(shape["coordinates"])
            if shape["type"] == "Polygon"
            else [change(part) for part in shape["coordinates"]]
        )
    path.write_text(json.dumps(layer), encoding="utf-8")


def line(name: str, one: Judged) -> str:
    """The figures of a case, as a row."""
    if one.refused:
        return f"{name:26}refused: {one.refused}"
    pairs = [f"{one.errors[key]:.3f}/{one.sigmas[key]:.3f}" if key in one.errors else "" for key in QUANTITIES]
    mark = " " if one.well else "!"
    words = ", ".join(one.codes)
    return f"{name:26}" + "".join(f"{pair:>15}" for pair in pairs) + f"{one.worst:8.1f} {mark} {one.cause} ({words})"


if __name__ == "__main__":
    sys.exit(main())
