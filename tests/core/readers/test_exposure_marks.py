"""Exposure times beside the images of DJI's drones, in the form of their user manuals."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from furrowmap.core.readers.exif import exif_images
from furrowmap.core.readers.exposure_marks import read_marks
from furrowmap.core.values.images import Images

EXIF = 0x8769
TAKEN = 0x9003
SUBSECOND = 0x9291
GPS_EPOCH = dt.datetime(1980, 1, 6, tzinfo=dt.UTC)
FIRST = dt.datetime(2026, 5, 12, 9, 30, 5, tzinfo=dt.UTC)
LEAP_S = 18


def line(number: int, after_s: float, quality: int = 50) -> str:
    gps_s = (FIRST - GPS_EPOCH).total_seconds() + LEAP_S + after_s
    week, second = divmod(gps_s, 604_800)
    place = f"35.{number:08d},Lat\t139.{number:08d},Lon\t{100 + number:.3f},Ellh"
    tail = f"0.012345, 0.013456, 0.034567\t{quality},Q"
    return f"{number}\t{second:.6f}\t[{week:.0f}]\t   -12,N\t    34,E\t   193,V\t{place}\t{tail}\n"


def image(path: Path, taken: dt.datetime | str | None) -> Path:
    picture = Image.new("RGB", (4, 3))
    tags = picture.getexif()
    if taken is not None:
        text = taken if isinstance(taken, str) else f"{taken:%Y:%m:%d %H:%M:%S}"
        tags.get_ifd(EXIF)[TAKEN] = text
    picture.save(path, exif=tags)
    return path


def read(paths: list[Path]) -> tuple[Images, dict[str, str]]:
    images, notices = exif_images(paths)
    return images, {notice.key: notice.text for notice in notices}


@pytest.mark.parametrize(
    ("name", "marks"),
    [
        ("DJI_20260512093005_{:04d}_D.JPG", "DJI_202605120930_001_Timestamp.MRK"),
        ("100_0004_{:04d}.JPG", "100_0004_Timestamp.MRK"),
        ("DJI_{:04d}.JPG", "Timestamp.mrk"),
    ],
)
@pytest.mark.parametrize("hours", [0, 9, -3.5])
def test_times__are_those_of_the_exposures(name: str, marks: str, hours: float, tmp_path: Path) -> None:
    """EXIF has whole seconds of local time, and no zone."""
    after_s = [0.31, 2.874563, 5.4]
    numbers = [3, 4, 7]
    paths = [
        image(tmp_path / name.format(n), FIRST + dt.timedelta(hours=hours, seconds=int(s)))
        for n, s in zip(numbers, after_s, strict=True)
    ]
    (tmp_path / marks).write_text("".join(line(n, s) for n, s in zip([1, *numbers], [-9.0, *after_s], strict=True)))
    images, notices = read(paths[::-1])
    assert images.t_s - FIRST.timestamp() == pytest.approx(after_s, abs=1e-6)
    assert images.lon_lat_h[:, 2].tolist() == [103.0, 104.0, 107.0]
    assert list(notices) == ["images-marked"]
    assert "3 of 3 images" in notices["images-marked"]


def test_times__of_another_flight_are_not_taken(tmp_path: Path) -> None:
    paths = [image(tmp_path / f"DJI_{n:04d}.JPG", FIRST + dt.timedelta(seconds=100 + n)) for n in (1, 2)]
    (tmp_path / "Timestamp.MRK").write_text(line(1, 0.5) + line(2, 1.5))
    images, notices = read(paths)
    assert (images.t_s - FIRST.timestamp()).tolist() == [101.0, 102.0]
    assert "2 of 2 images" in notices["images-marked.contradicted"]


def test_two_flights__in_a_folder_are_told_by_their_names(tmp_path: Path) -> None:
    paths = [image(tmp_path / f"100_000{f}_0001.JPG", FIRST + dt.timedelta(seconds=60 * f)) for f in (1, 2)]
    for flight in (1, 2):
        (tmp_path / f"100_000{flight}_Timestamp.MRK").write_text(line(1, 60 * flight + 0.25, 16))
    images, notices = read(paths)
    assert images.t_s - FIRST.timestamp() == pytest.approx([60.25, 120.25], abs=1e-6)
    assert "0 of fixed" in notices["images-marked"]


def test_images_without_exif__have_the_time_of_their_mark(tmp_path: Path) -> None:
    (tmp_path / "a_Timestamp.MRK").write_text(line(1, 0.5))
    images, _ = read([image(tmp_path / "a_0001.JPG", None)])
    assert images.t_s - FIRST.timestamp() == pytest.approx([0.5], abs=1e-6)


@pytest.mark.parametrize("text", ["", "1\t2\t3\n", "\0" * 100, "a\t" + line(1, 0.0), line(1, 0.0)[:60]])
def test_damaged_marks__are_left_out(text: str, tmp_path: Path) -> None:
    (tmp_path / "Timestamp.MRK").write_text(text)
    assert read_marks(tmp_path / "Timestamp.MRK") == {}


def test_mark_without_position__has_a_time_alone(tmp_path: Path) -> None:
    text = line(1, 0.5, 0).replace("35.00000001", "0.00000000").replace("139.00000001", "0.00000000")
    (tmp_path / "Timestamp.MRK").write_text(text)
    mark = read_marks(tmp_path / "Timestamp.MRK")[1]
    assert mark.t_s == pytest.approx(FIRST.timestamp() + 0.5, abs=1e-6)
    assert not np.isfinite(mark.lon_lat_h).any()


@pytest.mark.parametrize("text", ["", "1;5.0;[2418.5];35.1;139.1\n", None])
def test_marks__that_no_image_uses_are_noticed(text: str | None, tmp_path: Path) -> None:
    """A file of another form, and one of another flight."""
    path = image(tmp_path / "DJI_0001.JPG", FIRST)
    (tmp_path / "Timestamp.MRK").write_text(line(7, 0.0) if text is None else text)
    _, notices = read([path])
    assert "Timestamp.MRK" in notices["images-marked.unused"]


def test_fraction__behind_the_seconds_of_exif(tmp_path: Path) -> None:
    images, _ = read([image(tmp_path / "a.JPG", "2026:05:12 09:30:05.25")])
    assert images.t_s - FIRST.timestamp() == pytest.approx([0.25], abs=1e-6)


def test_fraction__of_a_sample(shared_data: Path) -> None:
    path = shared_data / "foreign" / "20-header-words" / "taken_frac.jpg"
    if not path.is_file():
        pytest.skip("the sample inputs of other software are not beside this checkout")
    images, _ = read([path])
    assert images.t_s.tolist() == [FIRST.timestamp() + 0.25]


def test_marks__that_a_link_brings_from_another_folder_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "other.MRK").write_text(line(1, 0.5))
    (tmp_path / "images" / "Timestamp.MRK").symlink_to(tmp_path / "other.MRK")
    images, notices = read([image(tmp_path / "images" / "DJI_0001.JPG", FIRST)])
    assert images.t_s.tolist() == [FIRST.timestamp()]
    assert "images-marked" not in notices


@pytest.mark.parametrize(
    ("old", "new"), [("50,Q", "5" * 5000 + ",Q"), ("1\t", "1" * 5000 + "\t"), ("[", "[" + "9" * 400)]
)
def test_endless_numbers__count_for_nothing(old: str, new: str, tmp_path: Path) -> None:
    path = tmp_path / "a.MRK"
    path.write_text(line(1, 0.5).replace(old, new, 1) + line(2, 1.5))
    marks = read_marks(path)
    assert 2 in marks
    assert not any(mark.is_fixed for number, mark in marks.items() if number != 2)
