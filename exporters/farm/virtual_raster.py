"""GDAL's virtual raster (VRT): an XML file that refers to the cells of other rasters."""

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
    """The text of a virtual raster in `folder`; later sources cover earlier ones, paths on its drive are relative."""
    crs = reported_crs(crs)
    root = ET.Element("VRTDataset", {"rasterXSize": str(grid.columns), "rasterYSize": str(grid.rows)})
    flat = crs.sub_crs_list[0] if crs.is_compound else crs
    first = flat.axis_info[0].direction if flat.axis_info else "east"
    # The CRS's axes in the order of easting, northing and, where it has them, heights.
    axes = ("2,1" if first.lower() == "north" else "1,2") + (",3" if crs.is_compound else "")
    ET.SubElement(root, "SRS", {"dataAxisToSRSAxisMapping": axes}).text = crs.to_wkt()
    a, b, c, d, e, f = grid.transform
    ET.SubElement(root, "GeoTransform").text = ", ".join(repr(float(number)) for number in (c, a, b, f, d, e))
    metadata = ET.SubElement(root, "Metadata")
    for name, text in origin.metadata.items():
        ET.SubElement(metadata, "MDI", {"key": name}).text = text
    for i, band in enumerate(bands, start=1):
        element = ET.SubElement(root, "VRTRasterBand", {"dataType": "Float32", "band": str(i)})
        ET.SubElement(element, "Description").text = band.description
        ET.SubElement(element, "UnitType").text = band.unit
        ET.SubElement(element, "NoDataValue").text = "nan"
        for path, part, nodata in sources:
            within = ET.SubElement(element, "ComplexSource")
            relative = relative_path(path, folder)
            attributes = {"relativeToVRT": str(int(relative is not None))}
            ET.SubElement(within, "SourceFilename", attributes).text = relative or str(path)
            ET.SubElement(within, "SourceBand").text = str(i)
            size = {"xSize": str(part.columns), "ySize": str(part.rows)}
            ET.SubElement(within, "SrcRect", {"xOff": "0", "yOff": "0", **size})
            offset = {"xOff": str(part.west - grid.west), "yOff": str(grid.north - part.north)}
            ET.SubElement(within, "DstRect", {**offset, **size})
            ET.SubElement(within, "NODATA").text = "nan" if nodata is None else repr(float(nodata))
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode") + "\n"
