"""What furrowmap itself wrote and reads again, tables of surveyed points, scenarios, and orders to the worker."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import geopandas
import numpy as np
import pyproj
import shapely

from furrowmap.cli.worker_process import _arguments
from furrowmap.core.implement.near_scans import IMAGE_COLUMNS
from furrowmap.core.implement.saved import load_implement, save_implement
from furrowmap.core.implement.seen_implement import SideTemplate, SideViewGrid
from furrowmap.core.readers.surveyed_points import read_points
from furrowmap.core.simulator.scenario import load_scenario
from furrowmap.workflows.share.export import export
from tests.core.implement.test_tool_history import TILLER
from tests.exporters.farm.result_folders import write_result
from tests.fuzz.mutations import Files
from tests.fuzz.trials import Entry

MAP = pyproj.CRS("EPSG:6677")
SCENARIO = b"""seed = 5
title = "One pass"
posts = [[9.0, 4.0, 0.15, 2.0]]
[field]
size_e_m = 20.0
size_n_m = 16.0
[drive]
passes = 1
pass_m = [3.2]
speed_work_mps = 1.3
[lidar]
return_mode = "dual"
rpy_deg = [0.0, 40.0, 180.0]
"""
KML = "<kml><Document>" + "".join(
    f"<Placemark><name>P{k}</name><Point><coordinates>139.{k:07d},36.87,270.1</coordinates></Point></Placemark>"
    for k in range(8)
) + "</Document></kml>"  # fmt: skip
ELEVATION = "2026-May-01\n$FieldDir\nElevation\nLatitude,Longitude,Elevation,Quality,Easting,Northing\n" + "".join(
    f"36.87,139.{k:07d},270.1,4,1,234.5,6.7\n" for k in range(8)
)


def implements(folder: Path) -> list[Files]:
    still_m = np.ones((2, IMAGE_COLUMNS), np.float32)
    region = TILLER.region._replace(columns=np.ones(IMAGE_COLUMNS, bool), still_m=still_m)
    template = SideTemplate(SideViewGrid(-3.0, 0.0, 6, 9), np.ones((6, 9), np.float32))
    save_implement(folder / "implement.npz", replace(TILLER, region=region, template=template))
    return [{"implement.npz": (folder / "implement.npz").read_bytes()}]


def surveys(folder: Path) -> list[Files]:
    points = geopandas.GeoDataFrame(
        {"name": [f"P{k}" for k in range(8)], "sigma_h_m": 0.01},
        geometry=[shapely.Point(16_600.0 + k, 96_500.0, 270.0 + 0.1 * k) for k in range(8)],
        crs=MAP,
    )
    points.to_file(folder / "points.gpkg", driver="GPKG")
    rows = "".join(f"P{k},{16_600 + k}.25,96500.5,270.{k:02d},0.01\n" for k in range(8))
    degrees = "".join(f"P{k},139.{k:07d},36.87,270.{k:02d}\n" for k in range(8))
    return [
        {"points.csv": f"name,e_m,n_m,h_m,sigma_h_m\n{rows}".encode()},
        {"points.csv": f"name,lon_deg,lat_deg,h_m\n{degrees}".encode()},
        {"points.gpkg": (folder / "points.gpkg").read_bytes()},
        {"points.geojson": points.to_crs(4326).to_json().encode()},
        {"points.kml": KML.encode()},
        {"Elevation.txt": ELEVATION.encode()},
        {"points.csv": f"sep=;\nname;e_m;n_m;h_m\n{rows}".replace(",", ";").replace(".", ",").encode("utf-16")},
    ]


def results(folder: Path) -> list[Files]:
    made = write_result(folder / "result")
    return [{name: (made / name).read_bytes() for name in ("report.json", "field.gpkg", "session.toml")}]


def read_result(path: Path) -> None:
    """The tables of a result, as an export reads them."""
    export([path.parent], "csv", path.parent / "exported", layers=("trajectory", "passes"))


def orders(folder: Path) -> list[Files]:
    order = {"type": "start", "arguments": ["run", "session.toml", "-o", "out", "--overwrite"]}
    return [{"line": json.dumps(order, ensure_ascii=False).encode() + b"\n"}]


PRODUCTS = (
    Entry("implement", implements, load_implement, trials=50),
    Entry("survey", surveys, lambda path: read_points(path, MAP), trials=50),
    Entry("scenario", lambda folder: [{"scenario.toml": SCENARIO}], load_scenario, trials=50),
    Entry("result", results, read_result, trials=60),
    Entry("order", orders, lambda path: _arguments(path.read_bytes()), trials=50),
)
