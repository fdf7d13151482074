"""GDAL's virtual raster: a text that refers to cells of other files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from pyproj import CRS

from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, told_crs

Source = tuple[Path, Grid, float | None]
"""A file, its cells, and the value of those without one."""


def virtual_raster(
    folder: Path, grid: Grid, crs: CRS, bands: Sequence[Band], sources: Sequence[Source], origin: Origin
) -> str:
    """The text of a virtual raster.

    Args:
        folder: where it will lie; files on the same drive are named as seen from there, so that all may move together.
        grid: of its cells.
        crs: of its cells.
        bands: what they hold; each source has them.
        sources: whose cells are those of the grid; later ones cover earlier ones.
        origin: where it comes from.
    """
    crs = told_crs(crs)
    root = ET.Element("VRTDataset", {"rasterXSize": str(grid.columns), "rasterYSize": str(grid.rows)})
    ET.SubElement(root, "SRS", {"dataAxisToSRSAxisMapping": _axes(crs)}).text = crs.to_wkt()
    west, north = grid.west * grid.cell_m, grid.north * grid.cell_m
    transform = (west, grid.cell_m, 0.0, north, 0.0, -grid.cell_m)
    ET.SubElement(root, "GeoTransform").text = ", ".join(repr(float(number)) for number in transform)
    metadata = ET.SubElement(root, "Metadata")
    for name, text in origin.told.items():
        ET.SubElement(metadata, "MDI", {"key": name}).text = text
    for i, band in enumerate(bands, start=1):
        element = ET.SubElement(root, "VRTRasterBand", {"dataType": "Float32", "band": str(i)})
        ET.SubElement(element, "Description").text = band.description
        ET.SubElement(element, "UnitType").text = band.unit
        ET.SubElement(element, "NoDataValue").text = "nan"
        for source in sources:
            _put_source(element, i, folder, grid, source)
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode") + "\n"


def _put_source(element: ET.Element, band: int, folder: Path, whole: Grid, source: Source) -> None:
    path, grid, nodata = source
    within = ET.SubElement(element, "ComplexSource")
    name, relative = _way_to(path, folder)
    ET.SubElement(within, "SourceFilename", {"relativeToVRT": str(int(relative))}).text = name
    ET.SubElement(within, "SourceBand").text = str(band)
    size = {"xSize": str(grid.columns), "ySize": str(grid.rows)}
    ET.SubElement(within, "SrcRect", {"xOff": "0", "yOff": "0", **size})
    offset = {"xOff": str(grid.west - whole.west), "yOff": str(whole.north - grid.north)}
    ET.SubElement(within, "DstRect", {**offset, **size})
    ET.SubElement(within, "NODATA").text = "nan" if nodata is None else repr(float(nodata))


def _way_to(path: Path, folder: Path) -> tuple[str, bool]:
    try:
        return Path(os.path.relpath(path, folder)).as_posix(), True
    except ValueError:  # on another drive of Windows
        return str(path), False


def _axes(crs: CRS) -> str:
    """Which axes of the CRS easting and northing are, and the heights where it has them."""
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    first = horizontal.axis_info[0].direction if horizontal.axis_info else "east"
    return ("2,1" if first.lower() == "north" else "1,2") + (",3" if crs.is_compound else "")
