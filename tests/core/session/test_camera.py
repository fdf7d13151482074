"""The table [camera], and the images that it names."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from furrowmap.core.runtime import file_names
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.session_camera import camera_of, images_of
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.values.session import CameraSource

LEAST = 'furrowmap = 1\n[recording]\nlidar = ["a"]\ngnss = ["b"]\n[crs]\nmap = "EPSG:6677"\n'
PINHOLE = "width = 640\nheight = 480\nfx = 600.0\nfy = 600.0\ncx = 320.0\ncy = 240.0\n"
TAKEN_S = dt.datetime(2026, 5, 23, 9, 41, 12, tzinfo=dt.UTC).timestamp()


def refusal(table: str) -> InputError:
    with pytest.raises(InputError) as refused:
        parse_session(f"{LEAST}[camera]\n{table}")
    return refused.value


def test_camera__is_as_stated_in_the_names_of_opencv_or_colmap() -> None:
    stated = parse_session(f'{LEAST}[camera]\ntable = "images.csv"\n{PINHOLE}k1 = 0.1\nshutter_delay_s = 0.01\n').camera
    assert stated is not None
    camera = camera_of(stated)
    assert (camera.cx, camera.k1, camera.shutter_delay_s) == (320.0, 0.1, 0.01)
    of_colmap = CameraSource(width=640, height=480, model="simple_radial", params=(600.0, 320.5, 240.5, 0.1))
    assert camera_of(of_colmap).intrinsics == pytest.approx(camera.intrinsics)


@pytest.mark.parametrize(
    ("table", "what"),
    [
        (PINHOLE, "names no images"),
        ('table = "t.csv"\nfx = 600.0\n', "camera.width and camera.height"),
        ('table = "t.csv"\nwidth = 640\nheight = 480\nfx = 600.0\n', "camera.fy, camera.cx, camera.cy (pixels)"),
        ('table = "t.csv"\nwidth = 640\nheight = 480\nmodel = "FISHEYE"\n', "camera model 'FISHEYE' is none of"),
        (f'table = "t.csv"\n{PINHOLE}xyz_m = [-54.0, 0.0, 0.0]\n', "camera.xyz_m holds -54"),
        (f'table = "t.csv"\n{PINHOLE}k1 = nan\n', "camera.k1 must be finite"),
    ],
)
def test_camera__without_what_it_needs_is_refused(table: str, what: str) -> None:
    assert what in refusal(table).what


def folder_of_images(folder: Path, count: int) -> None:
    for k in range(count):
        Image.new("RGB", (4, 3), (k, 0, 0)).save(folder / f"{k}.jpg")


@pytest.mark.parametrize(
    ("column", "rows"),
    [
        ("time_unix_s", ["1779529272.0", "1779529273.5"]),
        ("time_gps_s", ["1463564490.0", "1463564491.5"]),
        ("time", ["2026-05-23T09:41:12", "2026-05-23T11:41:13.500+02:00"]),
    ],
)
def test_table__has_times_in_each_scale(tmp_path: Path, column: str, rows: list[str]) -> None:
    folder_of_images(tmp_path, 2)
    # In any order; a third image is missing, and a row has no time.
    text = f"file,{column}\n1.jpg,{rows[1]}\n0.jpg,{rows[0]}\nlost.jpg,{rows[0]}\n1.jpg,\n{'x' * 300}.jpg,{rows[0]}\n"
    (tmp_path / "images.csv").write_text(text, encoding="utf-8")
    source = CameraSource(table="images.csv", minus_gnss_s=2.0)
    images, notices = images_of(tmp_path / "session.toml", source)
    assert [path.name for path in images.paths] == ["0.jpg", "1.jpg"]
    assert images.t_s == pytest.approx([TAKEN_S - 2.0, TAKEN_S - 0.5], abs=1e-6)
    assert [notice.code for notice in notices] == ["rows-incomplete", "images-missing"]
    assert "2 of 4 images do not exist, the first of them 'lost.jpg'" in notices[1].text


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("file,time_unix_s\n../0.jpg,1.0\n", "session-path-outside"),
        ("file,time_unix_s\n0.jpg,soon\n", "not-a-time"),
        ("file,time_unix_s\n0.jpg,inf\n", "not-a-time"),
        ("file,when\n0.jpg,1.0\n", "missing-column"),
        ("", "missing-column"),
    ],
)
def test_table__that_cannot_be_used_is_refused(tmp_path: Path, text: str, code: str) -> None:
    (tmp_path / "images.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        images_of(tmp_path / "session.toml", CameraSource(table="images.csv"))
    assert refused.value.code == code


def test_table__larger_than_any_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from furrowmap.core.readers import image_table

    monkeypatch.setattr(image_table, "MAX_TABLE_BYTES", 10)
    (tmp_path / "images.csv").write_text("file,time_unix_s\n", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        images_of(tmp_path / "session.toml", CameraSource(table="images.csv"))
    assert refused.value.code == "not-a-table"


def photo(path: Path, taken: str | None, zone: str | None = None, gps: dict[int, object] | None = None) -> None:
    """A JPEG with EXIF data."""
    image, exif = Image.new("RGB", (4, 3)), Image.Exif()
    if taken is not None:
        exif.get_ifd(0x8769)[0x9003] = taken
        exif.get_ifd(0x8769)[0x9291] = "25"
    if zone is not None:
        exif.get_ifd(0x8769)[0x9011] = zone
    exif.get_ifd(0x8825).update(gps or {})
    image.save(path, exif=exif)


def test_exif__has_times_in_their_zone_and_positions(tmp_path: Path) -> None:
    gps = {1: "N", 2: (55.0, 20.0, 30.0), 3: "W", 4: (11.0, 23.0, 6.0), 5: b"\1", 6: 12.5}
    photo(tmp_path / "1_zone.jpg", "2026:05:23 11:41:12", "+02:00", gps)
    photo(tmp_path / "2_gps.jpg", "2026:05:23 18:41:13", None, {7: (9.0, 41.0, 14.0), 29: "2026:05:23"})
    photo(tmp_path / "3_bare.jpg", "2026:05:23 09:41:14")
    photo(tmp_path / "4_satellites.jpg", None, None, {7: (9.0, 41.0, 20.0), 29: "2026:05:23"})
    photo(tmp_path / "5_none.jpg", None)
    (tmp_path / "6_damaged.jpg").write_bytes(b"\xff\xd8\xff\xe0 no image")
    images, notices = images_of(tmp_path / "session.toml", CameraSource(files=("*.jpg", "1_zone.jpg")))
    assert images.t_s - TAKEN_S == pytest.approx([0.25, 1.25, 2.25, 8.0])
    assert images.lon_lat_h[0] == pytest.approx([-(11 + 23 / 60 + 6 / 3600), 55 + 20 / 60 + 30 / 3600, -12.5])
    assert np.isnan(images.lon_lat_h[1:]).all()
    assert {notice.code for notice in notices} == {"images-unreadable", "images-without-time", "image-time-zone"}
    assert all("1 of 6 images" in notice.text for notice in notices)


@pytest.mark.parametrize("source", [CameraSource(files=("../*.jpg",)), CameraSource(table="../images.csv")])
def test_images__outside_the_folder_of_the_session_are_refused(tmp_path: Path, source: CameraSource) -> None:
    folder_of_images(tmp_path, 1)
    (tmp_path / "images.csv").write_text("file,time_unix_s\n", encoding="utf-8")
    (tmp_path / "session").mkdir()
    with pytest.raises(InputError) as refused:
        images_of(tmp_path / "session" / "session.toml", source)
    assert refused.value.code == "session-path-outside"


@pytest.mark.parametrize(
    "pattern", ["../*.jpg", "../../../../**/*.jpg", "/**/*.jpg", "C:/*.jpg", "out/*.jpg", "o*/*.jpg", "a/../../*.jpg"]
)
def test_promise_23__patterns_stay_in_the_folder_of_the_session(tmp_path: Path, pattern: str) -> None:
    for name in ("other", "session"):
        (tmp_path / name).mkdir()
        folder_of_images(tmp_path / name, 1)
    (tmp_path / "session" / "out").symlink_to(tmp_path / "other")
    with pytest.raises(InputError, match="is outside the session's folder"):
        images_of(tmp_path / "session" / "session.toml", CameraSource(files=(pattern,)))


def test_promise_23__patterns_search_so_many_files_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_names, "MAX_ENTRIES", 50)
    for k in range(60):
        (tmp_path / f"{k}").mkdir()
    with pytest.raises(InputError, match="looked for among more than") as refused:
        images_of(tmp_path / "session.toml", CameraSource(files=("**/*.jpg",)))
    assert refused.value.code == "session-path-outside"


@pytest.mark.parametrize("pattern", ["*.jpg", "*/*.jpg", "**/*.jpg", "**/[0-1].jpg", "a/b/?.jpg", "**/b/**/0.jpg"])
def test_patterns__match_as_those_of_pathlib(tmp_path: Path, pattern: str) -> None:
    for name in ("a/b", "ab", "c/b/d"):
        (tmp_path / name).mkdir(parents=True)
        folder_of_images(tmp_path / name, 2)
    folder_of_images(tmp_path, 3)
    assert file_names.matching(tmp_path, pattern) == sorted(tmp_path.glob(pattern))


@pytest.mark.parametrize(
    "source",
    [
        CameraSource(table="lost.csv"),
        CameraSource(table="x" * 300),
        CameraSource(files=("lost.jpg",)),
        CameraSource(files=("*.png",)),
    ],
)
def test_images__that_do_not_exist_are_told(tmp_path: Path, source: CameraSource) -> None:
    images, notices = images_of(tmp_path / "session.toml", source)
    assert len(images) == 0
    assert {notice.code for notice in notices} == {"images-missing"}


def test_both_keys__add_up(tmp_path: Path) -> None:
    folder_of_images(tmp_path, 1)
    photo(tmp_path / "p.jpeg", "2026:05:23 09:41:11", "Z")
    (tmp_path / "images.csv").write_text(f"file,time_unix_s\n0.jpg,{TAKEN_S}\n", encoding="utf-8")
    images, _ = images_of(tmp_path / "session.toml", CameraSource(table="images.csv", files=("*.jpeg",)))
    assert [path.name for path in images.paths] == ["p.jpeg", "0.jpg"]


def test_images__of_the_trial(shared_data: Path) -> None:
    file = shared_data / "uav_wheat" / "session.toml"
    stated = parse_session(file.read_text("utf-8")).camera
    assert stated is not None
    images, notices = images_of(file, stated)
    assert (len(images), notices) == (106, [])
    assert np.diff(images.t_s) == pytest.approx(1.0, abs=1e-6)
    assert camera_of(stated).matrix[0, 2] == 402.7
