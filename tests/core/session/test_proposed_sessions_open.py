"""What `init` proposes for a recording is accepted where a run opens it, and what `inspect` notices is handed on."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from furrowmap.core.readers.hesai.captures import HESAI
from furrowmap.core.readers.reader import GivesInertial, GivesScans, GivesTrack
from furrowmap.core.readers.velodyne.captures import VELODYNE
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.examination import Examined
from furrowmap.core.session.opened import open_session
from furrowmap.core.session.proposal import FILL_IN, propose_session
from tests.conftest import SHARED_DATA
from tests.fuzz.positions import nmea
from tests.fuzz.recordings import RECORDINGS

MAX_BYTES = 4_000_000
SUFFIXES = {".bag", ".mcap", ".pcap", ".pcapng", ".osf", ".db3", ".gz", ".zst", ".csv", ".nmea", ".ubx", ".sbf", ".log"}
BESIDE = {".json", ".csv", ".xml"}
"""Metadata and calibrations, which are read beside recordings."""


def samples() -> Iterator[Path]:
    """Recordings among the samples, bags of ROS 2 as their folders."""
    names = ("foreign", "gnss", "other_lidars", "rosbag", "rover_imu", "rover_real", "velodyne")
    for path in sorted(file for name in names for file in (SHARED_DATA / name).rglob("*")):
        if path.is_dir():
            if (path / "metadata.yaml").is_file() and sum(file.stat().st_size for file in path.iterdir()) < MAX_BYTES:
                yield path
            continue
        is_alone = not (path.parent / "metadata.yaml").is_file()
        if path.suffix in SUFFIXES and is_alone and path.stat().st_size < MAX_BYTES:
            yield path


def copied(path: Path, folder: Path) -> Path:
    """The recording in a folder of its own, with what may be read beside it."""
    if path.is_dir():
        return Path(shutil.copytree(path, folder / path.name))
    for other in path.parent.iterdir():
        if other.is_file() and other.suffix in BESIDE and other.stat().st_size < MAX_BYTES:
            shutil.copyfile(other, folder / other.name)
    return Path(shutil.copyfile(path, folder / path.name))


def opens(path: Path, folder: Path) -> bool:
    """Propose a session for a recording and open all that it names; False if the recording itself cannot be used.

    What it lacks, positions or a scanner, is made.
    """
    try:
        examined = Examined.each(path)
        proposal = propose_session(examined, folder)
    except InputError:
        return False
    handed_on = {*proposal.found, *proposal.missing}
    assert all(notice in handed_on for recording in examined for notice in recording.inspection.notices)
    (folder / "made.nmea").write_bytes(nmea())
    text = proposal.text.replace(f'gnss = ["{FILL_IN}"]', 'gnss = ["made.nmea"]')
    text = text.replace(f'map = "{FILL_IN}"', 'map = "EPSG:32654"')
    if f'lidar = ["{FILL_IN}"]' in text:
        (folder / "made").mkdir(exist_ok=True)
        (seed, *_) = next(entry for entry in RECORDINGS if entry.name == "capture").seeds(folder / "made")
        name, content = next(iter(seed.items()))
        (folder / f"made_{name}").write_bytes(content)
        text = text.replace(f'lidar = ["{FILL_IN}"]', f'lidar = ["made_{name}"]')
    session_file = folder / "session.toml"
    session_file.write_text(text, encoding="utf-8")
    near_s = min(recording.first_s for recording in examined)
    near_s = near_s if near_s < 1e12 else 1.78e9
    opened = open_session(session_file)
    if any(recording.gives(GivesTrack) for recording in examined):
        opened.positions()
    if any(recording.gives(GivesInertial) for recording in examined):
        opened.inertial(near_s).inertial()
    scanned = any(recording.gives(GivesScans) for recording in examined)
    for number in range(len(opened.session.lidars) if scanned else 0):
        next(opened.lidar(near_s, number=number).scans(), None)
    return True


@pytest.mark.parametrize("path", [pytest.param(path, id=str(path.relative_to(SHARED_DATA))) for path in samples()])
def test_samples(path: Path, tmp_path: Path) -> None:
    usable = opens(copied(path, tmp_path), tmp_path)
    assert usable or not {"velodyne", "other_lidars"} & {*path.parts} or "damaged" in path.name


@pytest.mark.parametrize("entry", RECORDINGS, ids=lambda entry: entry.name)
def test_made_recordings_of_each_family(entry: object, tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    for number, files in enumerate(entry.seeds(tmp_path / "made")):  # type: ignore[attr-defined]
        folder = tmp_path / str(number)
        folder.mkdir()
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        opens(folder / next(iter(files)), folder)


@pytest.mark.parametrize("maker", [VELODYNE, HESAI], ids=lambda maker: maker.name)
def test_model_that_packets_say__is_one_that_a_session_may_state(maker: object) -> None:
    for model in maker.models:  # type: ignore[attr-defined]
        assert maker.named(model.name).name == model.name  # type: ignore[attr-defined]
