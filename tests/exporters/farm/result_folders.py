"""Folders as `furrowmap run` leaves them, of the worked field in closed form."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path

import shapely
from pyproj import CRS

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.trajectory import ScanPoses
from furrowmap.exporters.vectors.geopackage import write_field
from tests.exporters.vectors.worked_field import worked_field

JAPAN = CRS.from_epsg(6677)
T0_S = 1_781_190_000.0
"""2026-06-11T15:00:00Z, midnight in Japan."""


@cache
def field() -> tuple[ScanPoses, FieldWork]:
    return worked_field()


def write_result(
    folder: Path,
    *,
    name: str = "North field",
    recording: str = "a" * 64,
    day: int = 0,
    crs: CRS = JAPAN,
    heights: str = "ellipsoidal",
    worked: bool = True,
    area_m2: float = 75.5,
) -> Path:
    """A result of a session on some day after the first, in the folder, which is returned."""
    poses, work = field()
    poses = replace(poses, t_s=poses.t_s - poses.t_s[0] + T0_S + 86_400.0 * day)
    folder.mkdir(parents=True, exist_ok=True)
    write_field(folder / "field.gpkg", poses, crs, work if worked else FieldWork())
    report = {
        "furrowmap": "0.1.0",
        "schema": 1,
        "session": {
            "name": name,
            "crs": {"map": crs.to_string(), "heights": heights, "coordinates": "as-recorded"},
            "lidar": {"xyz_m": [0.0, 0.0, 2.4]},
            "implement": {"kind": "rotary tiller", "width_m": 1.7},
        },
        "inputs": [{"name": "recording.pcap", "bytes": 1, "sha256": recording}],
        "figures": {
            "start": iso_utc(float(poses.t_s[0])),
            "end": iso_utc(float(poses.t_s[-1])),
            "points": 1000,
            "bounds_m": [poses.xyz_m.min(axis=0).tolist(), poses.xyz_m.max(axis=0).tolist()],
            "worked_area_m2": area_m2,
            "passes": 3,
            "duration_s": 79.8,
        },
        "coordinates": {"frame": crs.geodetic_crs.name, "epoch": None},
        "products": ["field.gpkg", "report.json", "session.toml"],
        "warnings": [],
    }
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    (folder / "session.toml").write_text(f'furrowmap = 1\nname = "{name}"\n', encoding="utf-8")
    return folder


def coverage() -> shapely.Geometry:
    """The ground worked, as it was put in."""
    ground = field()[1].ground
    assert ground is not None
    return ground.coverage


def rename_layer(path: Path, old: str, new: str) -> None:
    """Give a layer of a GeoPackage a name that GDAL would not write."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("PRAGMA synchronous = OFF")
        quoted = new.replace('"', '""')
        triggers = database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for (trigger,) in triggers:
            database.execute(f'DROP TRIGGER "{trigger}"')
        database.execute(f'ALTER TABLE "{old}" RENAME TO "{quoted}"')
        for table in ("gpkg_contents", "gpkg_geometry_columns", "gpkg_ogr_contents"):
            database.execute(f"UPDATE {table} SET table_name = ? WHERE table_name = ?", (new, old))
        database.execute("UPDATE gpkg_contents SET identifier = ? WHERE table_name = ?", (new, new))
