"""Formats by the first bytes of a file, to name what is not read, and say what to do with it.

Sources: the formats' specifications, and the programs that write those without one (PX4, ArduPilot, mavlink, gpsd).
"""

import re
from dataclasses import dataclass
from typing import Final

from furrowmap.core.runtime.languages.texts import Text

NMEA: Final = "Export NMEA 0183 (GGA, RMC, GST) with the receiver's or the processor's program"
CSV: Final = "Export positions, attitudes or measurements as CSV with the program that wrote it"
UNPACK: Final = "Unpack it"
SOLUTION: Final = "Compute positions from it with RTKLIB (.pos) or another program"
TO_LAS: Final = "Convert it to LAS or LAZ, for example with CloudCompare"
PACKETS: Final = "Record the packets as PCAP, or convert it to a ROS bag with the maker's program"
NO_RECORDING: Final = (
    "It is no recording: name it where such a file belongs (boundary, parcels, surfaces, images, tables)"
)
GEODATA: Final = "Convert it to GeoPackage or GeoTIFF with QGIS"


@dataclass(frozen=True)
class FileKind:
    """A format: its name in a sentence, what to do with a file of it, and whether its files are text."""

    name: Text
    remedy: Text
    is_text: bool = False


def _table(*rows: tuple[bytes, str, str], is_text: bool = False) -> list[tuple[re.Pattern[bytes], FileKind]]:
    return [(re.compile(start, re.DOTALL), FileKind(Text(name), Text(remedy), is_text)) for start, name, remedy in rows]


_FIRST_TEXT: Final = rb"(?:\xef\xbb\xbf)?\s*"
_XML: Final = _FIRST_TEXT + rb"(?:<\?xml[^>]*>\s*)?(?:<!--.*?-->\s*)*"

