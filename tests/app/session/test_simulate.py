"""A simulation appears whole in its folder, or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import furrowmap
from furrowmap.core.runtime.errors import Cancelled, InputError
from tests.one_pass import SCENARIO


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "scenario.toml"
    path.write_text(SCENARIO)
    return path


def impatient(stage: str, share: float) -> None:
    if stage == "lidar" and share > 0.2:
        raise Cancelled


def test_stopped_half_way__leaves_no_folder(scenario: Path, tmp_path: Path) -> None:
    with pytest.raises(Cancelled):
        furrowmap.simulate(scenario, tmp_path / "drive", progress=impatient)
    assert list(tmp_path.iterdir()) == [scenario]


def test_over_an_earlier_one__replaces_it_as_a_whole_and_leaves_other_files(scenario: Path, tmp_path: Path) -> None:
    first = furrowmap.simulate(scenario, tmp_path / "drive")
    (first.folder / "notes.txt").write_text("mine")
    before = contents(first.folder)
    scenario.write_text(SCENARIO.replace("seed = 5", "seed = 6"))
    with pytest.raises(Cancelled):
        furrowmap.simulate(scenario, first.folder, overwrite=True, progress=impatient)
    assert contents(first.folder) == before
    again = furrowmap.simulate(scenario, first.folder, overwrite=True)
    after = contents(first.folder)
    assert after.keys() == before.keys()
    same = {name for name in after if after[name] == before[name]}
    assert same == {"notes.txt", "session.toml", "boundary.geojson"}
    assert again.session.is_file()
    assert again.recording.is_file()


@pytest.mark.parametrize("kind", ["file", "link"])
def test_no_folder_for_the_truth__is_refused_before_anything_is_replaced(
    scenario: Path, tmp_path: Path, kind: str
) -> None:
    drive, elsewhere = tmp_path / "drive", tmp_path / "elsewhere"
    for folder in (drive, elsewhere):
        folder.mkdir()
    if kind == "file":
        (drive / "truth").write_text("mine")
    elif os.name == "nt":
        pytest.skip("links need rights on Windows")
    else:
        (drive / "truth").symlink_to(elsewhere)
    with pytest.raises(InputError) as caught:
        furrowmap.simulate(scenario, drive, overwrite=True)
    assert caught.value.code == "output-no-folder"
    assert [path.name for path in drive.iterdir()] == ["truth"]
    assert not list(elsewhere.iterdir())


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
