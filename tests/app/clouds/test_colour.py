"""Any cloud in the colours of a session's images, against the texture that these were rendered from."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.core.runtime.errors import InputError, RefusedError
from tests.app.clouds.coloured_scene import CORNER_M, PLACES, write_scene
from tests.core.images.scenes import HEIGHT_M, behind_board, texture


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("colour"))


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
