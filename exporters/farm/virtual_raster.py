"""GDAL's virtual raster (VRT): an XML file that refers to the cells of other rasters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from pyproj import CRS

from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.atomic import relative_path
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, reported_crs

Source = tuple[Path, Grid, float | None]
"""A file, its cells, and its nodata value."""


def virtual_raster(
    folder: Path, grid: Grid, crs: CRS, bands: Sequence[Band], sources: Sequence[Source], origin: Origin
) -> str:
    """The text of a virtual raster.

    Args:
        folder: where it will lie; the paths of sources on the same drive are relative to it.
        grid: of its cells.
        crs: of its cells.
        bands: description and unit; each source has them.
        sources: with cells of the grid; later ones cover earlier ones.
        origin: its provenance.
    """
    crs = reported_crs(crs)
    root = ET.Element("VRTDataset", {"rasterXSize": str(grid.columns), "rasterYSize": str(grid.rows)})
    ET.SubElement(root, "SRS", {"dataAxisToSRSAxisMapping": _axes(crs)}).text = crs.to_wkt()
    west, north = grid.west * grid.cell_m, grid.north * grid.cell_m
    transform = (west, grid.cell_m, 0.0, north, 0.0, -grid.cell_m)
    ET.SubElement(root, "GeoTransform").text = ", ".join(repr(float(number)) for number in transform)
    metadata = ET.SubElement(root, "Metadata")
    for name, text in origin.metadata.items():
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
    name = relative_path(path, folder)
    relative = str(int(name is not None))
    ET.SubElement(within, "SourceFilename", {"relativeToVRT": relative}).text = name or str(path)
    ET.SubElement(within, "SourceBand").text = str(band)
    size = {"xSize": str(grid.columns), "ySize": str(grid.rows)}
    ET.SubElement(within, "SrcRect", {"xOff": "0", "yOff": "0", **size})
    offset = {"xOff": str(grid.west - whole.west), "yOff": str(whole.north - grid.north)}
    ET.SubElement(within, "DstRect", {**offset, **size})
    ET.SubElement(within, "NODATA").text = "nan" if nodata is None else repr(float(nodata))


def _axes(crs: CRS) -> str:
    """The CRS's axes in the order of easting, northing and, where it has them, heights."""
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    first = horizontal.axis_info[0].direction if horizontal.axis_info else "east"
    return ("2,1" if first.lower() == "north" else "1,2") + (",3" if crs.is_compound else "")
