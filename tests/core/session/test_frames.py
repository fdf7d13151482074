"""The frames of a session: transforms against matrices multiplied by hand, and the words for axes."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.session.frame_tree import direction_words
from furrowmap.exporters.reports.frame_drawing import LINE_HEIGHT


def matrix(xyz_m: tuple[float, ...], rpy_deg: tuple[float, ...]) -> np.ndarray:
    out = np.eye(4)
    turns = [Rotation.from_euler(axis, angle, degrees=True) for axis, angle in zip("xyz", rpy_deg, strict=True)]
    out[:3, :3], out[:3, 3] = (turns[2] * turns[1] * turns[0]).as_matrix(), xyz_m
    return out


def test_between__is_the_product_of_the_mountings(shared_data: Path) -> None:
    tree = furrowmap.frames(shared_data / "uav_wheat" / "session.toml")
    lidar = matrix((0.0, 0.013, -0.304), (-90.0, 33.99, -90.0))
    imu = matrix((-0.039, -0.008, -0.294), (180.0, 0.0, 0.0))
    relative = np.linalg.inv(imu) @ lidar
    found = tree.between("lidar_link", "imu_link")
    assert found.xyz_m == pytest.approx(relative[:3, 3])
    assert found.rotation == pytest.approx(relative[:3, :3])
    assert tree.between("base_link", "base_link").rotation == pytest.approx(np.eye(3))
    with pytest.raises(ValueError, match="needs a time"):
        tree.between("lidar_link", "map")
    with pytest.raises(KeyError, match="no frame 'radar'"):
        tree["radar"]


def test_flight__has_the_frames_of_rep_105(shared_data: Path, capfd: pytest.CaptureFixture[str]) -> None:
    session = str(shared_data / "uav_wheat" / "session.toml")
    assert command_line(["frames", session]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert [line.split(":")[0].strip(" └├│─") for line in lines] == [
        *("earth", "map", "base_link", "gnss_link", "imu_link", "lidar_link", "camera_optical_frame")
    ]
    assert "(x forward, y right, z down)" in lines[4]
    assert command_line(["frames", session, "--json"]) == 0
    frames = {frame["name"]: frame for frame in json.loads(capfd.readouterr().out)["frames"]}
    assert frames["camera_optical_frame"]["parent"] == "base_link"
    assert frames["imu_link"]["quaternion_xyzw"] == pytest.approx([1.0, 0.0, 0.0, 0.0])
    assert frames["map"]["xyz_m"] is None


def test_tractor__has_an_implement(shared_data: Path) -> None:
    tree = furrowmap.frames(shared_data / "tractor_loop" / "session.toml")
    assert tree["implement_link"].pose is not None
    assert tree["base_link"].words.endswith("moves as positions show")
    assert "rear axle" in tree["base_link"].words
    assert "rpy" not in tree.text.splitlines()[-1]


def test_svg__draws_each_frame_at_its_place(shared_data: Path, tmp_path: Path) -> None:
    for name in ("uav_wheat", "tractor_loop"):
        tree = furrowmap.frames(shared_data / name / "session.toml", tmp_path / "frames.svg")
        root = ET.parse(tmp_path / "frames.svg").getroot()
        space = {"s": "http://www.w3.org/2000/svg"}
        labels = [text.text for text in root.findall("s:text", space)]
        points = [(float(c.attrib["cx"]), float(c.attrib["cy"])) for c in root.findall("s:circle", space)]
        names = [frame.name for frame in tree.frames[2:]]
        assert [label for label in labels if label in names] == names * 2
        assert len(points) == 2 * len(names)
        named = [text for text in root.findall("s:text", space) if text.text in names]
        for view in (named[: len(names)], named[len(names) :]):
            at = np.array([[float(text.attrib[key]) for key in "xy"] for text in view])
            across, down = np.abs(at[:, None] - at)[*np.triu_indices(len(at), 1)].T
            assert ((across >= 150.0) | (down >= LINE_HEIGHT)).all(), "no label covers another"
            assert (np.abs(at[0] - points[0 if view[0] is named[0] else len(names)]) < 7.0).all(), "it is at its point"
        side = np.array(points[: len(names)])
        places = np.array([tree.between(frame, "base_link").xyz_m for frame in names])[:, [0, 2]]
        scale = np.polyfit(places[:, 0], side[:, 0], 1)[0]
        assert side - side[0] == pytest.approx((places - places[0]) * (scale, -scale), abs=0.2)
        width, height = (float(root.attrib[key]) for key in ("width", "height"))
        assert all(0 < x < width and 0 < y < height for x, y in points)


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ((0.0, 0.0, -1.0), "down"),
        ((np.cos(0.5), 0.0, np.sin(0.5)), "28.6° from forward towards up"),
        ((0.0, -1.0, 0.0), "right"),
    ],
)
def test_directions__are_named(direction: tuple[float, ...], words: str) -> None:
    assert direction_words(np.array(direction)) == words


def test_session_without_recordings__is_shown(tmp_path: Path) -> None:
    text = 'furrowmap = 1\n[recording]\nlidar = ["a"]\ngnss = ["b"]\n[crs]\nmap = "EPSG:6677"\n[attitude]\n'
    (tmp_path / "s.toml").write_text(f'{text}roll_pitch = "c"\nheading = "c"\n', encoding="utf-8")
    tree = furrowmap.frames(tmp_path / "s.toml")
    assert {"ahrs_link", "compass_link", "gnss_link"} <= {frame.name for frame in tree.frames}
    assert "not stated" in tree["gnss_link"].words
    assert tree["base_link"].words.startswith("the vehicle's origin;")
    assert tree["base_link"].words.endswith("moves as positions and attitude logs show")
    stated = text.removesuffix("[attitude]\n") + '[trajectory]\nfiles = ["c"]\n'
    (tmp_path / "s.toml").write_text(stated.replace('gnss = ["b"]\n', ""), encoding="utf-8")
    tree = furrowmap.frames(tmp_path / "s.toml")
    assert tree["base_link"].words.endswith("moves as [trajectory] show")
    assert "gnss_link" not in {frame.name for frame in tree.frames}
