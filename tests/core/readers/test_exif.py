"""Times and places in the EXIF data of images, as the standard (EXIF 2.32) writes them."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from furrowmap.core.readers.exif import exif_images
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.images import Images

EXIF_TAGS, GPS_TAGS = 0x8769, 0x8825
TAKEN, OFFSET, SUBSECOND, MODIFIED = 0x9003, 0x9011, 0x9291, 0x0132
TAKEN_S = dt.datetime(2026, 5, 23, 9, 41, 12, tzinfo=dt.UTC).timestamp()
WHEN = "2026:05:23 09:41:12"


def read(folder: Path, exif: dict[int, Any], gps: dict[int, Any], **other: Any) -> tuple[Images, list[Notice]]:
    image = Image.new("RGB", (4, 3))
    tags = image.getexif()
    tags.get_ifd(EXIF_TAGS).update(exif)
    tags.get_ifd(GPS_TAGS).update(gps)
    if "modified" in other:
        tags[MODIFIED] = other["modified"]
    image.save(folder / "a.jpg", exif=tags)
    return exif_images([folder / "a.jpg"])


def satellites(hours: float, minutes: float, seconds: float, day: str = "2026:05:23") -> dict[int, Any]:
    return {29: day, 7: (hours, minutes, seconds)}


@pytest.mark.parametrize(
    ("exif", "gps", "off_s", "codes"),
    [
        ({TAKEN: WHEN}, {}, 0.0, ["image-time-zone"]),
        ({TAKEN: WHEN, SUBSECOND: "25"}, {}, 0.25, ["image-time-zone"]),
        ({TAKEN: WHEN, SUBSECOND: "025"}, {}, 0.025, ["image-time-zone"]),
        ({TAKEN: WHEN, SUBSECOND: "x"}, {}, 0.0, ["image-time-zone"]),
        ({TAKEN: WHEN, OFFSET: "+09:00"}, {}, -32_400.0, []),
        ({TAKEN: WHEN, OFFSET: "-03:30"}, {}, 12_600.0, []),
        ({TAKEN: WHEN, OFFSET: "+00:00"}, satellites(7, 41, 12), 0.0, []),
        ({TAKEN: WHEN}, satellites(7, 41, 12), -7200.0, []),
        ({TAKEN: WHEN}, satellites(3, 56, 12), -20_700.0, []),
        ({TAKEN: WHEN}, satellites(7, 48, 40), -7200.0, []),
        ({TAKEN: WHEN}, satellites(7, 48, 50), -6300.0, []),
        ({TAKEN: WHEN}, satellites(23, 41, 12, "2026:05:22"), -36_000.0, []),
        ({}, satellites(9, 41, 12.5), 0.5, []),
        ({TAKEN: "0000:00:00 00:00:00"}, satellites(9, 41, 12), 0.0, []),
        ({}, {}, None, ["images-without-time"]),
        ({TAKEN: "23.05.2026"}, {29: "2026:05:23"}, None, ["images-without-time"]),
    ],
)
def test_times__are_utc_by_their_zone_or_by_the_satellites(
    exif: dict[int, Any], gps: dict[int, Any], off_s: float | None, codes: list[str], tmp_path: Path
) -> None:
    """`off_s`: from 09:41:12 UTC. The zone is a multiple of a quarter of an hour, the nearest one."""
    images, notices = read(tmp_path, exif, gps)
    assert [notice.code for notice in notices] == codes
    assert images.t_s - TAKEN_S == pytest.approx([] if off_s is None else [off_s], abs=1e-6)


def test_times__of_the_last_change_count_where_there_is_no_other(tmp_path: Path) -> None:
    images, _ = read(tmp_path, {}, {}, modified=WHEN)
    assert images.t_s.tolist() == [TAKEN_S]
    images, _ = read(tmp_path, {TAKEN: WHEN}, {}, modified="2030:01:01 00:00:00")
    assert images.t_s.tolist() == [TAKEN_S]


ANGLES = {1: "N", 2: (43.0, 30.0, 36.0), 3: "E", 4: (141.0, 15.0, 18.0)}
LAT, LON = 43.51, 141.255


@pytest.mark.parametrize(
    ("gps", "place"),
    [
        ({}, (LON, LAT, np.nan)),
        ({1: "S"}, (LON, -LAT, np.nan)),
        ({3: "W"}, (-LON, LAT, np.nan)),
        ({6: 55.5}, (LON, LAT, 55.5)),
        ({5: b"\0", 6: 55.5}, (LON, LAT, 55.5)),
        ({5: b"\1", 6: 55.5}, (LON, LAT, -55.5)),
        ({1: "s", 3: "west"}, (-LON, -LAT, np.nan)),
        ({1: ""}, (np.nan, np.nan, np.nan)),
        ({3: "5"}, (np.nan, np.nan, np.nan)),
        ({5: b"\2", 6: 55.5}, (LON, LAT, 55.5)),
        ({5: b"\3", 6: 55.5}, (LON, LAT, -55.5)),
        ({1: None}, (np.nan, np.nan, np.nan)),
        ({4: None, 6: 55.5}, (np.nan, np.nan, np.nan)),
    ],
)
def test_places__have_a_hemisphere_and_a_height_above_or_below(
    gps: dict[int, Any], place: tuple[float, ...], tmp_path: Path
) -> None:
    stated = {tag: value for tag, value in (ANGLES | gps).items() if value is not None}
    images, _ = read(tmp_path, {TAKEN: WHEN}, stated)
    np.testing.assert_allclose(images.lon_lat_h[0], place, rtol=1e-9)
