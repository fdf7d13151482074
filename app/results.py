"""The result of a run, and the points of clouds, opened for notebooks and other software."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.cloud import BATCH_POINTS, Box, CloudFile, open_cloud
from furrowmap.core.readers.las.point_records import CloudBatch
from furrowmap.core.runtime.errors import InputError, MissingExtraError
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.exporters.files import result_folder
from furrowmap.exporters.files.result_folder import CHANGE, CLOUD, DSM, DSM_BEFORE, ResultFolder
from furrowmap.exporters.files.whole_layers import geodataframe

if TYPE_CHECKING:
    import geopandas
    import pyproj
    from rasterio import Affine


_LAS_ATTRIBUTES: Final = ("intensity", "return_number", "returns", "classification", "point_source_id")
POINT: Final = np.dtype(
    [(name, "f8") for name in ("x", "y", "z", "t_s")]
    + list(zip(_LAS_ATTRIBUTES, ("u2", "u1", "u1", "u1", "u2"), strict=True))
    + [(name, "u2") for name in ("red", "green", "blue")]
)
"""A point: easting, northing and height in the file's CRS, UTC in seconds (nan where unknown), LAS attributes."""


@dataclass(frozen=True)
class Points:
    """Points of a cloud, read on demand.

    ``np.asarray(points)`` or `read` gives all of them, `chunks` a part at a time.

    Attributes:
        file: the opened file.
        bounds: minimum x, minimum y, maximum x, maximum y of the points wanted; None for all.
        classes: classes of the points wanted; None for all.
    """

    file: CloudFile
    bounds: Box | None = None
    classes: frozenset[int] | None = None

    def __repr__(self) -> str:
        return f"Points({str(self.file.path)!r}, bounds={self.bounds}, classes={self.classes and sorted(self.classes)})"

    @cached_property
    def crs(self) -> pyproj.CRS | None:
        """The CRS; None where the file states none."""
        return self.file.crs

    def chunks(self, points: int = BATCH_POINTS) -> Iterator[NDArray[np.void]]:
        """Structured arrays (n,) of dtype `POINT`, about `points` at a time; raises InputError at damaged points."""
        for batch in self.file.batches(self.bounds, batch_points=points):
            kept = ~batch.withheld
            if self.classes is not None:
                kept &= np.isin(batch.classification, list(self.classes))
            if kept.any():
                yield _to_structured(batch.where(kept))

    def read(self) -> NDArray[np.void]:
        """All points, a structured array (n,) of dtype `POINT`; 45 bytes a point."""
        return np.concatenate([np.empty(0, POINT), *self.chunks()])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """All points, for numpy."""
        del copy  # is always a new array
        return self.read() if dtype is None else self.read().astype(dtype)

    def to_open3d(self) -> Any:
        """An `open3d.geometry.PointCloud` of all points, with any colours; raises MissingExtraError without Open3D."""
        try:
            import open3d
        except ImportError as error:
            raise MissingExtraError(
                "open3d",
                "open3d",
                Text("Points are handed to it."),
                otherwise=Text(
                    "where the error names a library of the system, install that (Debian: libusb-1.0-0, libgl1, "
                    "libgomp1)"
                ),
                error=error,
            ) from None
        points = self.read()
        cloud = open3d.geometry.PointCloud()
        cloud.points = open3d.utility.Vector3dVector(np.column_stack([points[axis] for axis in "xyz"]))
        colours = np.column_stack([points[name] for name in ("red", "green", "blue")])
        if colours.any():
            cloud.colors = open3d.utility.Vector3dVector(colours / np.iinfo(np.uint16).max)
        return cloud


def open_points(path: str | Path, bounds: Box | None = None, classes: Iterable[int] | None = None) -> Points:
    """Open the points of a LAS, LAZ or COPC file.

    Args:
        bounds: minimum x, minimum y, maximum x, maximum y of the points wanted, in the file's CRS; of a COPC file only
            the nodes within are read.
        classes: classes of the points wanted, such as (2,) for ground; None for all.

    Raises:
        InputError: if the file is missing, damaged or of another format.
    """
    return Points(open_cloud(Path(path)), bounds, frozenset(classes) if classes is not None else None)


def _to_structured(batch: CloudBatch) -> NDArray[np.void]:
    out = np.zeros(len(batch), POINT)
    out["x"], out["y"], out["z"] = batch.xyz_m.T
    out["t_s"] = batch.t_s if batch.t_s is not None else np.nan
    for name in _LAS_ATTRIBUTES:
        out[name] = getattr(batch, name)
    if batch.rgb is not None:
        out["red"], out["green"], out["blue"] = batch.rgb.T
    return out


@dataclass(frozen=True)
class Raster:
    """The first band (rows, columns) float32 of a GeoTIFF, north up, nan without a value, where xarray is missing."""

    array: NDArray[np.float32]
    transform: Affine
    crs: pyproj.CRS


class Layers(Mapping[str, "geopandas.GeoDataFrame"]):
    """The layers of `field.gpkg` by name, each read on demand."""

    def __init__(self, folder: ResultFolder) -> None:
        self._folder = folder

    def __getitem__(self, name: str) -> geopandas.GeoDataFrame:
        if name not in self._folder.layer_names:
            raise KeyError(name)
        return geodataframe(self._folder.layer(name))

    def __iter__(self) -> Iterator[str]:
        return iter(self._folder.layer_names)

    def __len__(self) -> int:
        return len(self._folder.layer_names)

    def __repr__(self) -> str:
        return f"Layers({', '.join(self)})"


