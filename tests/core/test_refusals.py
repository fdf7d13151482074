"""Inputs that must be refused where they are looked at first: what follows would fail later, or be wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import geopandas
import pytest
import shapely
from pyproj import CRS

from furrowmap.core.checking.surveyed_points import read_points
from furrowmap.core.readers.isoxml.log import TaskDataLog
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.bags import RosBag2
from furrowmap.core.readers.rosbag.storage import ByteStream, Damage
from furrowmap.core.values.errors import FurrowmapError
from tests.core.readers.isoxml.time_logs import Record, header, task_data


def refusal(code: str, words: str) -> Any:
    """An error with this code that says this."""
    return pytest.raises(FurrowmapError, match=words, check=lambda error: bool(error.code == code))


@pytest.mark.parametrize(
    "shapes", [[shapely.box(0, 0, 1, 1)], [shapely.Point(1, 2, 3), shapely.LineString([(0, 0), (1, 1)])]]
)
def test_survey__of_other_geometries_than_points(shapes: list[shapely.Geometry], tmp_path: Path) -> None:
    path = tmp_path / "points.gpkg"
    geopandas.GeoDataFrame({"name": ["a", "b"][: len(shapes)]}, geometry=shapes, crs="EPSG:6677").to_file(path)
    with refusal("points-unreadable", "other geometries than points"):
        read_points(path, CRS(6677))


def test_bag__of_which_only_the_metadata_are_there(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  relative_file_paths: [gone_0.db3]\n")
    with refusal("bag-folder-empty", r"no \.db3 or \.mcap file"):
        RosBag2([tmp_path], ReadOptions()).track()


@pytest.mark.parametrize("records", [[], [Record(36_000_000, 15_000, {"A": 0, "B": 0, "D": 0})]])
def test_task_data__whose_time_logs_have_no_positions(records: list[Record], tmp_path: Path) -> None:
    logs = {"TLG00001": (header([(141, "DET-1")]), b"".join(record.pack() for record in records))}
    body = '<TSK A="TSK1" B="run" G="4"><TLG A="TLG00001" C="1"/></TSK>'
    with refusal("no-positions", "no positions in the time logs"):
        TaskDataLog([task_data(tmp_path / "TASKDATA", body, logs)], ReadOptions()).track()


def test_bag__a_record_larger_than_any_message(tmp_path: Path) -> None:
    (tmp_path / "bag").write_bytes(bytes(100))
    with pytest.raises(Damage, match="a record of 536870913 bytes is declared at byte 0"):
        ByteStream(tmp_path / "bag").take((1 << 29) + 1)
