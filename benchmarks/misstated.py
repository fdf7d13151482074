"""Degenerate scenes and misstated sessions: stated sigmas against true errors, and what the run warns of.

misstated.toml beside this file holds the scenes, each a recording of half a minute or a minute, and what is misstated
on them. Scenes that are sample recordings are left out where these are not there. Of every case a run's trajectory
and mounting are set against the truth. A cloud's error is that of points on the ground round the vehicle, as the true
sensor sees them, placed by the run's poses and mounting; their stated sigma follows from that of the poses. The figure
of merit is the worst ratio of error to sigma that no warning goes with.
"""

from __future__ import annotations

import argparse
import dataclasses
import gzip
import json
import math
import os
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyogrio
import shapely
import tomli_w
from numpy.typing import NDArray
from pyproj import Transformer
from scipy.spatial.transform import Rotation
from sessions import CACHE, simulated
from trajectory_error import Poses, load_simulation, load_trajectory, rms

import furrowmap
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.process import keep_kernels

FloatArray = NDArray[np.float64]

TABLE = Path(__file__).with_suffix(".toml")
SAMPLES = Path(__file__).parents[2] / "shared" / "data"
"""Where the sample recordings are."""
LARGEST = 5.0
"""Of error over sigma without a warning."""
ROUND_M = (3.0, 6.0, 9.0)
"""Distances of the points on the ground that stand for a cloud."""
PART_M = 3.0
SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
QUANTITIES = ("place", "height", "heading", "cloud", "cloud_h", "edge", "share")
HEAD = ("height", "heading", "cloud", "its height", "edge", "share")
EDGE_FLOOR_M = 0.02
"""What an edge of worked ground is known to at best: the tool's line is smoothed, its soil is thrown."""
SHARE_FLOOR = 0.02
"""The same of the share of the field that is worked."""
HARMLESS = frozenset(
    {
        "points-without-pose",
        "gaps",
        "implement-no-ground",
        "machine-not-known",
        "implement-not-seen",
        "implement-out-of-view",
        "facing-assumed",
        "level-assumed",
        "lever-assumed",
        "slow-errors-assumed",
    }
)
"""Notices of what a short recording or its scene does not show, which a right session may have: among standing crop
scans see hardly any ground, and nothing but GNSS and the session determines the poses."""
GENERAL = ("contradiction",)
"""Begins of codes that name any cause."""
BLAMES = {
    "mounting-off": "mounting",
    "mounting-height": "mounting",
    "clock-offset": "clock",
    "gnss-frozen": "positions",
    "gnss-height": "positions",
    "gnss-steps": "positions",
    "boundary-apart": "boundary",
    "tool-apart": "tool",
    "elevations-off": "model",
    "model-differs": "model",
}
"""Begins of codes, and the cause that each of them names."""
CAUSES_ALIKE = {"upside-down": "mounting", "clock-or-lever-arm": "clock"}


@dataclass(frozen=True)
class Judged:
    """One case.

    Attributes:
        names: begins of the codes that name what is wrong; none where scene and session belong together.
        refused: code of the error with which the run ended; empty where there is a result.
        errors: RMS of the true errors, in m and degrees, by QUANTITIES.
        sigmas: RMS of the stated sigmas.
        codes: of the report's warnings.
        causes: that are right; none where the table does not say, so that any contradiction will do.
        blamed: causes that the verdict and the warnings name.
    """

    names: Sequence[str]
    refused: str
    errors: Mapping[str, float] = dataclasses.field(default_factory=dict)
    sigmas: Mapping[str, float] = dataclasses.field(default_factory=dict)
    codes: Sequence[str] = ()
    causes: Sequence[str] = ()
    blamed: Sequence[str] = ()

    @property
    def worst(self) -> float:
        """The largest ratio of an error to its sigma."""
        return max((self.errors[key] / self.sigmas[key] for key in self.errors), default=0.0)

    @property
    def named(self) -> bool:
        """Whether a warning names what is wrong; of a right session, whether any casts doubt on the result."""
        if self.causes:
            return bool(set(self.blamed) & set(self.causes))
        if not self.names:
            return bool(set(self.codes) - HARMLESS)
        return any(code.startswith((*self.names, *GENERAL)) for code in self.codes)

    @property
    def well(self) -> bool:
        """Whether a right session is as good as it says and not doubted, and the cause of a wrong one is named."""
        if self.causes and set(self.blamed) - set(self.causes):
            return False
        return (
            (self.named or self.worst <= LARGEST or bool(self.refused))
            if self.names or self.causes
            else not (self.named or self.refused or self.worst > LARGEST)
        )


