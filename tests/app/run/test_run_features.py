"""`[features]` in a session: layers of the result and of the farm map."""

from __future__ import annotations

import shutil
from pathlib import Path

import geopandas as gpd
import numpy as np
import pyogrio

import furrowmap

SCANS_S = 1_453_364_282.341
"""The capture's first return by its GPS time."""
SESSION = """furrowmap = 1
[recording]
lidar = ["recording.pcap"]
[crs]
map = "EPSG:6677"
[trajectory]
files = ["drive.csv"]
[lidar]
xyz_m = [0.0, 0.0, 2.1]
[features]
ground = "smrf"
voxel_m = 0.1
"""


def test_features_of_a_run__are_layers_of_its_result_and_of_a_farm_map(shared_data: Path, tmp_path: Path) -> None:
    shutil.copy(shared_data / "velodyne" / "vlp16_single_gps.pcap", tmp_path / "recording.pcap")
    rows = "".join(f"{SCANS_S - 1 + i * 0.1:.3f},{16_650 + i * 0.1:.3f},96560,271,0,0,90\n" for i in range(31))
    (tmp_path / "drive.csv").write_text("time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n" + rows)
    (tmp_path / "session.toml").write_text(SESSION)
    result = furrowmap.run(tmp_path / "session.toml", tmp_path / "result")
    figures = result.report["features"]["figures"]
    assert result.report["features"]["parameters"] == {"ground": "smrf", "voxel_m": 0.1}
    assert result.report["timings"]["features"] > 0.0
    path = result.path / "field.gpkg"
    layers = {name: gpd.read_file(path, layer=name) for name in ("planes", "lines", "plants")}
    assert [len(layers["planes"]), len(layers["plants"])] == [
        figures["planes_horizontal"] + figures["planes_vertical"],
        figures["plants"],
    ]
    assert np.count_nonzero(layers["lines"].kind == "pole") == figures["poles"]
    assert sum(figures.values()) > 0
    assert {"planes", "lines", "plants"} <= {*pyogrio.read_dataframe(path, layer="layer_styles")["f_table_name"]}
    assert "<h2>Features</h2>" in (result.path / "report.html").read_text("utf-8")
    left = [each.name for each in tmp_path.rglob("*") if "furrowmap-" in each.name]
    assert left == []
    furrowmap.add_to_farm_map(tmp_path / "farm.gpkg", [result.path])
    of_farm = gpd.read_file(tmp_path / "farm.gpkg", layer="planes")
    assert len(of_farm) == len(layers["planes"])
    assert {"session", "date", "kind"} <= {*of_farm.columns}
