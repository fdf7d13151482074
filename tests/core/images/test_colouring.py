"""Colours of points and of orthophotos, against the texture that the frames were rendered from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.images import colouring
from furrowmap.core.images.colouring import NO_FRAME, ColourMaker, Colours
from furrowmap.core.images.image_frames import Frames, frames_along
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.images import Images
from furrowmap.core.values.trajectory import trajectory_from_attitude

from .scenes import BOARD_LEVELS, HEIGHT_M, VIGNETTING, behind_board, cloud, frames_above, texture

ORIGIN_M = (400.0, 300.0, 50.0)
PLACES = np.array([[x, y] for x in (-3.0, -1.0, 1.0, 3.0) for y in (-1.5, 1.5)])
GAINS = np.array([0.1, -0.1, 0.05, 0.0, -0.05, 0.08, -0.12, 0.04])


def moved(frames: Frames) -> Frames:
    """The frames where the coordinates are not small."""
    return replace(frames, poses=replace(frames.poses, xyz_m=frames.poses.xyz_m + ORIGIN_M))


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Frames:
    return moved(frames_above(tmp_path_factory.mktemp("frames"), PLACES, GAINS))


@pytest.fixture(scope="module")
def colours(frames: Frames) -> Colours:
    maker = ColourMaker(frames, ORIGIN_M)
    for part in np.array_split(np.concatenate(cloud()), 7):
        maker.add(part)
    made = maker.finish()
    assert made.notices == ()
    return made


def test_balance__is_that_of_the_frames(colours: Colours) -> None:
    assert colours.balance.corner == pytest.approx(1.0 - np.exp(sum(VIGNETTING)), abs=0.015)
    gain = colours.balance.gain - colours.balance.gain.mean(axis=0)
    assert gain == pytest.approx(np.repeat((GAINS - GAINS.mean())[:, None], 3, axis=1), abs=0.01)


def test_colours__are_those_of_the_ground_but_for_the_noise(colours: Colours) -> None:
    """The mean gain of all frames cannot be told from the brightness of the ground."""
    ground, board = cloud()
    rgb, frame = colours.of_points(ground, np.full(len(ground), np.nan))
    seen = frame != NO_FRAME
    assert seen.mean() > 0.9
    off = rgb[:, seen].T / 257.0 / np.exp(GAINS.mean()) - texture(ground[seen, :2])
    # Noise of one level, brightened at most 1.25 times by the balance, and 40 cm waves through pixels of 4 cm.
    assert np.sqrt((off**2).mean()) < 2.0
    assert abs(off.mean()) < 0.7
    of_board, frame = colours.of_points(board, np.full(len(board), np.nan))
    inside = (np.abs(board[:, 0]) < 0.7) & (np.abs(board[:, 1]) < 0.5)
    assert (frame[inside] != NO_FRAME).all()
    assert of_board[:, inside].T / 257.0 / np.exp(GAINS.mean()) == pytest.approx(
        np.repeat([BOARD_LEVELS], inside.sum(), axis=0), abs=8.0
    )


def test_colours__come_from_no_frame_that_does_not_see_the_point(colours: Colours, frames: Frames) -> None:
    ground, _ = cloud()
    rgb, frame = colours.of_points(ground, np.full(len(ground), np.nan))
    centres = frames.poses.xyz_m - ORIGIN_M
    hidden = np.column_stack([behind_board(ground, centre) for centre in centres])
    given = frame != NO_FRAME
    assert not hidden[given, frame[given]].any()
    assert (rgb[:, given] > 0).all()
    # Where some frame sees the ground well beside the board, it has a colour; below its middle none has.
    assert given[(np.abs(ground[:, 0]) > 2.0)].all()
    everywhere_hidden = hidden.all(axis=1)
    assert everywhere_hidden.sum() > 30
    assert (rgb[:, everywhere_hidden] == 0).all()


def test_colours__are_of_the_nearest_frame_in_space_and_time(colours: Colours, frames: Frames) -> None:
    ground, _ = cloud()
    aside = ground[np.abs(ground[:, 0]) > 2.0]
    _, frame = colours.of_points(aside, np.full(len(aside), np.nan))
    apart = np.linalg.norm(aside[:, None, :2] - (frames.poses.xyz_m - ORIGIN_M)[:, :2], axis=2)
    chosen = np.take_along_axis(apart, frame[:, None], 1)[:, 0]
    assert (chosen <= apart.min(axis=1) + 0.05).all()
    # In the middle between two frames the one nearer in time is taken.
    middle = np.array([[3.0, 0.0, 0.0]])
    later = [colours.of_points(middle, np.array([t_s]))[1][0] for t_s in (6.0, 7.0)]
    assert later == [6, 7]


def test_orthophoto__is_the_ground_where_any_frame_sees_it(colours: Colours, frames: Frames) -> None:
    wide = Grid(0.2, 1975, 1520, (40, 50))  # 10 m x 8 m around the origin
    height = np.full(wide.shape, ORIGIN_M[2], np.float32)
    height[:3] = np.nan
    part = Grid(0.2, 1976, 1519, (38, 48))
    finer = colours.pixels_a_cell(wide.cell_m)
    assert finer == 5  # pixels of 3.6 cm on the ground
    picture = colours.orthophoto(wide, height, part, finer, ORIGIN_M)
    assert picture.shape == (4, 190, 240)
    rgb, seen = picture[:3], picture[3] == 255
    assert not seen[:10].any()
    pixels = Grid(0.04, 9880, 7595, seen.shape)
    xy = pixels.positions_m().reshape(*seen.shape, 2) - ORIGIN_M[:2]
    beside = np.abs(xy[..., 0]) > 2.0
    inside = seen & beside
    assert inside.sum() > 0.8 * (beside & (np.abs(xy[..., 1]) < 3.0) & (np.abs(xy[..., 0]) < 4.5))[10:].sum()
    off = rgb[:, inside].T / np.exp(GAINS.mean()) - texture(xy[inside])
    assert np.sqrt((off**2).mean()) < 2.0
    assert (rgb[:, ~seen] == 0).all()
    fine = Grid(0.05, 7980, 6020, (40, 40))  # 2 m x 2 m around the origin
    middle = np.pad(fine.positions_m() - ORIGIN_M[:2], ((0, 0), (0, 1)))
    hidden = np.all([behind_board(middle, centre) for centre in frames.poses.xyz_m - ORIGIN_M], axis=0)
    assert hidden.sum() > 20
    flat = np.full(fine.shape, ORIGIN_M[2], np.float32)
    assert not colours.orthophoto(fine, flat, fine, 1, ORIGIN_M)[3].ravel()[hidden].any()


def test_large_images__are_reduced(frames: Frames, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(colouring, "MAX_PIXEL_BYTES", 8 * 3 * 200 * 150 // 3)
    maker = ColourMaker(frames, ORIGIN_M)
    ground, board = cloud()
    maker.add(np.concatenate([ground, board]))
    reduced = maker.finish()
    assert (reduced.pixels.reduction, reduced.pixels.rgb.shape) == (2, (8, 75, 100, 3))
    rgb, frame = reduced.of_points(ground, np.full(len(ground), np.nan))
    beside = (frame != NO_FRAME) & (np.abs(ground[:, 0]) > 2.0)
    off = rgb[:, beside].T / 257.0 / np.exp(GAINS.mean()) - texture(ground[beside, :2])
    assert np.sqrt((off**2).mean()) < 2.5


def test_images__that_cannot_be_read_are_counted_and_left_out(frames: Frames, tmp_path: Path) -> None:
    cut, small = tmp_path / "cut.png", tmp_path / "small.png"
    cut.write_bytes(frames.paths[0].read_bytes()[:2000])
    from PIL import Image

    Image.new("RGB", (20, 15)).save(small)
    damaged = replace(frames, paths=(cut, small, *frames.paths[2:]))
    maker = ColourMaker(damaged, ORIGIN_M)
    ground, board = cloud()
    maker.add(np.concatenate([ground, board]))
    colours = maker.finish()
    (notice,) = colours.notices
    assert notice.code == "images-not-decoded"
    assert "2 of 8 images" in notice.text
    _, frame = colours.of_points(ground, np.full(len(ground), np.nan))
    assert not np.isin(frame, (0, 1)).any()
    assert (frame != NO_FRAME).mean() > 0.6


def test_frames__outside_the_trajectory_are_counted(frames: Frames) -> None:
    trajectory = trajectory_from_attitude(
        np.array([0.0, 10.0]), np.array([[0.0, 0.0, 6.0], [10.0, 0.0, 6.0]]), 0.0, 0.0, 90.0, max_gap_s=20.0
    )
    camera = Camera(200, 150, 165.0, 165.0, 101.0, 74.0)
    images = Images.sorted([Path(f"{k}.jpg") for k in range(4)], np.array([-1.0, 1.0, 2.0, 11.0]))
    found, notices = frames_along(images, camera, trajectory, 1.0)
    assert found is not None
    assert [path.name for path in found.paths] == ["1.jpg", "2.jpg"]
    assert [notice.code for notice in notices] == ["images-without-pose"]
    assert "2 of 4 images" in notices[0].text
    assert frames_along(images.earlier_by(1000.0), camera, trajectory, 1.0)[0] is None
    assert len(frames.selected([1, 3])) == 2
    assert frames.poses.xyz_m[0, 2] - ORIGIN_M[2] == HEIGHT_M