class ResultLayer:
    """An attribute of a result that reads the layer of its name."""

    def __set_name__(self, owner: type[Result], name: str) -> None:
        self._name = name

    def __get__(self, result: Result | None, owner: type[Result]) -> geopandas.GeoDataFrame:
        if result is None:
            return self
        return result.layer(self._name)


class Result:
    """The result of a run.

    The attributes named after layers are GeoDataFrames in the session's CRS; their fields are those of the reference of
    products. A layer that the run did not write, such as `passes` where no implement is known, raises `InputError`.
    """

    trajectory = ResultLayer()
    """Pose of the vehicle at each scan, with its standard deviations and the state of the implement."""
    passes = ResultLayer()
    """Ground worked by each pass."""
    coverage = ResultLayer()
    """All ground worked."""
    overlaps = ResultLayer()
    """Ground worked by two passes."""
    misses = ResultLayer()
    """Ground missed."""
    zones = ResultLayer()
    """Headland and body of the field."""
    tool_path = ResultLayer()
    """Path of the implement, a line for each stretch in one state."""
    events = ResultLayer()
    """Implement down and up, stops, reversals, gaps."""
    boundary = ResultLayer()
    """Boundary of the field."""
    unworked = ResultLayer()
    """Ground of the field that was not worked."""
    strips = ResultLayer()
    """Ground seen by each straight pass of a flight."""
    strip_differences = ResultLayer()
    """Differences in height between the strips of a flight."""
    control_points = ResultLayer()
    """Surveyed points that correct the run or check it, with the cloud's residuals."""
    parcels = ResultLayer()
    """Parcels of a trial, with height and volume of the crop."""
    planes = ResultLayer()
    """Planes found in the cloud."""
    lines = ResultLayer()
    """Lines found in the cloud, such as wires."""
    plants = ResultLayer()
    """Plants found in the cloud."""

    def __init__(self, folder: ResultFolder) -> None:
        self._folder = folder

    def __repr__(self) -> str:
        return f"Result({str(self.path)!r}, name={self._folder.name!r})"

    @property
    def path(self) -> Path:
        """The folder."""
        return self._folder.folder

    @property
    def report(self) -> dict[str, Any]:
        """The content of `report.json`."""
        return self._folder.report

    def layer(self, name: str) -> geopandas.GeoDataFrame:
        """The layer of that name; raises InputError if the run did not write it, or it cannot be read."""
        return geodataframe(self._folder.layer(name))

    @property
    def layers(self) -> Layers:
        """All layers of `field.gpkg`: a mapping from their names to GeoDataFrames."""
        return Layers(self._folder)

    def points(self, bounds: Box | None = None, classes: Iterable[int] | None = None) -> Points:
        """Points of `cloud.copc.laz`, as by `furrowmap.open_points`; raises InputError without a readable cloud."""
        return open_points(self._file(CLOUD), bounds, classes)

    @property
    def dsm(self) -> Any:
        """Surface as left at the end, heights in metres: an `xarray.DataArray`, or a `Raster` without xarray."""
        return read_raster(self._file(DSM))

    @property
    def dsm_before(self) -> Any:
        """Surface before the implement passed; type as `dsm`."""
        return read_raster(self._file(DSM_BEFORE))

    @property
    def change(self) -> Any:
        """Change of the surface, after minus before; type as `dsm`."""
        return read_raster(self._file(CHANGE))

    def _file(self, name: str) -> Path:
        path = self.path / name
        if not path.is_file():
            raise InputError("no-product", path=self.path, name=name, report=", ".join(self.report["products"]))
        return path


def open_result(folder: str | Path) -> Result:
    """Open the result that `furrowmap.run` or `furrowmap run` wrote to a folder.

    Raises:
        InputError: if there is no result, or it cannot be read.
        RefusedError: if a run is writing to the folder.
    """
    return Result(result_folder.open_result(Path(folder)))


def read_raster(path: Path) -> Any:
    """The first band of a GeoTIFF.

    Returns:
        An `xarray.DataArray` with the dimensions y and x (centres of the cells, easting and northing in metres) and the
        attributes `crs` (WKT) and `transform`; where xarray is not installed, a `Raster`.

    Raises:
        InputError: if the file is damaged.
        RefusedError: if it takes more than half of the free memory.
    """
    import pyproj

    from furrowmap.core.readers.geotiff import expect_crs, open_geotiff
    from furrowmap.core.readers.raster_heights import height_scale
    from furrowmap.core.runtime.memory import expect_memory

    with open_geotiff(path, _no_raster) as source:
        expect_crs(source, path)
        expect_memory(path, source.width * source.height * np.dtype(source.dtypes[0]).itemsize)
        if source.transform.b or source.transform.d:
            raise _no_raster(path, "has rotated or sheared cells")
        scale = height_scale(source, path)
        array = source.read(1)
        if not scale.plain:
            array = scale.heights_m(source.read(1, masked=True))
        elif source.nodata is not None:
            array = np.where(array == source.nodata, np.float32(np.nan), array)
        crs = pyproj.CRS.from_wkt(source.crs.to_wkt())
        raster = Raster(array, source.transform, crs.sub_crs_list[0] if crs.is_compound else crs)
    try:
        import xarray
    except ImportError:
        return raster
    rows, columns = array.shape
    x = raster.transform.c + raster.transform.a * (np.arange(columns) + 0.5)
    y = raster.transform.f + raster.transform.e * (np.arange(rows) + 0.5)
    attributes = {"crs": raster.crs.to_wkt(), "transform": tuple(raster.transform)[:6], "units": "m"}
    return xarray.DataArray(array, {"y": y, "x": x}, ("y", "x"), path.stem, attributes)


def _no_raster(path: Path, why: Words) -> InputError:
    return InputError("raster-unreadable", path=path, why=why)
