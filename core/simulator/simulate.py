"""From a scenario to a folder with a recording and its truth."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.simulator.drive import drive_front, drive_path, plan_path
from furrowmap.core.simulator.machine_motion import stand_on
from furrowmap.core.simulator.noise import random_for
from furrowmap.core.simulator.recording import World, record, recording_file, second_file
from furrowmap.core.simulator.scenario import Scenario, ScenarioImplement, as_toml
from furrowmap.core.simulator.simulate_flight import Written, moving, write_flight, write_sensors, write_session
from furrowmap.core.simulator.simulated_receiver import receivers, report, sentences
from furrowmap.core.simulator.site import SimulatedSite, find_site, lay_out
from furrowmap.core.simulator.soil_over_time import find_sweeps, make_ground
from furrowmap.core.simulator.truth import (
    TRUTH_HZ,
    coarse_surface,
    drive_figures,
    ground_figures,
    transitions,
    write_implement,
    write_surface,
    write_trajectory,
    write_worked,
)


@dataclass(frozen=True)
class Simulated:
    """The files of a simulation: recording, session.toml for ``furrowmap run``, ``truth/``, and its scenario."""

    folder: Path
    session: Path
    recording: Path
    scenario: Scenario
    figures: dict[str, Any]


def simulate(scenario: Scenario, folder: Path, progress: Progress = silent) -> Simulated:
    """Write into `folder` what recorders would have written on the drive or flight of `scenario`, and the truth.

    Raises:
        InputError: the scenario describes nothing that is possible.
        OSError: `folder` is no folder that can be written.
        Cancelled: `progress` asked to stop.
    """
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    progress("ground", 0.0)
    if scenario.flight is not None:
        written = write_flight(folder, scenario, scenario.flight, progress)
    else:
        written = _write_drive(folder, scenario, progress)
    (folder / "scenario.toml").write_text(as_toml(written.scenario), encoding="utf-8")
    (folder / "truth" / "figures.json").write_text(json.dumps(written.figures, indent=1) + "\n", encoding="utf-8")
    progress("truth", 1.0)
    return Simulated(folder, folder / "session.toml", folder / written.recording, written.scenario, written.figures)


def _write_drive(folder: Path, scenario: Scenario, progress: Progress) -> Written:
    """The recording of a tractor, and its truth."""
    path = plan_path(scenario.drive, random_for(scenario.seed, "driver"))
    scenario = lay_out(scenario, path)
    site = find_site(scenario)
    track = drive_path(path, scenario.drive, scenario.implement, random_for(scenario.seed, "tool"))
    sweeps = find_sweeps(track, scenario.implement.xy_m)
    front = scenario.front
    ahead = drive_front(path, scenario.drive, front, random_for(scenario.seed, "front")) if front is not None else None
    ground = make_ground(scenario, sweeps)
    motion = stand_on(ground, track, scenario.tractor, scenario.sway, random_for(scenario.seed, "sway"))
    world = World(scenario, site, ground, motion, mount=moving(scenario), front=ahead)
    capture = recording_file(scenario.lidar)
    truth = folder / "truth"
    end_s = track.duration_s + scenario.lidar.stop_s
    write_session(folder, scenario, capture, *_implements(scenario), ("[field]", {"boundary": "boundary.geojson"}))
    (folder / "boundary.geojson").write_text(_boundary(scenario, site), encoding="utf-8")
    gnss = receivers(scenario, site, motion, end_s)
    for name, (fixes, station) in gnss.items():
        (folder / name).write_text(sentences(fixes, site, station), encoding="ascii", newline="")
    write_sensors(folder, world, end_s)
    lidar, seen_after = record(folder / capture, world, track.duration_s, progress)
    if scenario.second_lidar is not None:
        second = replace(world, scenario=scenario.by_second_lidar)
        beside, seen = record(folder / second_file(scenario.second_lidar), second, track.duration_s, progress)
        lidar |= {"second_lidar": beside}
        seen_after = np.maximum(seen_after, seen)
    progress("truth", 0.0)
    surface = coarse_surface(scenario, ground)
    write_trajectory(truth / "trajectory.csv", motion, site, TRUTH_HZ, place_digits=5)
    write_implement(truth / "implement.csv", track, site)
    write_surface(truth / "surface.npz", surface, seen_after, site)
    worked = write_worked(truth / "worked.gpkg", sweeps, scenario.implement.width_m, site)
    if front is not None and ahead is not None:
        write_implement(truth / "implement_front.csv", ahead, site)
        swept = write_worked(truth / "worked_front.gpkg", find_sweeps(ahead, front.xy_m), front.width_m, site)
        worked |= {"front": swept | {"transitions": transitions(ahead)}}
    u0, u1, v0, v1 = scenario.field.boundary_uv_m
    figures = {
        "name": scenario.name,
        "seed": scenario.seed,
        "t0_unix_s": site.t0_s,
        "duration_s": round(track.duration_s, 3),
        **worked,
        "field_area_m2": round((u1 - u0) * (v1 - v0), 2),
        **ground_figures(surface, seen_after),
        **drive_figures(track, motion),
        **lidar,
        "gnss": {name: report(fixes) for name, (fixes, _) in gnss.items()},
    }
    return Written(scenario, capture, figures)


def _implements(scenario: Scenario) -> list[tuple[str, dict[str, Any]]]:
    """The tables of the implements."""
    rear = scenario.implement
    front = scenario.front
    if front is None:
        return [("[implement]", _implement_keys(rear))]
    named = ((front.rear_name, rear), (front.name, front))
    return [("[[implement]]", {"name": name} | _implement_keys(implement)) for name, implement in named]


def _implement_keys(implement: ScenarioImplement) -> dict[str, Any]:
    return {
        "kind": implement.kind,
        "width_m": implement.width_m,
        "xy_m": implement.xy_m,
        "working_depth_m": implement.working_depth_m,
    }


def _boundary(scenario: Scenario, site: SimulatedSite) -> str:
    """The parcel in GeoJSON (RFC 7946: longitude first, the ring counter-clockwise and closed)."""
    u0, u1, v0, v1 = scenario.field.boundary_uv_m
    lane = np.radians(90.0 - scenario.drive.lane_heading_deg)
    u = np.array([u0, u1, u1, u0, u0])
    v = np.array([v0, v0, v1, v1, v0])
    x0, y0 = scenario.drive.start_xy_m
    lon, lat = site.geographic(x0 + u * np.cos(lane) - v * np.sin(lane), y0 + u * np.sin(lane) + v * np.cos(lane))
    ring = [[round(float(a), 9), round(float(b), 9)] for a, b in zip(lon, lat, strict=True)]
    feature = {
        "type": "Feature",
        "properties": {"name": scenario.title},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}, ensure_ascii=False) + "\n"
