"""Positions and times of exposures in XMP: in the forms of DJI and Pix4D, beside and without `.MRK` files and EXIF."""

import datetime as dt
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, PngImagePlugin, TiffImagePlugin

from furrowmap.core.readers.exif import exif_images
from furrowmap.core.readers.image_xmp import MAX_XMP_BYTES, NOTHING, exposure_xmp
from furrowmap.core.values.images import Images
from tests.core.readers.test_exposure_marks import EXIF, FIRST, TAKEN, line

GPS = 0x8825
HEAD = '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n<x:xmpmeta xmlns:x="adobe:ns:meta/">'
RDF = 'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
DJI = 'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'
PIX4D = 'xmlns:Camera="http://pix4d.com/camera/1.0"'
SAID = {
    "AbsoluteAltitude": "+103.250",
    "GpsLatitude": "+35.0001000",
    "GpsLongitude": "+139.0002000",
    "RtkFlag": "50",
    "RtkStdLon": "0.01100",
    "RtkStdLat": "0.01200",
    "RtkStdHgt": "0.02500",
}
PLACE = (139.0002, 35.0001, 103.25)
SIGMA_M = (0.011, 0.012, 0.025)


def attributes(said: dict[str, str], prefix: str = "drone-dji", space: str = DJI) -> bytes:
    words = " ".join(f'{prefix}:{name}="{value}"' for name, value in said.items())
    body = f'<rdf:RDF {RDF}><rdf:Description rdf:about="DJI Meta Data" {space} {words}/></rdf:RDF>'
    return f'{HEAD}{body}</x:xmpmeta>\n<?xpacket end="w"?>\0\0'.encode()


def elements(said: dict[str, str], prefix: str = "drone-dji", space: str = DJI) -> bytes:
    words = "".join(f"<{prefix}:{name}>{value}</{prefix}:{name}>\n" for name, value in said.items())
    body = f"<rdf:RDF {RDF}><rdf:Description {space}>\n{words}</rdf:Description></rdf:RDF>"
    return f'{HEAD}{body}</x:xmpmeta>\n<?xpacket end="w"?>'.encode()


def image(path: Path, packet: bytes, after_s: int | None = 0) -> Path:
    """An image file with EXIF of Tokyo's time, 100 m off in place, and a packet of XMP."""
    picture = Image.new("RGB", (4, 3))
    tags = picture.getexif()
    if after_s is not None:
        taken = FIRST + dt.timedelta(hours=9, seconds=after_s)
        tags.get_ifd(EXIF)[TAKEN] = f"{taken:%Y:%m:%d %H:%M:%S}"
    tags.get_ifd(GPS).update({1: "N", 2: (35.0, 0.0, 0.0), 3: "E", 4: (139.0, 0.0, 0.0), 5: b"\0", 6: 99.0})
    if path.suffix == ".JPG":
        picture.save(path, exif=tags, xmp=packet)
    elif path.suffix == ".png":
        info = PngImagePlugin.PngInfo()
        info.add_itxt("XML:com.adobe.xmp", packet.decode())
        picture.save(path, exif=tags, pnginfo=info)
    else:
        info_tiff = TiffImagePlugin.ImageFileDirectory_v2()
        info_tiff[700] = packet
        info_tiff.tagtype[700] = 1
        picture.save(path, exif=tags, tiffinfo=info_tiff)
    return path


def read(paths: list[Path]) -> tuple[Images, dict[str, str]]:
    images, notices = exif_images(paths)
    return images, {notice.key: notice.text for notice in notices}


@pytest.mark.parametrize("suffix", [".JPG", ".png", ".tif"])
@pytest.mark.parametrize("form", [attributes, elements])
def test_positions_and_sigmas__are_those_of_xmp(
    tmp_path: Path, suffix: str, form: Callable[[dict[str, str]], bytes]
) -> None:
    timed = SAID | {"UTCAtExposure": "2026-05-12T09:30:05.432100"}
    images, notices = read([image(tmp_path / f"DJI_0001{suffix}", form(timed))])
    assert images.t_s[0] - FIRST.timestamp() == pytest.approx(0.4321, abs=1e-5)
    assert images.lon_lat_h[0] == pytest.approx(PLACE)
    assert images.sigma_m[0] == pytest.approx(SIGMA_M)
    assert "1 of 1 image has" in notices["images-marked.xmp"]
    assert "1 of fixed solutions, with standard deviations of 0.012 m" in notices["images-marked.xmp"]


