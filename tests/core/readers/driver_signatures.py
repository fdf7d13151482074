"""What GDAL's drivers know their files by, in files that refer to another file and an address."""

from __future__ import annotations

import json

import pyogrio
import rasterio
from rasterio.drivers import raster_driver_extensions

SERVICES = (
    "WFS",
    "OAPIF",
    "CSW",
    "WCS",
    "WMS",
    "WMTS",
    "EEDA",
    "NGW",
    "Carto",
    "AmigoCloud",
    "Elasticsearch",
    "PLSCENES",
)


def signatures(file: str, url: str) -> dict[str, str]:
    """A text by the driver that takes it; of drivers that are named by a prefix, the connection that they take."""
    layer = f"<SrcDataSource relativeToVRT='0'>{file}</SrcDataSource>"
    found = {
        "OGR_VRT": f"<OGRVRTDataSource><OGRVRTLayer name='secret'>{layer}</OGRVRTLayer></OGRVRTDataSource>",
        "OGR_VRT of an address": (
            "<OGRVRTDataSource><OGRVRTLayer name='a'><SrcDataSource>/vsicurl/"
            f"{url}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>"
        ),
        "VRT": (
            "<VRTDataset rasterXSize='2' rasterYSize='2'><VRTRasterBand dataType='Byte' band='1'><SimpleSource>"
            f"<SourceFilename relativeToVRT='0'>{file}</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"
        ),
        "GTI": f"<GDALTileIndexDataset><IndexDataset>{file}</IndexDataset></GDALTileIndexDataset>",
        "GDALG": json.dumps({"type": "gdal_streamed_alg", "command_line": f"gdal vector read {file}"}),
        "WFS": f"<OGRWFSDataSource><URL>{url}</URL></OGRWFSDataSource>",
        "OAPIF": f"<OGROAPIFDataSource><URL>{url}</URL></OGROAPIFDataSource>",
        "CSW": f"<OGRCSWDataSource><URL>{url}</URL></OGRCSWDataSource>",
        "WMS": f"<GDAL_WMS><Service name='TMS'><ServerUrl>{url}</ServerUrl></Service></GDAL_WMS>",
        "WMTS": f"<GDAL_WMTS><GetCapabilitiesUrl>{url}</GetCapabilitiesUrl></GDAL_WMTS>",
        "WCS": f"<WCS_GDAL><ServiceURL>{url}</ServiceURL></WCS_GDAL>",
        "OGCAPI": json.dumps({"links": [{"rel": "self", "href": url}], "collections": []}),
        "STACIT": json.dumps({"stac_version": "1.0.0", "type": "FeatureCollection", "features": [
            {"type": "Feature", "stac_version": "1.0.0", "properties": {}, "assets": {"a": {"href": url}}}
        ]}),
        "STACTA": json.dumps({"stac_extensions": ["tiled-assets"], "asset_templates": {"a": {"href": url}}}),
        "ESRIJSON": json.dumps({"esriGeometryType": "x", "geometryType": "esriGeometryPoint", "features": []}),
        "TopoJSON": json.dumps({"type": "Topology", "objects": {"a": {"type": "Point", "coordinates": [1, 1]}}}),
        "GeoJSONSeq": '{"type":"Feature","geometry":null}\n{"type":"Feature","geometry":null}',
        "JSONFG": json.dumps({"conformsTo": ["http://www.opengis.net/spec/json-fg-1/0.1"], "type": "Feature"}),
        "GML": f"<gml:FeatureCollection xmlns:gml='http://www.opengis.net/gml' xlink:href='{url}'/>",
        "GMLAS": f"<a xsi:schemaLocation='http://x {url}' xmlns:xsi='http://www.w3.org/2001/XMLSchema-instance'/>",
        "KML": f"<kml><Document><NetworkLink><Link><href>{url}</href></Link></NetworkLink></Document></kml>",
        "LIBKML": f"<kml><Document><NetworkLink><Link><href>{file}</href></Link></NetworkLink></Document></kml>",
        "MapML": f"<mapml- ><map-link href='{url}'/></mapml->",
        "GPX": "<gpx></gpx>",
        "GeoRSS": "<rss></rss>",
        "PDS4": f"<Product_Observational><File><file_name>{file}</file_name></File></Product_Observational>",
        "OGR_PDS": f'PDS_VERSION_ID = PDS3\n^TABLE = "{file}"\nEND\n',
        "PDS": f'PDS_VERSION_ID = PDS3\n^IMAGE = "{file}"\nEND\n',
        "ISIS3": f"Object = IsisCube\n  Object = Core\n    ^Core = {file}\n  End_Object\nEnd_Object\n",
        "ERS": f'DatasetHeader Begin\n DataFile = "{file}"\nDatasetHeader End\n',
        "DIMAP": f"<Dimap_Document version='1'><Data_File><DATA_FILE_PATH href='{file}'/></Data_File></Dimap_Document>",
        "CSV": "id,WKT\n1,POINT (1 1)\n",
        "MBTiles": json.dumps({"tilejson": "2.0.0", "tiles": [url]}),
        "PMTiles": "PMTiles\x03",
        "S57": "0011 3LE1 0900",
        "DXF": "  0\nSECTION\n  2\nHEADER\n",
        "MapInfo File": "Version 300\nCharset \"Neutral\"\n",
        "VFK": "&HVERZE;\"4.0\"\n",
        "JML": "<JCSDataFile></JCSDataFile>",
        "SXF": "SXF",
        "LVBAG": "<sl-bag-extract:bagStand/>",
        "EDIGEO": "BOMT 12:x\n",
        "MEM": f"MEM:::DATAPOINTER={file}",
        "HTTP": url,
        "SQLite": "SQLite format 3",
    }  # fmt: skip
    for name in (*pyogrio.list_drivers(), *_raster_drivers()):
        found.setdefault(name, f"{name}:{url}" if name in SERVICES else f"{name}:{file}")
    return found


def _raster_drivers() -> list[str]:
    with rasterio.Env() as env:
        return sorted({*env.drivers(), *raster_driver_extensions().values()})
