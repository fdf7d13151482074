"""Formats that surveyors and farmers have, by the first 64 bytes of files made by other libraries or specifications."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import re
import sqlite3
import struct
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from furrowmap.core.readers.reader import Recognised
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_signatures import binary_kind, file_kind

NOISE = np.random.default_rng(7).bytes(200)


def picture(kind: str) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (9, 9)).save(file, kind)
    return file.getvalue()


def archive(name: str, content: str = "text") -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        packed.writestr(name, content)
    return file.getvalue()


def database(tmp_path: Path) -> bytes:
    with sqlite3.connect(tmp_path / "a.db") as base:
        base.execute("create table t (a)")
    return (tmp_path / "a.db").read_bytes()


def array() -> bytes:
    file = io.BytesIO()
    np.save(file, np.zeros(9))
    return file.getvalue()


def rinex(version: str, kind: str) -> bytes:
    return f"{version:>9}{'':11}{kind:<20}{'M (MIXED)':<20}RINEX VERSION / TYPE\n".encode()


XML = b'<?xml version="1.0" encoding="UTF-8"?>\n'
TSIP = b"\x10\x8f\x20" + b"\x01" * 20 + b"\x10\x03"
SBP = b"\x55\x0a\x02\x42\x00\x14" + bytes(range(97, 117)) + b"\x12\x34"

FILES: dict[str, tuple[bytes, str]] = {
    "UBX": (b"\xb5\x62\x01\x07\x5c\x00" + NOISE, "u-blox"),
    "SBF": (b"$@\x12\x34\xa7\x0f" + NOISE, "Septentrio"),
    "RTCM 3": (b"\xd3\x00\x13\x3e\xd0" + NOISE, "RTCM 3"),
    "TSIP": (TSIP * 3, "TSIP"),
    "SiRF": (b"\xa0\xa2\x00\x04\x29abc\x01\x02\xb0\xb3" * 4, "SiRF"),
    "NovAtel": (b"\xaa\x44\x12\x1c" + NOISE, "NovAtel"),
    "Unicore": (b"\xaa\x44\xb5\x1c" + NOISE, "Unicore"),
    "GREIS": (b"JP055RLOGF JPS Receiver Log\r\n", "Javad"),
    "SBP": (SBP * 3, "Swift"),
    "Xsens": (b"\xfa\xff\x36\x10" + NOISE, "Xsens"),
    "Applanix": (b"$GRP\x01\x00\x84\x00" + NOISE, "Applanix"),
    "ULog": (b"ULog\x01\x12\x35\x01" + NOISE, "PX4"),
    "ArduPilot": (b"\xa3\x95\x80\x80\x59FMT\x00BBnNZ" + NOISE, "ArduPilot"),
    "MAVLink": (struct.pack(">Q", 1_779_000_000_000_000) + b"\xfd\x09\x00\x00" + NOISE, "MAVLink"),
    "FIT": (b"\x0e\x10\x5e\x08" + b"\x00\x10\x00\x00.FIT" + NOISE, "FIT"),
    "DJI DAT": (NOISE[:16] + b"BUILD 2017-05-12 09:30:05\0" + NOISE, "DJI"),
    "DJI DAT, encrypted": (b"LOGH\x01\0" + NOISE, "DJI"),
    "time tags": (b"TIMETAG RTKLIB 2.4.3\0" + bytes(40), "RTKLIB"),
    "LVX2": (b"livox_tech\0\0\0\0\0\0\x02\0\0\0" + NOISE, "Livox"),
    "LVX": (b"livox_tech\0\0\0\0\0\0\x01\x01" + NOISE, "Livox"),
    "snoop": (b"snoop\0\0\0\0\0\0\x02" + NOISE, "snoop"),
    "LAS": (b"LASF\x00\x00" + NOISE, "LAS"),
    "E57": (b"ASTM-E57\x01\0\0\0" + NOISE, "E57"),
    "PCD": (b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n", "PCD"),
    "PLY": (b"ply\nformat ascii 1.0\n", "PLY"),
    "PTX": (b"720\r\n360\r\n0 0 0\r\n1 0 0\r\n", "PTX"),
    "PTS": (b"1200\n1.5 2.5 3.5 -1200 128 128 128\n", "PTS"),
    "HDF5": (b"\x89HDF\r\n\x1a\n" + NOISE, "HDF5"),
    "NetCDF": (b"CDF\x01\0\0\0\0" + NOISE, "NetCDF"),
    "MATLAB": (b"MATLAB 5.0 MAT-file, Platform: GLNXA64, Created on: Mon", "MATLAB"),
    "NumPy": (array(), "NumPy"),
    "Parquet": (b"PAR1\x15\x04" + NOISE, "Parquet"),
    "ODS": (archive("mimetype", "application/vnd.oasis.opendocument.spreadsheet"), "OpenDocument"),
    "XLSX": (archive("[Content_Types].xml"), ".xlsx"),
    "KMZ": (archive("doc.kml"), "KML"),
    "zip": (archive("a.txt"), "zip archive"),
    "zipped geodatabase": (archive("farm.gdb/a00000001.gdbtable"), "geodatabase"),
    "zipped Shapefile": (archive("plots.shp"), "Shapefile"),
    "zipped Shapefile in a folder": (archive("plots/Plots 2026.DBF"), "Shapefile"),
    "zipped task data": (archive("TASKDATA/TASKDATA.XML"), "task data"),
    "gzip": (gzip.compress(NOISE), "gzip"),
    "xz": (lzma.compress(NOISE), "xz"),
    "bzip2": (bz2.compress(NOISE), "bzip2"),
    "7-Zip": (b"7z\xbc\xaf\x27\x1c\x00\x04" + NOISE, "7-Zip"),
    "RAR": (b"Rar!\x1a\x07\x01\x00" + NOISE, "RAR"),
    "Shapefile": (struct.pack(">7i", 9994, 0, 0, 0, 0, 0, 50) + struct.pack("<2i", 1000, 5), "Shapefile"),
    "DBF": (struct.pack("<4BIHH20x", 3, 126, 5, 12, 20, 97, 30) + b"ID\0\0\0\0\0\0\0\0\0C", "dBASE"),
    "FlatGeobuf": (b"fgb\x03fgb\x00" + NOISE, "FlatGeobuf"),
    "PMTiles": (b"PMTiles\x03" + NOISE, "PMTiles"),
    "GeoTIFF": (picture("TIFF"), "TIFF"),
    "BigTIFF": (b"II+\x00\x08\x00\x00\x00" + NOISE, "BigTIFF"),
    "JPEG": (picture("JPEG"), "JPEG"),
    "PNG": (picture("PNG"), "PNG"),
    "GIF": (picture("GIF"), "GIF"),
    "BMP": (picture("BMP"), "BMP"),
    "WebP": (picture("WEBP"), "WebP"),
    "HEIC": (b"\x00\x00\x00\x18ftypheic\0\0\0\0" + NOISE, "HEIC"),
    "MP4": (b"\x00\x00\x00\x18ftypmp42\0\0\0\0" + NOISE, "video"),
    "FLS": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + NOISE, ".fls"),
    "MDB": (b"\x00\x01\x00\x00Standard Jet DB\x00\x01\0\0\0" + NOISE, "Access"),
    "ACCDB": (b"\x00\x01\x00\x00Standard ACE DB\x00\x02\0\0\0" + NOISE, "Access"),
    "binary DXF": (b"AutoCAD Binary DXF\r\n\x1a\x00\0\0SECTION\0", "DXF"),
    "Imagine": (b"EHFA_HEADER_TAG\0" + NOISE, "ERDAS"),
    "MrSID": (b"msid\x01\0\x02\0" + NOISE, "MrSID"),
    "JPEG 2000 codestream": (b"\xff\x4f\xff\x51\x00\x2f" + NOISE, "JPEG 2000"),
    "NITF": (b"NITF02.1003BF01", "NITF"),
    "GRIB": (b"GRIB\xff\xff\x00\x02" + NOISE, "GRIB"),
    "XLS": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + NOISE, ".xls"),
    "PDF": (b"%PDF-1.7\n" + NOISE, "PDF"),
    "DWG": (b"AC1032\0\0\0\0\0" + NOISE, "AutoCAD"),
    "Surfer": (b"DSRB\x04\0\0\0" + NOISE, "Surfer"),
    "zeros": (bytes(64), "zeros"),
    "bag 1.2": (b"#ROSRECORD V1.2\nversion 1", "ROS bag of version 1"),
    "Git LFS": (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a", "Git LFS"),
    "web page": (b"\r\n<!DOCTYPE html>\n<html><head><title>Sign in</title>", "web page"),
    "RINEX observations": (rinex("3.04", "OBSERVATION DATA"), "RINEX observations"),
    "RINEX ephemerides": (rinex("2.11", "N: GPS NAV DATA"), "RINEX ephemerides"),
    "compact RINEX": (f"{'3.0':<20}{'COMPACT RINEX FORMAT':<40}CRINEX".encode(), "compact RINEX"),
    "SP3": (b"#dP2026  5 12  0  0  0.00000000      96 ORBIT IGS20 FIT  IGS\n", "SP3"),
    "GPX": (XML + b'<gpx version="1.1" creator="a">', "GPX"),
    "KML": (XML + b'<kml xmlns="http://w">', "KML"),
    "LandXML": (XML + b"<LandXML>", "LandXML"),
    "GML": (b"<wfs:FeatureCollection xmlns:wfs='a'>", "GML"),
    "VRT of layers": (b"<OGRVRTDataSource><OGRVRTLayer", "VRT"),
    "VRT of rasters": (b'<VRTDataset rasterXSize="9" rasterYSize="9">', "VRT"),
    "GeoJSON": (b'{"type": "FeatureCollection", "features": [', "GeoJSON"),
    "Esri grid": (b"ncols         100\nnrows         100\nxllcorner     0\n", "ASCII grid"),
    "DXF": (b"  0\r\nSECTION\r\n  2\r\nHEADER\r\n", "DXF"),
    "STL": (b"solid wall\n  facet normal 0 0 1\n    outer loop\n", "STL"),
    "DC": (b"00NMSC V10-70       ABC123 12-May-26 09:30 111111\r\n", "data collector"),
    "RW5": (b"JB,NMFIELD7,DT05-12-2026,TM09:30:05\n", "Carlson"),
    "GSI-8": (b"110001+0000A110 21.324+17920860 22.324+07567500 \r\n", "GSI"),
    "GSI-16": (b"*110001+00000000000000A1 81..00+0000000580003000 \r\n", "GSI"),
    "JobXML": (XML + b'<JOBFile jobName="Field" version="5.9">', "JobXML"),
    "PRJ": (b'PROJCS["ETRS_1989_UTM_Zone_32N",GEOGCS["GCS_ETRS_1989"', ".prj"),
    "PRJ of WKT 2": (b'PROJCRS["ETRS89 / UTM zone 32N",BASEGEOGCRS["ETRS89"', ".prj"),
    "TAB": (b"!table\r\n!version 300\r\n!charset WindowsLatin1\r\n", "MapInfo"),
    "E00": (b"EXP  0 C:\\PLOTS.E00\r\nARC  2\r\n", "ArcInfo"),
    "SRT": (b"1\r\n00:00:00,000 --> 00:00:00,033\r\n<font size=", "subtitles"),
    "netCDF-4": (b"\x89HDF\r\n\x1a\n\x02\x08\x08" + NOISE, "HDF5"),
    "GeoParquet": (b"PAR1\x15\x00\x15\xa0" + NOISE, "Parquet"),
    "Javad": (b"JP055RLOGF JPS ALPHA Receiver Log File\r\n", "Javad"),
    "MRK": (b"1\t123456.789012\t[2394]\t    12,N\t   -3,E\t   180,V\t35.1,Lat", "DJI"),
}


@pytest.mark.parametrize("name", FILES)
def test_first_64_bytes__name_the_format(name: str, tmp_path: Path) -> None:
    content, words = FILES[name]
    path = tmp_path / "recording.dat"
    path.write_bytes(content[:64])
    with suppress(InputError):
        Recognised.by_content(path)  # a format that is read
        path = tmp_path / "other.dat"
    if path.exists():
        with pytest.raises(InputError, match=re.escape(words)) as refused:
            Recognised.by_content(path)
        assert refused.value.code == "unknown-format"
    kind = file_kind(content[:64])
    assert kind is not None
    assert words in str(kind.name)
    assert kind.remedy


def test_sqlite__is_named(tmp_path: Path) -> None:
    kind = file_kind(database(tmp_path)[:64])
    assert kind is not None
    assert "SQLite" in str(kind.name)


@given(st.text(st.characters(categories=["L", "N", "Zs"]), min_size=1, max_size=60))
def test_tables__are_no_other_format(text: str) -> None:
    """The first lines of tables in text are taken for none of the binary formats."""
    assert binary_kind(f"{text},1.5\r\n{text},2.5\r\n".encode()) is None
