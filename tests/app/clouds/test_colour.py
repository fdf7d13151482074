"""Any cloud in the colours of a session's images, against the texture that these were rendered from."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, RefusedError
from tests.core.images.scenes import CAMERA, HEIGHT_M, behind_board, cloud, frames_above, texture

CORNER_M = np.array([500_000.0, 5_900_000.0, 0.0])
PLACES = np.array([[-2.0, -1.0], [-1.0, 0.5], [0.5, 1.0], [2.0, -1.0]])

SESSION = """\
furrowmap = 1
[recording]
lidar = ["cloud.laz"]
[crs]
map = "EPSG:25832"
[trajectory]
files = ["trajectory.csv"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("colour")
    frames = frames_above(folder, PLACES, np.zeros(len(PLACES)))
    seconds = np.arange(-1.0, 4.05, 0.1)
    at = np.column_stack([np.interp(seconds, np.arange(4.0), axis) for axis in PLACES.T]) + CORNER_M[:2]
    rows = np.column_stack([1_779_529_272.0 + seconds, at, np.full(len(at), HEIGHT_M), np.zeros((len(at), 2))])
    rows = np.column_stack([rows, np.full(len(at), 90.0)])
    head = "time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg"
    np.savetxt(folder / "trajectory.csv", rows, "%.4f", ",", header=head, comments="")
    listed = [f"{path.name},{1_779_529_272 + k}" for k, path in enumerate(frames.paths)] + ["late.png,1779530000"]
    (folder / "late.png").write_bytes(frames.paths[0].read_bytes())
    (folder / "images.csv").write_text("\n".join(["file,time_unix_s", *listed, ""]), encoding="utf-8")
    intrinsics = "".join(f"{name} = {getattr(CAMERA, name)}\n" for name in ("fx", "fy", "cx", "cy", "k1", "k2"))
    camera = f'[camera]\ntable = "images.csv"\nwidth = {CAMERA.width}\nheight = {CAMERA.height}\n{intrinsics}'
    (folder / "session.toml").write_text(f"{SESSION}{camera}rpy_deg = [180.0, 0.0, 0.0]\n", encoding="utf-8")
    (folder / "bare.toml").write_text(SESSION, encoding="utf-8")
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.add_crs(CRS("EPSG:25832"))
    header.scales, header.offsets = np.full(3, 0.001), CORNER_M
    las = laspy.LasData(header)
    las.xyz = np.concatenate(cloud()) + CORNER_M
    las.write(folder / "cloud.laz")
    return folder


def test_cloud__has_the_colours_of_what_the_images_show(folder: Path) -> None:
    out = folder / "coloured.copc.laz"
    answer = furrowmap.colour(folder / "cloud.laz", folder / "session.toml", out)
    las = laspy.read(out)
    assert las.header.point_format.id == 7
    xyz, rgb = np.asarray(las.xyz) - CORNER_M, np.column_stack([las.red, las.green, las.blue])
    has = (rgb > 0).any(axis=1)
    assert answer["figures"]["points_coloured"] == has.sum()
    assert answer["figures"]["points_not_seen"] == (~has).sum()
    assert [warning["code"] for warning in answer["warnings"]] == [
        "images-not-adjusted",  # the trajectory is stated
        "images-without-pose",
    ]
    ground = has & (xyz[:, 2] < 0.1)
    beside = ground & (np.abs(xyz[:, 0]) > 1.5)
    off = rgb[beside] / 257.0 - texture(xyz[beside, :2])
    assert np.sqrt((off**2).mean()) < 2.5
    hidden = np.all([behind_board(xyz, np.array([*place, HEIGHT_M])) for place in PLACES], axis=0)
    assert hidden.sum() > 30
    assert not has[hidden].any()
    with pytest.raises(RefusedError) as refused:
        furrowmap.colour(folder / "cloud.laz", folder / "session.toml", out)
    assert refused.value.code == "output-exists"


def test_command__writes_what_the_function_writes(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "coloured.copc.laz"
    words = ["colour", str(folder / "cloud.laz"), str(folder / "session.toml"), "-o", str(out)]
    assert command_line([*words, "--json"]) == 0
    answer = json.loads(capfd.readouterr().out)
    shares: dict[str, list[float]] = {}

    def told(stage: str, share: float) -> None:
        shares.setdefault(stage, []).append(share)

    same = tmp_path / "same.copc.laz"
    by_function = furrowmap.colour(folder / "cloud.laz", folder / "session.toml", same, progress=told)
    assert "reading images" in shares
    for each in shares.values():
        assert each == sorted(each)
        assert 0.0 <= each[0] <= each[-1] <= 1.0
    assert answer["figures"] == by_function["figures"]
    assert np.array_equal(laspy.read(out).points.array, laspy.read(tmp_path / "same.copc.laz").points.array)
    assert command_line(words) == 4, "the file exists"
    capfd.readouterr()
    assert command_line([*words, "--overwrite"]) == 0
    assert "points coloured" in capfd.readouterr().out


def test_cloud__without_a_camera_or_images_is_refused(folder: Path) -> None:
    with pytest.raises(InputError) as refused:
        furrowmap.colour(folder / "cloud.laz", folder / "bare.toml", folder / "no.copc.laz")
    assert refused.value.code == "no-camera"
    text = (folder / "session.toml").read_text("utf-8").replace("images.csv", "lost.csv")
    (folder / "lost.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        furrowmap.colour(folder / "cloud.laz", folder / "lost.toml", folder / "no.copc.laz")
    assert refused.value.code == "no-images"
    assert "'lost.csv'" in refused.value.meaning
    assert not (folder / "no.copc.laz").exists()