def main() -> int:
    keep_kernels()
    options = options_of(__doc__).parse_args()
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    cases = [
        (f"{scene} {what}".strip(), scene, what)
        for scene in table["scenes"]
        for what in ("", *(w for w, keys in table["misstated"].items() if scene in keys["on"]))
    ]
    print(f"{'':30}{'error / sigma: place':>22}" + "".join(f"{key:>16}" for key in HEAD) + f"{'worst':>8}", flush=True)
    found = finished(options, Judged)
    for name, scene, what in cases:
        if options.only and not any(word in name for word in options.only):
            continue
        if name not in found:
            keys = table["scenes"][scene]
            recording = SAMPLES / keys["sample"] if "sample" in keys else simulated(f"misstated_{scene}", keys)
            if not recording.is_dir():
                continue
            found[name] = case(recording, table["misstated"].get(what, {}), table["faulty"].get(scene, ()))
            keep(found, options.json)
        print(line(name, found[name]), flush=True)
    return conclude(found, "warning")


def finished(options: argparse.Namespace, kind: type[Any]) -> dict[str, Any]:
    """The cases in the file of figures, by name, with --resume."""
    if not (options.resume and options.json and options.json.exists()):
        return {}
    return {name: msgspec.convert(row, kind) for name, row in msgspec.json.decode(options.json.read_bytes()).items()}


def keep(found: Mapping[str, Any], json_file: Path | None) -> None:
    """Write the figures of all cases judged to a file."""
    if json_file:
        rows = {name: {**dataclasses.asdict(one), "worst": one.worst} for name, one in found.items()}
        json_file.write_bytes(msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")


def conclude(found: Mapping[str, Any], said: str) -> int:
    """Print the worst case that nothing names and those that are not well; exit status.

    Args:
        found: cases judged, by name.
        said: what names a cause.
    """
    unnamed = {name: one.worst for name, one in found.items() if not one.named and not one.refused}
    worst = max(unnamed, key=lambda name: unnamed[name], default="")
    print(f"\nworst without a {said} that names the cause: {unnamed.get(worst, 0.0):.1f} ({worst})")
    failed = [name for name, one in found.items() if not one.well]
    print(f"{len(found)} cases, not well: {', '.join(failed) or 'none'}")
    return int(bool(failed))


def case(recording: Path, misstated: Mapping[str, Any], faulty: Sequence[str]) -> Judged:
    """Run a recording with what is misstated in its session or positions."""
    names = (*misstated.get("names", ()), *faulty)
    causes = misstated.get("causes", ())
    CACHE.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=CACHE) as folder:
        session = _session(recording, Path(folder), misstated)
        try:
            furrowmap.run(session, Path(folder) / "out")
        except FurrowmapError as error:
            return Judged(names, error.code, causes=causes)
        except MemoryError:
            return Judged(names, "memory", causes=causes)
        report = json.loads(Path(folder, "out", "report.json").read_text(encoding="utf-8"))
        field = Path(folder, "out", "field.gpkg")
        errors, sigmas = judged(recording, field, tomllib.loads(session.read_text()), report)
        if causes:
            worked = judged_work(recording, field, report, sigmas["place"])
            errors |= {name: error for name, (error, _) in worked.items()}
            sigmas |= {name: sigma for name, (_, sigma) in worked.items()}
    codes = sorted({warning["code"] for warning in report["warnings"]})
    causing = [warning["code"] for warning in report["warnings"] if warning["follows"] is None]
    return Judged(names, "", errors, sigmas, codes, causes, blamed(causing, report["verdict"].get("cause")))


def blamed(codes: Sequence[str], cause: str | None) -> list[str]:
    """The causes that warnings and a verdict name; a verdict of an unknown cause names none.

    Args:
        codes: of warnings that follow from no other.
        cause: of the verdict.
    """
    named = {BLAMES[begin] for begin in BLAMES for code in codes if code.startswith(begin)}
    if cause is not None and cause != "unknown":
        named.add(CAUSES_ALIKE.get(cause, cause))
    return sorted(named)


def judged_work(
    recording: Path, field: Path, report: Mapping[str, Any], sigma_m: float
) -> dict[str, tuple[float, float]]:
    """Errors and sigmas of the worked ground's edge (mean distance, m) and of its share of the field.

    Args:
        sigma_m: of the places of the vehicle.
    """
    figures = report["figures"]
    found = {}
    true = shapely.union_all(pyogrio.read_dataframe(recording / "truth" / "worked.gpkg", layer="coverage").geometry)
    if figures.get("worked_area_m2") and "coverage" in pyogrio.list_layers(field)[:, 0] and true.length:
        ours = shapely.union_all(pyogrio.read_dataframe(field, layer="coverage").geometry)
        edge_m = ours.symmetric_difference(true).area / true.length
        found["edge"] = (edge_m, math.hypot(sigma_m, EDGE_FLOOR_M))
        if (share := figures.get("worked_share")) is not None:
            fields = pyogrio.read_dataframe(recording / "boundary.geojson").to_crs(report["figures"]["crs"])
            outline = shapely.union_all(fields.geometry)
            true_share = true.intersection(outline).area / outline.area
            found["share"] = (abs(share - true_share), max(SHARE_FLOOR, true_share * sigma_m))
    return found


