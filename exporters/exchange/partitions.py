"""Points and trajectories as partitioned GeoParquet: files of limited size below a folder for each date.

GeoParquet 1.1: points as WKB with heights, a bounding box of each row with its covering, and the CRS as PROJJSON. The
folders are named `date=2026-05-01` as those of Hive, which DuckDB, pyarrow and pandas read as a column.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.json_text import json_text
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.provenance import Origin

RowColumns = Mapping[str, Any]

ROW_GROUP: Final = 65_536
"""Rows that a reader takes or leaves by their bounding boxes."""
_TIME_TYPE: Final = pa.timestamp("us", tz="UTC")
_TEXT_TYPE: Final = pa.dictionary(pa.int32(), pa.string())
_SIDES: Final = ("xmin", "ymin", "xmax", "ymax")
_GEOMETRY: Final = [
    pa.field("geometry", pa.binary(), nullable=False),
    pa.field("bbox", pa.struct([pa.field(side, pa.float32(), nullable=False) for side in _SIDES]), nullable=False),
]
_WKB: Final = np.dtype([("order", "u1"), ("kind", "<u4"), ("xyz", "<f8", 3)])
_POINT_Z: Final = 1001
_MORTON_BITS: Final = 16

POINT_SCHEMA: Final = pa.schema(
    [
        *_GEOMETRY,
        pa.field("session", _TEXT_TYPE),
        pa.field("time", _TIME_TYPE),
        pa.field("intensity", pa.uint16()),
        pa.field("return_number", pa.uint8()),
        pa.field("returns", pa.uint8()),
        pa.field("classification", pa.uint8()),
        pa.field("point_source_id", pa.uint16()),
        *(pa.field(colour, pa.uint16()) for colour in ("red", "green", "blue")),
    ]
)
POSE_SCHEMA: Final = pa.schema(
    [
        *_GEOMETRY,
        pa.field("session", _TEXT_TYPE),
        pa.field("time", _TIME_TYPE),
        pa.field("scan", pa.int64()),
        *(pa.field(name, pa.float64()) for name in ("roll_deg", "pitch_deg", "heading_deg", "speed_mps")),
        *(pa.field(f"sigma_{name}_m", pa.float64()) for name in "enh"),
        *(pa.field(f"sigma_{name}_deg", pa.float64()) for name in ("roll", "pitch", "heading")),
        *(pa.field(name, _TEXT_TYPE) for name in ("motion", "fix", "heading_from", "position_from", "height_from")),
        *(pa.field(name, _TEXT_TYPE) for name in ("level_from", "implement")),
        *(pa.field(name, pa.float64()) for name in ("implement_confidence", "tool_height_m")),
        pa.field("pass", pa.int32()),
    ]
)


@dataclass
class Partition:
    """The files of one session in the folder of a date; a new one begins when one is full."""

    folder: Path
    name: str
    schema: pa.Schema
    crs: CRS
    origin: Origin
    most_rows: int
    files: list[tuple[str, int]] = field(default_factory=list)
    """Name and number of rows of each file."""
    bounds_m: FloatArray = field(default_factory=lambda: np.array([np.inf, np.inf, -np.inf, -np.inf]))
    """Least x and y, greatest x and y of all rows."""

    def __enter__(self) -> Self:
        self._stack = ExitStack()
        self._writer: Any = None
        return self

    def __exit__(self, *error: Any) -> None:
        if error[0] is None:
            self._close()
        self._stack.__exit__(*error)

    def write(self, xyz_m: FloatArray, columns: RowColumns) -> None:
        """Write rows, those near each other together; columns (n,) that are missing are empty."""
        order = np.argsort(_morton(xyz_m), kind="stable")
        done = 0
        while done < len(order):
            if self._writer is None:
                self._open()
            room = self.most_rows - self.files[-1][1]
            rows = order[done : done + min(room, ROW_GROUP)]
            self._put(xyz_m[rows], {k: None if v is None else v[rows] for k, v in columns.items()})
            done += len(rows)
            if self.files[-1][1] >= self.most_rows:
                self._close()

    def _open(self) -> None:
        name = f"{self.name}-{len(self.files) + 1:04d}.parquet"
        self.folder.mkdir(parents=True, exist_ok=True)
        unfinished = self._stack.enter_context(atomic_output(self.folder / name))
        texts = [field.name for field in self.schema if pa.types.is_dictionary(field.type)]
        small = [field.name for field in self.schema if field.type in (pa.uint8(), pa.uint16())]
        self._writer = self._stack.enter_context(
            pq.ParquetWriter(
                unfinished, self.schema, compression="zstd", use_dictionary=[*texts, *small], store_schema=False,
                write_statistics=[field.name for field in self.schema if field.name != "geometry"]
                + [f"bbox.{side}" for side in _SIDES],
            )
        )  # fmt: skip
        self.files.append((name, 0))
        self._bounds = np.array([np.inf, np.inf, -np.inf, -np.inf])

    def _put(self, xyz_m: FloatArray, columns: RowColumns) -> None:
        records = np.empty(len(xyz_m), _WKB)
        records["order"] = 1
        records["kind"] = _POINT_Z
        records["xyz"] = xyz_m
        offsets = np.arange(len(xyz_m) + 1, dtype=np.int32) * np.int32(_WKB.itemsize)
        buffers = [None, pa.py_buffer(offsets), pa.py_buffer(records)]
        # Boxes of half the digits hold the points.
        near = xyz_m[:, :2].astype(np.float32)
        low = np.where(near > xyz_m[:, :2], np.nextafter(near, np.float32(-np.inf)), near)
        high = np.where(near < xyz_m[:, :2], np.nextafter(near, np.float32(np.inf)), near)
        boxes = pa.StructArray.from_arrays([*low.T, *high.T], fields=list(_GEOMETRY[1].type))
        arrays = [pa.Array.from_buffers(pa.binary(), len(xyz_m), buffers), boxes]
        arrays += [_column(columns.get(field.name), field.type, len(xyz_m)) for field in list(self.schema)[2:]]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self.schema), row_group_size=ROW_GROUP)
        name, rows = self.files[-1]
        self.files[-1] = name, rows + len(xyz_m)
        least = xyz_m[:, :2].min(axis=0)
        greatest = xyz_m[:, :2].max(axis=0)
        for bounds in (self._bounds, self.bounds_m):
            bounds[:2] = np.minimum(bounds[:2], least)
            bounds[2:] = np.maximum(bounds[2:], greatest)

    def _close(self) -> None:
        if self._writer is not None:
            about = {"geo": json.dumps(_geo(self.crs, self._bounds)), "furrowmap": json_text(self.origin.metadata)}
            self._writer.add_key_value_metadata(about)
            self._writer = None
            self._stack.close()


def table_columns(schema: pa.Schema) -> list[dict[str, str]]:
    """Names and types of the columns, as the STAC extension "table" has them."""
    return [{"name": field.name, "type": _type_name(field.type)} for field in schema]


def _type_name(kind: pa.DataType) -> str:
    if pa.types.is_dictionary(kind):
        return "string"
    return "struct" if pa.types.is_struct(kind) else "timestamp" if kind == _TIME_TYPE else str(kind)


def _geo(crs: CRS, bounds: FloatArray) -> dict[str, Any]:
    """The metadata of GeoParquet 1.1."""
    projjson = crs.to_json_dict()
    for member in _ensembles(projjson):
        member.pop("id", None)  # PROJJSON's schema does not know them
    column = {
        "encoding": "WKB",
        "geometry_types": ["Point Z"],
        "crs": projjson,
        "bbox": bounds.tolist(),
        "covering": {"bbox": {side: ["bbox", side] for side in _SIDES}},
    }
    creator = {"library": "furrowmap", "version": version("furrowmap")}
    return {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}, "creator": creator}


def _ensembles(value: Any) -> Iterator[dict[str, Any]]:
    """The members of all datum ensembles in PROJJSON."""
    if isinstance(value, dict):
        yield from value.get("datum_ensemble", {}).get("members", [])
        for inner in value.values():
            yield from _ensembles(inner)


def _column(values: Any, kind: pa.DataType, rows: int) -> pa.Array:
    if values is None:
        return pa.nulls(rows, kind)
    if kind == _TIME_TYPE:
        unknown = ~np.isfinite(values)
        microseconds = np.rint(np.where(unknown, 0.0, values) * 1e6).astype(np.int64)
        return pa.array(microseconds, pa.int64(), mask=unknown).cast(_TIME_TYPE)
    if kind == _TEXT_TYPE:
        filled = ["" if value is None or value != value else str(value) for value in values]
        texts, codes = np.unique(filled, return_inverse=True)
        empty = np.asarray(texts)[codes] == ""
        return pa.DictionaryArray.from_arrays(pa.array(codes.astype(np.int32), mask=empty), pa.array(texts.tolist()))
    return pa.array(values, kind, from_pandas=True)


def _morton(xyz_m: FloatArray) -> NDArray[np.uint64]:
    """The place of each point along a curve that keeps near ones together: bits of x and y in turn."""
    low = xyz_m[:, :2].min(axis=0)
    side = max(float((xyz_m[:, :2].max(axis=0) - low).max()), 1e-9)
    cells = ((xyz_m[:, :2] - low) * ((2**_MORTON_BITS - 1) / side)).astype(np.uint64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    code: NDArray[np.uint64] = cells[:, 0] | (cells[:, 1] << np.uint64(1))
    return code
