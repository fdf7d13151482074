"""Every sample recording is inspected or refused in three sentences, without any other exception."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import pytest

from furrowmap.core.readers.reader import GivesScans, Inspection, ReadOptions, Recognised, open_recording
from furrowmap.core.runtime.errors import InputError

SHARED_DATA = Path(__file__).resolve().parents[4] / "shared" / "data"


def samples(folder: str) -> list[Path]:
    """Files of a folder of samples, and folders that are a bag."""
    paths = (SHARED_DATA / folder).rglob("*")
    return sorted(path for path in paths if path.is_file() or (path / "metadata.yaml").is_file())


@cache
def inspected(path: Path) -> Inspection | InputError:
    try:
        return Recognised.by_content(path).inspect()
    except InputError as error:
        return error


@pytest.mark.parametrize(
    ("folder", "there", "readable"),
    [
        ("velodyne", 16, 12),
        ("other_lidars/hesai", 8, 4),
        ("other_lidars/velodyne_vls128", 3, 1),
        ("other_lidars/ouster", 11, 4),
        ("rosbag", 15, 15),
        ("gnss", 60, 66),
        ("las", 71, 45),
    ],
)
def test_every_sample_is_inspected_or_refused(shared_data: Path, folder: str, there: int, readable: int) -> None:
    paths = samples(folder)
    assert len(paths) >= there
    read = 0
    for path in paths:
        answer = inspected(path)
        if isinstance(answer, InputError):
            assert all(line.strip() and "\n" not in line for line in answer.lines), path
            continue
        read += 1
        assert answer.facts, path
        for clock in answer.clocks:
            assert math.isfinite(clock.first_s), path
            assert clock.first_s <= clock.last_s, path
        assert all(notice.code and notice.text.strip() for notice in answer.notices), path
    assert read >= readable


SCANNERS = ("velodyne", "other_lidars", "rosbag", "foreign/22-ouster-init-model-Ouster")


@pytest.mark.parametrize("folder", SCANNERS)
def test_model__that_inspect_names_is_one_that_a_session_may_state(shared_data: Path, folder: str) -> None:
    """`init` writes it into the session."""
    named = 0
    for path in samples(folder):
        answer = inspected(path)
        if isinstance(answer, InputError):
            continue
        scans = answer.facts.get("scans")
        facts = scans if isinstance(scans, dict) else answer.facts
        source = next(iter(facts.get("sensors") or [None]))
        reader = open_recording([path], ReadOptions(model=facts.get("model"), source=source))
        if not isinstance(reader, GivesScans) or answer.facts.get("scans") == "none":
            continue
        assert len(next(reader.scans())), path
        named += facts.get("model") is not None
    assert named or "foreign" in folder