def judged(
    recording: Path, field: Path, session: Mapping[str, Any], report: Mapping[str, Any]
) -> tuple[dict[str, float], dict[str, float]]:
    """RMS of errors and of stated sigmas by QUANTITIES."""
    poses, stated = load_trajectory(field)
    simulation = load_simulation(recording)
    known = (poses.t_s >= simulation.truth.t_s[0]) & (poses.t_s <= simulation.truth.t_s[-1])
    poses, stated = Poses(poses.t_s[known], poses.xyz_m[known], poses.rph_deg[known]), stated[known]
    true = simulation.truth.at(poses.t_s)
    moving = np.interp(poses.t_s, simulation.truth.t_s, simulation.speed_mps) > 0.1
    place = poses.xyz_m - true.xyz_m
    heading = (poses.rph_deg[:, 2] - true.rph_deg[:, 2] + 180.0) % 360.0 - 180.0
    scenario = tomllib.loads((recording / "scenario.toml").read_text(encoding="utf-8"))["lidar"]
    matching = report["accuracy"]["matching"]
    used = matching["mounting_rpy_deg"] if matching else session["lidar"]["rpy_deg"]
    shift_s = report["clocks"]["lidar_minus_gnss_used_s"]
    truly = [scenario.get(f"true_{key}", scenario[key]) for key in ("xyz_m", "rpy_deg")]
    ours = seen_ground(session["lidar"]["xyz_m"], used, *truly)
    off = placed(ours, poses) - placed(seen_ground(*truly, *truly), simulation.truth.at(poses.t_s + shift_s))
    e, n, h, roll, pitch, yaw = np.where(np.isfinite(stated), stated, 1e3).T
    arm = rms(np.array(ROUND_M))
    errors = {
        "place": rms(np.hypot(*place[:, :2].T)),
        "height": rms(place[:, 2]),
        "heading": rms(heading[moving]),
        "cloud": rms(np.hypot(off[..., 0], off[..., 1]).ravel()),
        "cloud_h": rms(off[..., 2].ravel()),
    }
    sigmas = {
        "place": rms(np.hypot(e, n)),
        "height": rms(h),
        "heading": rms(yaw[moving]),
        "cloud": rms(np.sqrt(e**2 + n**2 + (arm * np.radians(yaw)) ** 2)),
        "cloud_h": rms(np.sqrt(h**2 + 0.5 * arm**2 * (np.radians(roll) ** 2 + np.radians(pitch) ** 2))),
    }
    return errors, sigmas


def seen_ground(
    xyz_m: Sequence[float], rpy_deg: Sequence[float], true_xyz_m: Sequence[float], true_rpy_deg: Sequence[float]
) -> FloatArray:
    """(m, 3) points that a sensor, truly mounted so, sees on level ground, where a mounting puts them."""
    angle, distance = np.meshgrid(np.radians(np.arange(0.0, 360.0, 45.0)), ROUND_M)
    ground = np.column_stack([(distance * f(angle)).ravel() for f in (np.cos, np.sin)] + [np.zeros(angle.size)])
    seen = _mounted(true_rpy_deg).inv().apply(ground - np.array(true_xyz_m))
    return _mounted(rpy_deg).apply(seen) + np.array(xyz_m)


def placed(points_m: FloatArray, poses: Poses) -> FloatArray:
    """(poses, m, 3) points in the vehicle frame on the map."""
    return np.stack([poses.antenna_m(point) for point in points_m], axis=1)


def _mounted(rpy_deg: Sequence[float]) -> Rotation:
    roll, pitch, yaw = rpy_deg
    return Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)


