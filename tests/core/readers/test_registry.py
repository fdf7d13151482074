"""Every sample file finds its reader by content, or is refused in three sentences."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from furrowmap.core.readers.reader import ReadOptions, Recognised, open_recording, readers
from furrowmap.core.runtime.errors import InputError

# Files of the folder gnss that are NMEA 0183; the suffix of the others shows their reader.
NMEA = (
    *("nmea/*", "clas/*.nmea", "car_reference/*.nmea"),
    *("walk_f9p/walk.nmea", "walk_f9p/walk_raw_mixed.log"),
)

OWN = {".ubx": "ubx", ".sbf": "sbf", ".pos": "rtklib-pos", ".gps": "novatel"}


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def refused(path: Path) -> InputError:
    """The error with which a file is refused."""
    with pytest.raises(InputError) as error:
        Recognised.by_content(path).inspect()
    assert all(error.value.lines), path
    assert path.name in error.value.what
    return error.value


def test_readers__are_all_found_and_named_apart() -> None:
    formats = [reader.format for reader in readers()]
    assert {"nmea", "pose-csv", "sbet", "velodyne-pcap", "rosbag1", "rosbag2"} <= set(formats)
    assert len(formats) == len(set(formats))


def test_gnss_samples__are_reported_or_refused(shared_data: Path) -> None:
    folder = shared_data / "gnss"
    nmea = {path for pattern in NMEA for path in folder.glob(pattern)}
    assert len(nmea) == 21 + 2 + 1 + 2
    for path in files(folder):
        if path in nmea or path.suffix.lower() in OWN:
            assert Recognised.by_content(path).reader.format == OWN.get(path.suffix.lower(), "nmea"), path
        elif path.name == "reference.csv":  # its columns have other names than ours and mean the same
            assert Recognised.by_content(path).reader.format == "pose-csv", path
        else:
            assert refused(path).code in ("unknown-format", "missing-column"), path


@pytest.mark.parametrize("folder", ["geo"])
def test_samples_of_other_kinds__are_refused(folder: str, shared_data: Path) -> None:
    for path in files(shared_data / folder):
        assert refused(path).code in ("unknown-format", "empty-file", "missing-column"), path


def test_binary_logs__with_a_stray_sentence_are_no_nmea(shared_data: Path) -> None:
    for name in ("ubx/mixed_ubx_nmea_rtcm3.ubx", "ubx/mixed_many_messages.ubx", "sbf/mixed.sbf"):
        assert b"$GN" in (shared_data / "gnss" / name).read_bytes()
        assert Recognised.by_content(shared_data / "gnss" / name).reader.format == name[:3]


@pytest.mark.parametrize(
    ("name", "format_"),
    [
        ("gnss/walk_f9p/walk.ubx", "ubx"),
        ("gnss/sbf/x5pvt.sbf", "sbf"),
        ("gnss/sbf/x5_measurements.sbf", "sbf"),
        ("gnss/pos/static_rtk.pos", "rtklib-pos"),
        ("gnss/pos/car_f9p_rtklibpy_weektow.pos", "rtklib-pos"),
        ("gnss/walk_f9p/walk_raw_mixed.log", "nmea"),
        ("gnss/nmea/f9p_nmea_in_binary.log", "nmea"),
    ],
)
def test_receivers_own_formats__have_their_readers(name: str, format_: str, shared_data: Path) -> None:
    assert Recognised.by_content(shared_data / name).reader.format == format_


@pytest.mark.parametrize(("start", "words"), [(b"\xb5\x62", "UBX"), (b"$@", "SBF")])
def test_receivers_own_formats__without_an_intact_message_are_named(start: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(start + bytes(range(200)))
    error = refused(tmp_path / "log")
    assert words in error.what
    assert "Export NMEA 0183 (GGA, RMC, GST)" in error.remedy


def test_promise_02__other_formats_are_named(shared_data: Path, tmp_path: Path) -> None:
    (tmp_path / "base.rtcm3").write_bytes(bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98"))
    assert "RTCM 3" in refused(tmp_path / "base.rtcm3").what
    (tmp_path / "SemiDyna2026.par").write_text("for SemiDynaEXE    Ver.1.0.0\n")
    assert "Name it in a session under [crs]" in refused(tmp_path / "SemiDyna2026.par").remedy


def test_folder__without_a_bag_is_reported_as_one(tmp_path: Path) -> None:
    (tmp_path / "field").mkdir()
    error = refused(tmp_path / "field")
    assert (error.code, "is a folder without a ROS 2 bag" in error.what) == ("unknown-format", True)


@pytest.mark.parametrize(
    ("name", "format_"),
    [
        ("tractor_loop/gnss.nmea", "nmea"),
        ("gnss/nmea/f9p_nmea_in_binary.log", "nmea"),
        ("tractor_loop/truth/trajectory.csv", "pose-csv"),
        ("sbet/flight_derived.sbet", "sbet"),
        ("velodyne/vlp16_single_gps.pcap", "velodyne-pcap"),
    ],
)
def test_promise_02__content_decides_and_not_the_name(
    name: str, format_: str, shared_data: Path, tmp_path: Path
) -> None:
    for suffix in ("", ".dat", ".pcap", ".nmea", ".csv"):
        copy = tmp_path / f"recording{suffix}"
        shutil.copyfile(shared_data / name, copy)
        assert Recognised.by_content(copy).reader.format == format_
        copy.unlink()


def test_recording__of_two_kinds_is_refused(shared_data: Path) -> None:
    loop = shared_data / "tractor_loop"
    with pytest.raises(InputError) as error:
        open_recording([loop / "gnss.nmea", loop / "truth/trajectory.csv"], ReadOptions())
    assert error.value.code == "mixed-formats"