FILE_KINDS: Final = [
    *_table(
        (rb"\xb5\x62", "a u-blox receiver's own messages (UBX)", NMEA),
        (rb"\$@", "a Septentrio receiver's own messages (SBF)", NMEA),
        (rb"\xd3[\x00-\x03]", "corrections or raw observations (RTCM 3)", SOLUTION),
        (rb"\x10[^\x10\x03].{0,200}?\x10\x03\x10[^\x10\x03]", "a Trimble receiver's own messages (TSIP)", NMEA),
        (rb"\xa0\xa2.{2}.*?\xb0\xb3", "a SiRF receiver's own messages", NMEA),
        (rb"\xaa\x44[\x12\x13\x18\xb5]", "a NovAtel or Unicore receiver's own messages", NMEA),
        (rb"JP\d{3}RLOGF", "a Javad or Topcon receiver's own messages (GREIS)", NMEA),
        (rb"\x55.[\x00-\x04\xff].{3,260}?\x55.[\x00-\x04\xff]", "a Swift receiver's own messages (SBP)", NMEA),
        (rb"\xfa\xff", "an Xsens unit's own messages (MT)", CSV),
        (rb"ULog\x01\x12\x35", "a PX4 flight log (ULog)", CSV),
        (rb"\xa3\x95[\x00-\xff]", "an ArduPilot flight log (DataFlash .bin)", CSV),
        (rb"\x00[\x04-\x0e].{6}[\xfe\xfd]", "a MAVLink telemetry log (.tlog)", CSV),
        (rb".{8}\.FIT", "a Garmin FIT activity", CSV),
        (rb".{16}BUILD", "a DJI drone's own flight log (.DAT)", CSV),
        (rb"LOGH", "an encrypted flight log of a DJI drone (.DAT)", CSV),
        (rb"TIMETAG RTKLIB", "times of arrival of another log, by RTKLIB (.tag)", NO_RECORDING),
        (rb"livox_tech", "a Livox recording (LVX)", PACKETS),
        (rb"snoop\0\0\0", "a capture in Sun's format (snoop)", PACKETS),
        (rb"\$GRP", "an Applanix system's own records", "Export the trajectory (SBET) with POSPac"),
        (rb"FASTBIN\0", "a TerraScan point cloud (fast binary)", TO_LAS),
        (rb"(?:# )?\.PCD", "a PCD point cloud", TO_LAS),
        (rb"LASF", "a LAS or LAZ point cloud", TO_LAS),
        (rb"ASTM-E57", "an E57 point cloud", TO_LAS),
        (rb"\x89HDF\r\n\x1a\n", "an HDF5 file", CSV),
        (rb"CDF[\x01\x02\x05]", "a NetCDF file", CSV),
        (rb"MATLAB 5\.0", "a MATLAB file", CSV),
        (rb"\x93NUMPY", "a NumPy array", CSV),
        (rb"PAR1", "a Parquet table", CSV),
        (rb"ARROW1\0\0", "an Arrow table", CSV),
        (rb"PK\x03\x04.{26}mimetypeapplication/vnd\.oasis", "an OpenDocument file, such as .ods", NO_RECORDING),
        (rb"PK\x03\x04.{26}\[Content_Types\]\.xml", "an Office document, such as .xlsx", NO_RECORDING),
        (rb"PK\x03\x04.{26}[^/\0]{0,40}\.gdb/", "a zipped file geodatabase of Esri", GEODATA),
        (
            rb"PK\x03\x04.{26}(?:[^/\0]{1,20}/)?[^/\0]{1,30}\.(?i:shp|shx|dbf|prj|cpg)",
            "a zipped Shapefile",
            NO_RECORDING,
        ),
        (rb"PK\x03\x04.{26}(?i:TASKDATA)[/.]", "zipped ISO 11783-10 task data", NO_RECORDING),
        (rb"PK\x03\x04.{26}doc\.kml", "zipped KML (.kmz)", NO_RECORDING),
        (rb"PK\x03\x04", "a zip archive", UNPACK),
        (rb"PK\x05\x06", "an empty zip archive", UNPACK),
        (rb"\x1f\x8b", "a gzip archive", UNPACK),
        (rb"\x28\xb5\x2f\xfd", "a Zstandard archive", UNPACK),
        (rb"\xfd7zXZ\x00", "an xz archive", UNPACK),
        (rb"BZh[1-9]", "a bzip2 archive", UNPACK),
        (rb"\x04\x22\x4d\x18", "an LZ4 archive", UNPACK),
        (rb"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", UNPACK),
        (rb"Rar!\x1a\x07", "a RAR archive", UNPACK),
        (rb"SQLite format 3", "an SQLite database, such as a GeoPackage", NO_RECORDING),
        (rb"\x00\x00\x27\x0a", "a Shapefile", NO_RECORDING),
        (
            rb"[\x03\x83\xf5].[\x01-\x0c][\x01-\x1f].{4}.{2}.{2}\0\0",
            "a dBASE table, as of a Shapefile",
            NO_RECORDING,
        ),
        (rb"fgb[\x02-\x04]", "a FlatGeobuf file", NO_RECORDING),
        (rb"PMTiles[\x01-\x03]", "an archive of map tiles (PMTiles)", NO_RECORDING),
        (rb"(?:II\*\x00|MM\x00\*)", "a TIFF picture", NO_RECORDING),
        (rb"(?:II\+\x00|MM\x00\+)", "a BigTIFF picture", NO_RECORDING),
        (rb"\xff\xd8\xff", "a JPEG picture", NO_RECORDING),
        (rb"\x89PNG", "a PNG picture", NO_RECORDING),
        (rb"GIF8[79]a", "a GIF picture", NO_RECORDING),
        (rb"BM.{4}\x00\x00\x00\x00", "a BMP picture", NO_RECORDING),
        (rb"RIFF.{4}WEBP", "a WebP picture", NO_RECORDING),
        (rb"\x00\x00\x00\x0cjP  ", "a JPEG 2000 picture", GEODATA),
        (rb".{4}ftyp(?:heic|heix|mif1)", "a HEIC picture", NO_RECORDING),
        (rb".{4}ftyp|RIFF.{4}AVI |\x1a\x45\xdf\xa3", "a video", NO_RECORDING),
        (rb"\xd0\xcf\x11\xe0", "a compound file, such as an old .xls or a FARO scan (.fls)", NO_RECORDING),
        (rb"\x00\x01\x00\x00Standard (?:Jet|ACE) DB", "an Access database (.mdb, .accdb)", CSV),
        (rb"%PDF", "a PDF document", NO_RECORDING),
        (rb"AC10\d\d\0", "an AutoCAD drawing (DWG)", GEODATA),
        (rb"DSBB|DSRB|DSAA\r?\n", "a Surfer grid", GEODATA),
        (rb"AutoCAD Binary DXF\r\n\x1a\0", "a binary DXF drawing", GEODATA),
        (rb"EHFA_HEADER_TAG\0", "an ERDAS Imagine raster (.img)", GEODATA),
        (rb"msid", "a MrSID picture", GEODATA),
        (rb"\xff\x4f\xff\x51", "a JPEG 2000 codestream", GEODATA),
        (rb"NITF0\d\.\d\d", "a NITF picture", GEODATA),
        (rb"GRIB", "a GRIB file", GEODATA),
        (rb"glTF[\x01\x02]", "a glTF model", TO_LAS),
        (rb"\x7fELF|MZ\x90", "a program", NO_RECORDING),
        (
            rb"\x00{64}",
            "a file of zeros: its content was never written, as after a power cut",
            "Copy the recording again",
        ),
    ),
    *_table(
        (
            rb"#ROS(?:RECORD|LOG)",
            "a ROS bag of version 1",
            "Convert it with `rosbag migrate` or `rosbag fix` of ROS 1",
        ),
        (
            rb"version https://git-lfs",
            "a pointer of Git LFS, not the file itself",
            "Fetch the file with `git lfs pull`",
        ),
        (
            _FIRST_TEXT + rb"(?i:<!doctype html|<html)",
            "a web page, as of a download that asked for a login",
            "Download the file again",
        ),
        (
            rb"GRIDDED CORRECTION|for SemiDynaEXE|for PatchJGD|JGD2000-TokyoDatum",
            "a coordinate transformation parameter file (.par)",
            "Name it in a session under [crs]",
        ),
        (rb".{0,60}COMPACT RINEX", "compact RINEX observations (Hatanaka)", SOLUTION),
        (rb" {5}[234]\.\d\d {11}O", "RINEX observations", SOLUTION),
        (rb" {5}[234]\.\d\d {11}[NGLH]", "RINEX ephemerides", SOLUTION),
        (rb"#[abcd][PV]\d{4} ", "precise orbits (SP3)", SOLUTION),
        (_XML + rb"<gpx", "GPX tracks", NMEA),
        (_XML + rb"<TrainingCenterDatabase", "Garmin TCX activities", CSV),
        (_XML + rb"<(?:\w+:)?kml", "KML", NO_RECORDING),
        (
            _XML + rb"<ISO11783_TaskData",
            "ISO 11783-10 task data",
            "Name it TASKDATA.XML, in a folder with its logs",
        ),
        (_XML + rb"<LandXML", "a LandXML surface or survey", GEODATA),
        (_XML + rb"<JOBFile", "a Trimble job (JobXML, .jxl)", CSV),
        (_XML + rb"<(?:\w+:)?Placemark", "KML", NO_RECORDING),
        (_XML + rb"<(?:\w+:)?FeatureCollection", "GML or WFS features", GEODATA),
        (_FIRST_TEXT + rb"<OGRVRTDataSource", "a virtual layer of GDAL (VRT), which is not followed", GEODATA),
        (_FIRST_TEXT + rb"<VRTDataset", "a virtual raster of GDAL (VRT), which is not followed", GEODATA),
        (_XML + rb"<", "XML", NO_RECORDING),
        (_FIRST_TEXT + rb'\{\s*"type"\s*:\s*"Feature', "GeoJSON", NO_RECORDING),
        (_FIRST_TEXT + rb"\{", "JSON", NO_RECORDING),
        (_FIRST_TEXT + rb"(?i:ncols|nrows)\s+\d", "an ASCII grid of Esri", GEODATA),
        (rb"(?:\s*999\r?\n[^\n]*\n)*\s*0\r?\nSECTION", "a DXF drawing", GEODATA),
        (rb"ISO-10303-21", "an IFC or STEP model", GEODATA),
        (rb"solid [^\n]*\n\s*facet normal", "a mesh in STL", TO_LAS),
        (rb"00NM(?:SC|\w\w) ?V\d\d", "a Trimble or Geodimeter data collector job (.dc)", CSV),
        (rb"JB,NM", "a Carlson raw survey file (.rw5)", CSV),
        (rb"\*?[1-9]\d[\d.]{4}[+-]\w{8}", "Leica survey data (GSI)", CSV),
        (
            rb"(?:PROJCS|GEOGCS|GEOCCS|COMPD_CS|VERT_CS|LOCAL_CS|PROJCRS|GEOGCRS|GEODCRS|COMPOUNDCRS|BOUNDCRS)\[",
            "the CRS of a Shapefile (.prj)",
            NO_RECORDING,
        ),
        (rb"(?i:!table\r?\n!version)", "a MapInfo table (.tab)", GEODATA),
        (rb"EXP  [01] ", "an ArcInfo exchange file (.e00)", GEODATA),
        (rb"\d+\r?\n\d\d:\d\d:\d\d,\d{3} --> ", "subtitles of a video (.srt), as drones of DJI write", CSV),
        (rb"ply\r?\n", "a PLY point cloud", TO_LAS),
        (rb"\d+\r?\n\d+\r?\n", "a PTX point cloud", TO_LAS),
        (rb"\d{1,12}\r?\n[-+.\d]+ [-+.\d]+ [-+.\d]+", "a PTS point cloud", TO_LAS),
        (
            rb"\d+\t\d+\.\d+\t\[\d+\]\t",
            "exposure times of a DJI drone (.MRK)",
            "Name the folder of its images",
        ),
        is_text=True,
    ),
]
TEXT_HEAD_BYTES: Final = 4096
"""First bytes that tell text from binary data."""
_TEXT_CONTROLS: Final = b"\t\n\v\f\r\x1a"
_MOST_CONTROLS: Final = 0.02
"""Share of control characters from which content is no text in any encoding."""
BINARY: Final = Text("binary data")


def file_kind(data: bytes) -> FileKind | None:
    """The format of a file that begins with `data`, of which 64 bytes suffice; None for one that is not known."""
    head = data[:TEXT_HEAD_BYTES]
    return next((kind for pattern, kind in FILE_KINDS if pattern.match(head)), None)


def binary_kind(data: bytes) -> Text | None:
    """What content is that is no text, such as "a PNG picture" or "binary data"; None for text in any encoding.

    It is told by the first :data:`TEXT_HEAD_BYTES` bytes.
    """
    data = data[:TEXT_HEAD_BYTES]
    controls = sum(byte < 32 and byte not in _TEXT_CONTROLS for byte in data)
    is_text = b"\0" not in data and controls <= _MOST_CONTROLS * len(data)
    named = file_kind(data)
    if named is not None and named.is_text:
        return None
    if named is not None:
        return named.name
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):  # the byte order marks of UTF-16
        return None
    return None if is_text else BINARY