@pytest.mark.parametrize(
    ("said", "fixed"), [({"RtkFlag": "34"}, False), ({"RtkFlag": "16"}, False), ({"RtkFlag": "63"}, True)]
)
def test_flag__says_what_solution_it_is(said: dict[str, str], fixed: bool) -> None:
    found = exposure_xmp(attributes(SAID | said))
    assert (found.lon_lat_h, found.is_fixed) == (PLACE, fixed)


def test_misspelt_longitude_of_early_firmware__is_read() -> None:
    said = {("GpsLongtitude" if name == "GpsLongitude" else name): value for name, value in SAID.items()}
    assert exposure_xmp(attributes(said)).lon_lat_h == PLACE


@pytest.mark.parametrize(
    "said",
    [{"RtkFlag": "0"}, {"RtkFlag": ""}, {"GpsLatitude": "0.0", "GpsLongitude": "0.0"}, {"GpsLatitude": "north"}],
)
def test_without_rtk__the_place_of_exif_stays(tmp_path: Path, said: dict[str, str]) -> None:
    images, notices = read([image(tmp_path / "DJI_0001.JPG", attributes(SAID | said))])
    assert images.lon_lat_h[0] == pytest.approx((139.0, 35.0, 99.0))
    assert np.isnan(images.sigma_m).all()
    assert "images-marked.xmp" not in notices


def test_exposure_time_of_xmp__replaces_that_of_exif_that_agrees(tmp_path: Path) -> None:
    timed = SAID | {"UTCAtExposure": "2026-05-12T09:30:05.432100"}
    images, notices = read([image(tmp_path / "DJI_0001.JPG", attributes(timed))])
    assert images.t_s[0] - FIRST.timestamp() == pytest.approx(0.4321, abs=1e-5)
    assert "image-time-zone" not in notices
    far, _ = read([image(tmp_path / "DJI_0002.JPG", attributes(timed), after_s=100)])
    assert far.lon_lat_h[0] == pytest.approx((139.0, 35.0, 99.0))


def test_exposure_time_of_xmp__serves_without_exif(tmp_path: Path) -> None:
    timed = SAID | {"UTCAtExposure": "2026-05-12T09:30:05.432100"}
    images, _ = read([image(tmp_path / "DJI_0001.JPG", attributes(timed), after_s=None)])
    assert images.t_s[0] - FIRST.timestamp() == pytest.approx(0.4321, abs=1e-5)


def test_marks_beside_images__come_before_xmp(tmp_path: Path) -> None:
    paths = [image(tmp_path / f"DJI_000{n}.JPG", attributes(SAID), after_s=n) for n in (1, 2)]
    (tmp_path / "Timestamp.MRK").write_text(line(1, 1.25))
    images, notices = read(paths)
    assert images.t_s[0] - FIRST.timestamp() == pytest.approx(1.25, abs=1e-6)
    assert images.lon_lat_h[:, 2] == pytest.approx([101.0, 103.25])
    assert images.sigma_m[:, 0] == pytest.approx([0.013456, 0.011])
    assert {"images-marked", "images-marked.xmp"} <= set(notices)
    assert "1 of 2 images" in notices["images-marked.xmp"]


def test_accuracies_of_pix4d__are_of_the_place_in_exif(tmp_path: Path) -> None:
    packet = elements({"GPSXYAccuracy": "0.03", "GPSZAccuracy": "0.05"}, "Camera", PIX4D)
    images, _ = read([image(tmp_path / "IMG_0001.JPG", packet)])
    assert images.lon_lat_h[0] == pytest.approx((139.0, 35.0, 99.0))
    assert images.sigma_m[0] == pytest.approx((0.03, 0.03, 0.05))


@pytest.mark.parametrize(
    "packet",
    [
        b"",
        b"\xff\xfe<",
        attributes(SAID)[:300],
        b"<!DOCTYPE x [<!ENTITY a '99'>]>" + attributes(SAID),
        b"<a>" * 1000,
        attributes(SAID | {"note": "x" * MAX_XMP_BYTES}),
    ],
)
def test_damaged_or_hostile_packets__say_nothing(packet: bytes) -> None:
    assert exposure_xmp(packet) == NOTHING
    assert math.isnan(NOTHING.lon_lat_h[0])
