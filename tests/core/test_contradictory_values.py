"""Values that contradict themselves cannot be made, and nothing in gives nothing out."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from pyproj import CRS

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.images.image_frames import FramePoses, Frames
from furrowmap.core.readers.nmea.sentences import Sentences
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.spinning.packet_decoder import PacketDecoder
from furrowmap.core.readers.states_csv import StatesCsv
from furrowmap.core.readers.velodyne.captures import VELODYNE
from furrowmap.core.runtime import npz
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.npz import read_npz
from furrowmap.core.runtime.packed import packed, unpacked
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.surfaces.gaps import bridged, filled
from furrowmap.core.surfaces.ground_filter import Smrf, classify_ground, cloth_ground, ground_cells
from furrowmap.core.surfaces.outliers import mean_distance_to, mean_neighbour_distance, radius_outliers, tiles
from furrowmap.core.trajectory.used_positions import fixes_from_labels
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.crs import datum_shift_m
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.images import Images
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import AttitudeTrack, MountMotion
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Crs
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import Poses

ONE, TWO, THREE = (np.arange(n, dtype=np.float64) for n in (1, 2, 3))


def scan(**changes: Any) -> Scan:
    few = np.zeros(2, np.uint8)
    usual: dict[str, Any] = {
        "number": 0, "t_s": TWO, "xyz_m": np.zeros((2, 3), np.float32), "intensity": few, "laser": few,
        "column": few.astype(np.uint16), "return_number": few, "returns": few,
    }  # fmt: skip
    return Scan(**(usual | changes))


def velodyne(payloads: Any, host_s: Any) -> object:
    return PacketDecoder(VELODYNE).push(np.array(payloads), np.array(host_s))


def with_head(value: Any) -> bytes:
    head = msgspec.msgpack.encode(value)
    return len(head).to_bytes(8, "little") + head


CAMERA = Camera(640, 480, 600.0, 600.0, 320.0, 240.0)


def frames(images: int, poses: int, lost: int | None = None) -> Frames:
    xyz = np.zeros((poses, 3))
    xyz[lost if lost is not None else poses :] = np.nan
    turned = np.repeat(np.eye(3)[None], poses, axis=0)
    return Frames((Path("a"),) * images, CAMERA, FramePoses(np.arange(float(poses)), xyz, turned))


def states(begin_s: Any, end_s: Any, confidence: Any = TWO) -> ToolStates:
    return ToolStates(np.array(begin_s), np.array(end_s), np.zeros(2, np.int8), confidence, TWO, TWO)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: InertialTrack(TWO, np.zeros((2, 3)), np.zeros((3, 3))), "has shape"),
        (lambda: InertialTrack(TWO[::-1], np.zeros((2, 3)), np.zeros((2, 3))), "does not increase"),
        (lambda: AttitudeTrack(TWO, TWO, THREE, TWO), "has shape"),
        (lambda: AttitudeTrack(TWO, TWO, TWO, THREE), "has shape"),
        (lambda: AttitudeTrack(np.zeros(2), TWO, TWO, TWO), "does not increase"),
        (lambda: MountMotion(TWO, np.zeros((3, 4))), r"shape \(3, 4\), not \(2, 4\)"),
        (lambda: MountMotion(TWO[::-1], np.zeros((2, 4))), "does not increase"),
        (lambda: MountMotion(ONE, np.zeros((1, 4))), "does not increase"),
        (lambda: Mounting((0.0, np.nan, 0.0)), "finite numbers"),
        (lambda: Mounting(rpy_deg=(0.0, 0.0, np.inf)), "finite numbers"),
        (lambda: scan(laser=np.zeros(3, np.uint8)), "laser"),
        (lambda: scan(xyz_m=np.zeros((2, 2), np.float32)), "xyz_m has shape"),
        (lambda: states([0.0, 1.0], [1.0, 2.0], THREE), "confidence has shape"),
        (lambda: states([0.0, 1.0], [0.0, 2.0]), "ends before it begins"),
        (lambda: states([0.0, 1.0], [1.5, 2.0]), "overlap"),
        (lambda: Smrf(slope=0.0), "above zero"),
        (lambda: Smrf(cell_m=np.nan), "above zero"),
        (lambda: mean_neighbour_distance(np.zeros((4, 3)), reach_m=0.0), "neighbours"),
        (lambda: list(tiles(np.zeros((4, 3)), 2.0, 2.5)), "a margin of 2.5 m round squares of 2.0 m"),
        (lambda: list(tiles(np.zeros((4, 3)), 2.0, -0.1)), "a margin"),
        (lambda: unpacked(with_head(msgspec.msgpack.Ext(2, b"")), np.ndarray), "unknown code 2"),
        (lambda: velodyne(np.zeros(1206, np.uint8), [0.0]), "must be"),
        (lambda: velodyne([np.zeros(1206, np.uint8)], [0.0, 1.0]), "must be"),
        (lambda: cloth_ground(np.array([[0.0, 0.0, np.nan]])), "not finite"),
        (lambda: unpacked(with_head(1)[:-1], int), "the head is cut off"),
        (lambda: replace(CAMERA, fx=0.0), "focal lengths above 0"),
        (lambda: replace(CAMERA, fy=-1.0), "focal lengths above 0"),
        (lambda: replace(CAMERA, width=0), "focal lengths above 0"),
        (lambda: replace(CAMERA, height=-1), "focal lengths above 0"),
        (lambda: replace(CAMERA, cx=np.nan), "finite numbers"),
        (lambda: replace(CAMERA, k1=np.inf), "finite numbers"),
        (lambda: replace(CAMERA, xyz_m=(0.0, np.nan, 0.0)), "finite numbers"),
        (lambda: replace(CAMERA, rpy_deg=(np.inf, 0.0, 0.0)), "finite numbers"),
        (lambda: replace(CAMERA, shutter_delay_s=np.nan), "finite numbers"),
        (lambda: Images((Path("a"),), TWO, np.zeros((1, 3)), np.zeros((1, 3))), "Images has 1 paths"),
        (lambda: Images((Path("a"), Path("b")), TWO, np.zeros((2, 2)), np.zeros((2, 3))), "Images has 2 paths"),
        (lambda: Images((Path("a"), Path("b")), TWO[::-1], np.zeros((2, 3)), np.zeros((2, 3))), "decreases"),
        (lambda: frames(2, 3), "a pose for each image"),
        (lambda: frames(3, 3, lost=1), "a pose for each image"),
    ],
)
def test_values__that_contradict_themselves(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_nothing__gives_nothing() -> None:
    assert cloth_ground(np.zeros((0, 3))).tolist() == []
    assert list(tiles(np.zeros((0, 3)), 2.0, 1.0)) == []
    assert radius_outliers(np.zeros((0, 3))).tolist() == []
    assert mean_distance_to(np.zeros((2, 3)), np.zeros((0, 3)), 1.0).tolist() == [np.inf, np.inf]
    assert not ground_cells(np.full((3, 3), np.nan), Smrf()).any()
    assert filled(np.array([[5.0]])).tolist() == [[5.0]]
    nowhere = Poses(np.full((2, 3), np.nan), np.full((2, 4), np.nan))
    assert np.isnan(nowhere.attitude_deg()).tolist() == [[True, True]] * 3
    assert len(Sentences.joined([])) == 0
    frame = map_frame(Crs(map="EPSG:6677"))
    assert [len(axis) for axis in frame.project(TWO[:0], TWO[:0])] == [0, 0]
    assert classify_ground(np.full((3, 3), np.nan)).tolist() == [False] * 3


def test_packed__numbers_come_back_and_other_types_of_arrays_do_not() -> None:
    assert unpacked(b"".join(packed({"a": np.float64(1.5), "b": np.int64(-3)})), dict) == {"a": 1.5, "b": -3}
    inner = msgspec.msgpack.encode(("|O8", (1,), 0))
    with pytest.raises(ValueError, match="unknown type of array"):
        unpacked(with_head(msgspec.msgpack.Ext(1, inner)) + bytes(8), np.ndarray)
    for begin, words in ((2**64 - 1, "beyond the end"), (-1, ">= 0")):
        beyond = msgspec.msgpack.encode(("<f8", (1,), begin))
        with pytest.raises(ValueError, match=words):
            unpacked(with_head(msgspec.msgpack.Ext(1, beyond)) + bytes(8), np.ndarray)


def test_npz__that_is_damaged(tmp_path: Path) -> None:
    """Behind a directory that is whole: a header of another kind, and an array shorter than it says."""
    path = tmp_path / "a.npz"
    path.write_bytes(b"PK no archive")
    with pytest.raises(ValueError, match="not a zip file"):
        read_npz(path)
    whole = io.BytesIO()
    np.save(whole, THREE)
    for content in (b"\x93NUMPX" + whole.getvalue()[6:], whole.getvalue()[:-8], b""):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("three.npy", content)
        with pytest.raises(ValueError, match=r"^three\.npy: "):
            read_npz(path)


def test_npz__of_too_many_arrays(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **{f"a{k}": ONE for k in range(npz.MAX_ARRAYS + 1)})
    with pytest.raises(ValueError, match="1,001 arrays"):
        read_npz(tmp_path / "a.npz")


LEAST = 'furrowmap = 1\n[recording]\nlidar = ["a.pcap"]\ngnss = ["a.nmea"]\n[crs]\nmap = "EPSG:6677"\n'
TOOL = "[implement]\nwidth_m = 1.7\nxy_m = [0, 0]\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LEAST + 'parameters = "a.par"\n', "crs.parameters needs crs.coordinates = 'current-epoch'"),
        (LEAST + 'geoid_grid = "a.tif"\n', "crs.geoid_grid needs heights above a geoid"),
        (LEAST + "[lidar]\nrpy_walk_deg_rts = 0.01\n", "lidar.rpy_walk_deg_rts needs [imu] and no [implement]"),
        (LEAST.replace('lidar = ["a.pcap"]\n', "") + TOOL + 'states = ["s.csv"]\nstates_use = "check"\n',
         "implement.states_use is 'check', which needs recording.lidar"),
        (LEAST + "[imu]\nfiles = []\n", "imu.files names no file"),
        (LEAST + '[imu]\nfiles = ["a"]\nclass = "best"\n', "imu.class must be one of consumer, industrial, tactical"),
        (LEAST + "[trajectory]\nfiles = []\n", "trajectory.files names no file"),
        (LEAST + TOOL + "region_m = [1, -1, -1, 1]\n", "each minimum below its maximum"),
        (LEAST.replace('"a.nmea"', '"a.nmea", "./a.nmea"'), "recording.gnss names 'a.nmea' twice"),
        (LEAST.replace("[crs]", 'date = "2026-13-01"\n[crs]'), "recording.date must be a date"),
    ],
)  # fmt: skip
def test_session__whose_keys_contradict_each_other(text: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        parse_session(text)
    assert (error.value.code, words in error.value.what) == ("session-value", True)


def test_fixes__by_name() -> None:
    assert fixes_from_labels(("fixed", "single")) == (Fix.FIXED, Fix.SINGLE)
    with pytest.raises(InputError, match="'rtk'"):
        fixes_from_labels(("fixed", "rtk"))


def test_states__blank_lines_are_passed_over_and_impossible_times_are_not(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text("t_s,state\n\n100,down\n , \n200,up\n", encoding="utf-8")
    assert StatesCsv([path], ReadOptions()).states().begin_s.tolist() == [100.0, 200.0]
    for wrong in ("-1", "1e12", "inf"):
        path.write_text(f"t_s,state\n{wrong},down\n", encoding="utf-8")
        with pytest.raises(InputError, match=f"line 2: the time is '{wrong}'"):
            StatesCsv([path], ReadOptions()).states()
    path.write_text("t_s,state\n", encoding="utf-8")
    assert StatesCsv([path], ReadOptions()).inspect().facts["intervals"] == 0


def test_gaps__of_a_grid_that_has_none_or_nothing_else_stay() -> None:
    full, empty = np.arange(6.0).reshape(2, 3), np.full((2, 3), np.nan)
    assert filled(full).tolist() == full.tolist()
    assert np.isnan(bridged(empty, 5.0)).all()
    assert bridged(full, 5.0).tolist() == full.tolist()


def test_datum__is_told_by_its_distance() -> None:
    """The Tokyo datum is some 450 m from WGS 84 in Tokyo; JGD2011 is within a metre or two."""
    assert datum_shift_m(CRS("EPSG:4301"), 139.75, 35.68) == pytest.approx(450.0, abs=30.0)
    shift_m = datum_shift_m(CRS("EPSG:6668"), 139.75, 35.68)
    assert shift_m is not None
    assert shift_m < 2.0
