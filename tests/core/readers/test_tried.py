"""What the page says of real files: they are there, they have that format, and their numbers are those of the lists."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.readers.las.cloud import open_cloud
from furrowmap.core.readers.reader import ReadOptions, Recognised, open_recording
from furrowmap.core.session.examination import devices

TRIED = {device["name"]: device["tried"] for device in devices()}
NMEA, UBX = "NMEA 0183 (with GNS, PASHR, PUBX)", "u-blox UBX"
SBF, NOVATEL = "Septentrio SBF", "NovAtel OEM6, OEM7, SPAN; Unicore UM98x"
OUSTER = "Ouster OS0, OS1, OS2, OSDome"


@pytest.mark.parametrize(
    ("device", "words", "kind", "number", "files"),
    [
        (NMEA, "21 logs", "nmea", 21, "gnss/nmea/*"),
        (UBX, "11 logs", "ubx", 10, "gnss/ubx/*"),
        (UBX, "11 logs", "ubx", 1, "gnss/walk_f9p/*.ubx"),
        (SBF, "19 files", "sbf", 19, "gnss/sbf/*"),
        (NOVATEL, "the same BESTPOS 1,000 times", "novatel", 1, "gnss/novatel/*"),
        ("Velodyne VLP-16, Puck LITE, Puck Hi-Res", "3 recordings", "velodyne-pcap", 5, "velodyne/vlp16_*.pcap*"),
        ("Velodyne VLP-16, Puck LITE, Puck Hi-Res", "a drive of 161 s", "velodyne-pcap", 1, "rover_real/*.pcap.gz"),
        ("Velodyne VLP-32C, HDL-32E", "a bag of a VLP-32C", "rosbag2", 1, "rosbag/vlp32c_*/*.db3"),
        ("Velodyne VLS-128", "a bag of 3.6 turns", "rosbag2", 1, "other_lidars/velodyne_vls128/*.db3"),
        ("Hesai PandarXT-16, PandarXT-32", "a bag of each", "rosbag2", 2, "other_lidars/hesai/*/*.db3"),
        (OUSTER, "OS0-32 (firmware 2.2)", "ouster-pcap", 4, "other_lidars/ouster/*.pcap"),
        ("Livox, RoboSense, and other clouds in bags", "3 bags with clouds", "rosbag1", 1, "rosbag/leo_*.bag"),
        ("Livox, RoboSense, and other clouds in bags", "3 bags with clouds", "rosbag2", 2, "rosbag/leo_*/leo_*"),
    ],
)  # fmt: skip
def test_samples__are_as_many_files_as_stated(
    shared_data: Path, device: str, words: str, kind: str, number: int, files: str
) -> None:
    assert words in TRIED[device]
    paths = sorted(path for path in shared_data.glob(files) if path.suffix != ".yaml")
    assert len(paths) == number
    for path in paths:
        if path.name != "bad.sbf":
            assert Recognised.by_content(path).reader.format == kind, path


def elsewhere(shared_data: Path) -> list[tuple[str, str, str]]:
    """Repository, file and what was found, of each real file that was compared outside the tests."""
    text = (shared_data / "README-tried-elsewhere.md").read_text(encoding="utf-8")
    cells = [[cell.strip() for cell in line.split("|")] for line in text.splitlines() if line.count("|") == 4]
    return [(row[1], row[2], row[3]) for row in cells if row[1] not in {"repository", "---"}]


@pytest.mark.parametrize(
    ("device", "words", "repository", "found"),
    [
        (NMEA, "{} of gpsd's tests", "gpsd", "nmea,"),
        (NMEA, "{} of other projects", "", "equal to pynmeagps"),
        (UBX, "{} of gpsd's tests", "gpsd", "ubx,"),
        (UBX, "{} of the tests of pyubx2 and pygnssutils", "semuconsulting", "equal to pyubx2"),
        (NOVATEL, "{} files of OEMV, OEM6, OEM7 and SPAN", "", "novatel,"),
        (OUSTER, "{} OSF files", "ouster-sdk", ""),
    ],
)
def test_files_elsewhere__are_as_many_as_stated(
    shared_data: Path, device: str, words: str, repository: str, found: str
) -> None:
    rows = [row for row in elsewhere(shared_data) if repository in row[0] and found in row[2]]
    if device == OUSTER:
        rows = [row for row in rows if row[1].endswith(".osf") and re.match(r"[\d,]+", row[2])]
    assert words.format(len(rows)) in TRIED[device]


def test_hesai__points_are_those_of_the_list(shared_data: Path) -> None:
    numbers = {}
    for repository, path, found in elsewhere(shared_data):
        if "nebula" in repository and (match := re.match(r"([\d,]+) points; all = own decode by nebula", found)):
            numbers[path.rpartition("/")[2]] = match[1]
    assert len(numbers) == 6
    assert TRIED["Hesai PandarXT-16, PandarXT-32"].endswith(f"{numbers['xt16']} and {numbers['xt32']} points")
    several = sorted(
        (numbers[name] for name in ("40p", "64", "qt64", "xt32m")), key=lambda text: int(text.replace(",", ""))
    )
    assert f"{several[0]} to {several[-1]} points" in TRIED["Hesai PandarXT-32M, PandarQT64, Pandar40P, Pandar64"]


def test_hesai__bags_have_the_points_of_the_list(shared_data: Path) -> None:
    for name, points in (("xt16", 86_761), ("xt32", 252_132)):
        (path,) = (shared_data / "other_lidars" / "hesai" / name).glob("*.db3")
        scans = open_recording([path], ReadOptions()).scans()  # type: ignore[attr-defined]
        assert sum(len(scan) for scan in scans) == points


def test_pcd__five_files_of_other_drivers(shared_data: Path) -> None:
    paths = [*shared_data.glob("velodyne/*.pcd"), *shared_data.glob("other_lidars/**/*.pcd")]
    assert len(paths) == 5
    for path in paths:
        head, _, body = path.read_bytes().partition(b"DATA binary\n")
        entries = {line.split()[0]: line.split()[1:] for line in head.decode().splitlines()[1:]}
        kinds = {"F": "f", "U": "u", "I": "i"}
        types = [f"<{kinds[kind]}{size}" for kind, size in zip(entries["TYPE"], entries["SIZE"], strict=True)]
        rows = np.frombuffer(body, list(zip(entries["FIELDS"], types, strict=True)), int(entries["POINTS"][0]))
        found = np.concatenate([batch.xyz_m for batch in open_cloud(path).batches()])
        assert np.array_equal(found, np.column_stack([rows[axis] for axis in "xyz"]))