def _session(recording: Path, folder: Path, misstated: Mapping[str, Any]) -> Path:
    """The session of a case beside its recording: keys that end in `_by` are added to what it states."""
    keys = tomllib.loads((recording / "session.toml").read_text(encoding="utf-8"))
    for path, value in misstated.get("session", {}).items():
        table, key = path.split(".")
        was = keys[table].get(key.removesuffix("_by"), 0.0)
        if key.endswith("_by"):
            value = [a + b for a, b in zip(was, value, strict=True)] if isinstance(was, list) else was + value
        elif key.endswith("_times"):
            key, was = key.removesuffix("_times"), keys[table][key.removesuffix("_times")]
            value = [a * b for a, b in zip(was, value, strict=True)] if isinstance(was, list) else was * value
        keys[table][key.removesuffix("_by")] = value
    log = (recording / keys["recording"]["gnss"][0]).read_text(encoding="ascii")
    (folder / "gnss.nmea").write_text(_damaged(log, misstated.get("positions", {})), encoding="ascii", newline="")
    capture = recording / keys["recording"]["lidar"][0]
    if "product" in misstated:
        rewrite_product(capture, folder / capture.name, misstated["product"])
    for beside in recording.glob("recording.*"):
        if not (folder / beside.name).exists():
            _put_beside(beside, folder / beside.name)
    if "fan_times" in misstated:
        _widen_fan(folder / "recording.json", misstated["fan_times"])
    _write_boundary(recording / "boundary.geojson", folder, misstated.get("boundary", {}))
    truth = load_simulation(recording).truth.xyz_m
    if not misstated.get("whole"):
        part_of_ground(keys, folder, truth[len(truth) // 2, :2])
    session = folder / "session.toml"
    session.write_text(tomli_w.dumps(keys), encoding="utf-8")
    return session


def part_of_ground(keys: dict[str, Any], folder: Path, middle_m: FloatArray) -> None:
    """Let a session map a small square alone: poses do not depend on it, and cloud and surfaces take half of the time.

    Args:
        keys: of the session, which get a file of `folder`.
        middle_m: (2,) of the square, in the session's map.
    """
    to_wgs84 = Transformer.from_crs(keys["crs"]["map"], "EPSG:4326", always_xy=True)
    ring = [to_wgs84.transform(*(middle_m + np.array(corner) * PART_M)) for corner in SQUARE]
    shape = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {}, "geometry": shape}
    layer = {"type": "FeatureCollection", "features": [feature]}
    (folder / "part.geojson").write_text(json.dumps(layer), encoding="utf-8")
    keys.setdefault("field", {})["within"] = "part.geojson"


def _put_beside(file: Path, to: Path) -> None:
    """Link a file, or copy it to another file system."""
    try:
        os.link(file, to)
    except OSError:
        shutil.copyfile(file, to)


def _widen_fan(metadata: Path, times: float) -> None:
    """Multiply the elevations in an Ouster's metadata, as those of another line of the maker have them."""
    said = json.loads(metadata.read_text(encoding="utf-8"))
    said["beam_intrinsics"]["beam_altitude_angles"] = [
        round(times * deg, 3) for deg in said["beam_intrinsics"]["beam_altitude_angles"]
    ]
    metadata.unlink()
    metadata.write_text(json.dumps(said), encoding="utf-8")


def rewrite_product(capture: Path, to: Path, product: int) -> None:
    """A Velodyne's capture whose data packets state another product."""
    opened = gzip.open if capture.suffix == ".gz" else open
    with opened(capture, "rb") as file:
        data = bytearray(file.read())
    at = 24
    packet = 42 + 1206
    while at < len(data):
        length = int.from_bytes(data[at + 8 : at + 12], "little")
        at += 16 + length
        if length == packet:
            data[at - 1] = product
    with opened(to, "wb") as file:
        file.write(data)


def _write_boundary(boundary: Path, folder: Path, what: Mapping[str, Any]) -> None:
    """The field's boundary, moved by `east_m` and `north_m`, mirrored about its south, or turned about a corner."""
    layer = json.loads(boundary.read_text(encoding="utf-8"))
    for feature in layer["features"]:
        rings = feature["geometry"]["coordinates"]
        south = min(lat for _, lat, *_ in rings[0])
        west = min(lon for lon, *_ in rings[0])
        for ring in rings:
            for place in ring:
                east_deg = what.get("east_m", 0.0) / 111_320.0 / math.cos(math.radians(south))
                place[0] += east_deg
                place[1] += what.get("north_m", 0.0) / 111_132.0
                if what.get("mirrored"):
                    place[1] = 2.0 * south - place[1]
                if what.get("turned"):
                    wide = math.cos(math.radians(south))
                    place[:2] = west - (place[1] - south) / wide, south + (place[0] - west) * wide
    (folder / boundary.name).write_text(json.dumps(layer), encoding="utf-8")


def _damaged(log: str, what: Mapping[str, Any]) -> str:
    """NMEA sentences that state other places in some seconds after the first.

    Latitudes jump (`north_m`) or creep (`north_per_min_m`), heights step (`up_m`), creep (`up_per_min_m`), swing
    (`swing_m` in `swing_s`), are rounded (`round_m`) or lie on a line from one to the next after `line_s`; `frozen` are
    "heights" or "places" as at the begin; places are zero where nothing is said.
    """
    if not what:
        return log
    begin_s, end_s = what.get("seconds", (0.0, math.inf))
    lines, first_s = log.splitlines(), math.nan
    kept: dict[str, list[str]] = {}
    lined_m = on_lines(lines, what["line_s"]) if "line_s" in what else {}
    heights = bool(set(what) & {"up_m", "up_per_min_m", "swing_m", "round_m"}) or what.get("frozen") == "heights"
    for i, text in enumerate(lines):
        field = text.partition("*")[0].lstrip("$").split(",")
        kind = field[0][2:]
        if kind not in ("GGA", "RMC"):
            continue
        t_s = 3600.0 * int(field[1][:2]) + 60.0 * int(field[1][2:4]) + float(field[1][4:])
        first_s = t_s if math.isnan(first_s) else first_s
        if not begin_s <= t_s - first_s < end_s:
            continue
        at = 2 if kind == "GGA" else 3
        since_s = t_s - first_s - begin_s
        north_m = what.get("north_m", 0.0) + what.get("north_per_min_m", 0.0) * since_s / 60.0
        if north_m:
            minutes = float(field[at][2:]) + north_m / 1852.0
            field[at] = f"{field[at][:2]}{minutes:011.8f}"
        elif what.get("frozen") == "places":
            field[at : at + 4] = kept.setdefault(kind, field[at : at + 4])
        elif "line_s" in what:
            if i in lined_m:
                field[9] = f"{lined_m[i]:.4f}"
        elif not heights:
            field[at], field[at + 2] = "0000.00000000", "00000.00000000"
        if heights and kind == "GGA":
            field[9] = _height(field[9], since_s, what, kept)
        lines[i] = sentence(field)
    return "\r\n".join(lines) + "\r\n"


def on_lines(lines: Sequence[str], every_s: float) -> dict[int, float]:
    """Altitudes by the number of the line, on straight lines in time between those of every so many seconds."""
    fields = {i: text.split(",") for i, text in enumerate(lines) if text[3:6] == "GGA"}
    clock = [field[1] for field in fields.values()]
    at_s = np.array([3600.0 * int(t[:2]) + 60.0 * int(t[2:4]) + float(t[4:]) for t in clock])
    height_m = np.array([float(field[9]) for field in fields.values()])
    known = np.unique(np.searchsorted(at_s, np.arange(at_s[0], at_s[-1], every_s)))
    return dict(zip(fields, np.interp(at_s, at_s[known], height_m[known]).tolist(), strict=True))


def _height(text: str, since_s: float, what: Mapping[str, Any], kept: dict[str, list[str]]) -> str:
    """The altitude that a damaged log states so many seconds after its damage begins."""
    if what.get("frozen") == "heights":
        return kept.setdefault("height", [text])[0]
    height_m = float(text) + what.get("up_m", 0.0) + what.get("up_per_min_m", 0.0) * since_s / 60.0
    if "swing_m" in what:
        height_m += what["swing_m"] * math.sin(2.0 * math.pi * since_s / what["swing_s"])
    if "round_m" in what:
        height_m = round(height_m / what["round_m"]) * what["round_m"]
    return f"{height_m:.4f}"


def sentence(field: Sequence[str]) -> str:
    """NMEA 0183 of fields."""
    body = ",".join(field)
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}"


def line(name: str, one: Judged) -> str:
    """The figures of a case, as a row."""
    if one.refused:
        return f"{name:30}refused: {one.refused}"
    digits = {"heading": "{:.2f}/{:.2f}"}
    pairs = [
        digits.get(key, "{:.3f}/{:.3f}").format(one.errors[key], one.sigmas[key]) if key in one.errors else ""
        for key in QUANTITIES
    ]
    mark = " " if one.well else "!"
    words = ", ".join(code for code in one.codes if code not in HARMLESS)
    names = f" [{', '.join(one.blamed)}]" if one.blamed else ""
    return f"{name:30}{'':6}" + "".join(f"{pair:>16}" for pair in pairs) + f"{one.worst:8.1f} {mark} {words}{names}"


def options_of(text: str | None) -> argparse.ArgumentParser:
    """The options of a table of cases, described by a text."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="cases whose name contains a word")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE as well, after each case")
    parser.add_argument("--resume", action="store_true", help="do not run the cases again that are in FILE")
    return parser


if __name__ == "__main__":
    sys.exit(main())
