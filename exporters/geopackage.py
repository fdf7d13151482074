"""`field.gpkg`: what a run knows about the field as vector layers, each with its style stored inside."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyogrio.raw
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan_poses import ScanPoses
from furrowmap.core.values.trajectory import SIGMAS, Motion
from furrowmap.exporters.atomic import atomic_output

ObjectArray = NDArray[np.object_]

TRAJECTORY: Final = "trajectory"
_UTC_OFFSET: Final = 100
"""How OGR spells UTC among its time zones (0 unknown, 1 local, 100 UTC)."""


def write_field(path: Path, poses: ScanPoses, crs: CRS) -> None:
    """Write `field.gpkg` with its layers and their styles.

    Args:
        path: of the file; an old one is replaced when the new one is whole.
        poses: the rows of the layer `trajectory`.
        crs: of their coordinates.

    Raises:
        OSError: if the file cannot be written there.
    """
    with atomic_output(path) as unfinished:
        _write_trajectory(unfinished, poses, crs)
        _write_styles(unfinished, {TRAJECTORY: "geom"})
        _check(unfinished, {TRAJECTORY: len(poses)})


def _write_trajectory(path: Path, poses: ScanPoses, crs: CRS) -> None:
    n = len(poses)
    roll_deg, pitch_deg, heading_deg = poses.attitude_deg()
    columns: dict[str, NDArray[Any]] = {
        "scan": poses.scan,
        "time": np.round(poses.t_s * 1000.0).astype(np.int64).view("datetime64[ms]"),
        "t_s": poses.t_s,
        "roll_deg": roll_deg,
        "pitch_deg": pitch_deg,
        "heading_deg": heading_deg,
        "speed_mps": poses.speed_mps,
        "motion": _labels(poses.motion, {int(motion): motion.label for motion in Motion}),
        "fix": _labels(poses.fix, {int(fix): fix.label for fix in Fix}),
        **{f"sigma_{name}": poses.sigma[:, i] for i, name in enumerate(SIGMAS)},
        "heading_from": poses.heading_from.astype(object),
    }
    pyogrio.raw.write(
        path,
        shapely.to_wkb(shapely.points(poses.xyz_m), output_dimension=3),
        list(columns.values()),
        list(columns),
        layer=TRAJECTORY,
        driver="GPKG",
        geometry_type="2.5D Point",
        crs=crs.to_wkt(),
        gdal_tz_offsets={"time": np.full(n, _UTC_OFFSET, np.int8)},
        layer_options={
            "GEOMETRY_NAME": "geom",
            "DESCRIPTION": "The vehicle frame's origin (on the ground below the rear axle) in the middle of each scan",
        },
    )


def _labels(codes: NDArray[np.int8], words: Mapping[int, str]) -> ObjectArray:
    """The word of each code; None (NULL in the file) where it has none."""
    known, index = np.unique(codes, return_inverse=True)
    return np.array([words.get(int(code)) for code in known], dtype=object)[index]


def _write_styles(path: Path, layers: Mapping[str, str]) -> None:
    """Store each layer's style in the table where QGIS looks for it, as the one to open the layer with.

    Args:
        path: of the GeoPackage.
        layers: name of each layer and of its geometry's column.
    """
    n = len(layers)
    empty = np.full(n, "", dtype=object)
    styles = [files("furrowmap.exporters").joinpath("styles", f"{name}.qml").read_text("utf-8") for name in layers]
    names = np.array(list(layers), dtype=object)
    columns: dict[str, NDArray[Any]] = {
        "f_table_catalog": empty,
        "f_table_schema": empty,
        "f_table_name": names,
        "f_geometry_column": np.array(list(layers.values()), dtype=object),
        "styleName": names,
        "styleQML": np.array(styles, dtype=object),
        "styleSLD": empty,
        "useAsDefault": np.ones(n, bool),
        "description": np.full(n, "furrowmap's own", dtype=object),
        "owner": empty,
        "ui": np.full(n, None, dtype=object),
        "update_time": np.full(n, np.datetime64("now", "ms")),
    }
    pyogrio.raw.write(
        path,
        None,
        list(columns.values()),
        list(columns),
        layer="layer_styles",
        driver="GPKG",
        layer_options={"FID": "id"},
        gdal_tz_offsets={"update_time": np.full(n, _UTC_OFFSET, np.int8)},
    )


def _check(path: Path, counts: Mapping[str, int]) -> None:
    """See that the file is sound and holds the features it was given.

    Raises:
        OSError: if it does not: the disk kept something else than what was written.
    """
    with closing(sqlite3.connect(path)) as database:
        verdict = database.execute("PRAGMA integrity_check").fetchone()[0]
        found = {name: database.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0] for name in counts}  # noqa: S608
        journal = database.execute("PRAGMA journal_mode").fetchone()[0]
    if verdict != "ok" or found != counts or journal != "delete":
        raise OSError(f"{path} is not as it was written ({verdict}; {found} features, journal {journal})")
