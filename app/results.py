"""The result of a run, opened for notebooks and other software."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.files import result_folder
from furrowmap.exporters.files.result_folder import CHANGE, CLOUD, DSM, DSM_BEFORE, ResultFolder
from furrowmap.exporters.files.vector_layers import geodataframe
from furrowmap.points import Points, open_points

if TYPE_CHECKING:
    import geopandas
    import pyproj
    from rasterio import Affine


@dataclass(frozen=True)
class Raster:
    """The first band of a GeoTIFF, where xarray is not installed.

    Attributes:
        array: (rows, columns) float32, the northernmost row first; nan where there is no value.
        transform: from (column, row) of a cell's upper left corner to easting and northing.
        crs: of easting and northing.
    """

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
        """The layer of that name.

        Raises:
            InputError: if the run did not write it, it is damaged, or geopandas is not installed.
        """
        return geodataframe(self._folder.layer(name))

    @property
    def layers(self) -> Layers:
        """All layers of `field.gpkg`: a mapping from their names to GeoDataFrames."""
        return Layers(self._folder)

    def points(self, bounds: Box | None = None, classes: Iterable[int] | None = None) -> Points:
        """The points of `cloud.copc.laz`; see `furrowmap.open_points`.

        Raises:
            InputError: if the result has no cloud, or it is damaged.
        """
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

    from furrowmap.core.readers.geotiff import open_geotiff
    from furrowmap.core.runtime.limits import expect_memory

    with open_geotiff(path, _no_raster, with_heights=False) as source:
        if source.crs is None:
            raise _no_raster(path, "has no CRS")
        expect_memory(path, source.width * source.height * np.dtype(source.dtypes[0]).itemsize)
        array = source.read(1)
        if source.nodata is not None:
            array = np.where(array == source.nodata, np.float32(np.nan), array)
        raster = Raster(array, source.transform, pyproj.CRS.from_wkt(source.crs.to_wkt()))
    try:
        import xarray
    except ImportError:
        return raster
    rows, columns = array.shape
    x = raster.transform.c + raster.transform.a * (np.arange(columns) + 0.5)
    y = raster.transform.f + raster.transform.e * (np.arange(rows) + 0.5)
    attributes = {"crs": raster.crs.to_wkt(), "transform": tuple(raster.transform)[:6], "units": "m"}
    return xarray.DataArray(array, {"y": y, "x": x}, ("y", "x"), path.stem, attributes)


def _no_raster(path: Path, why: str) -> InputError:
    return InputError("raster-unreadable", path=path, why=why)
