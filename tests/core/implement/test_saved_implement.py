"""The implement carried from one session to the next: whoever names it gets the states that this recording hides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from furrowmap.core.coverage.field_work import ImplementTracker
from furrowmap.core.implement.saved import load_implement, save_implement
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.values.session import Session
from furrowmap.core.values.tool_states import ToolState
from furrowmap.core.values.trajectory import trajectory_from_attitude
from tests.core.implement.conftest import MOUNTING, T0_S, Scene

SESSION = """
furrowmap = 1
recording = { lidar = ["a.pcap"], gnss = ["a.nmea"] }
crs = { map = "EPSG:6677" }
implement = { width_m = 1.7, xy_m = [-1.9, 0.0], working_depth_m = 0.12 }
lidar = { xyz_m = [-0.63, 0.04, 2.42], rpy_deg = [0.8, 40.0, 179.3] }
"""


@pytest.fixture(scope="module")
def session() -> Session:
    return parse_session(SESSION)


def seen_through(session: Session, scene: Scene, path: Path | None) -> ImplementTracker:
    watch = ImplementTracker(session, [load_implement(path)] if path is not None else [])
    scans = [scan for scan in scene.scans() if scan.t_s[0] > T0_S + 7.9]
    for scan in scans:
        watch.add_scan(scan)
    t_s = np.arange(0.0, 20.0) + T0_S
    along = np.column_stack([t_s - T0_S, 0 * t_s, 0 * t_s])
    watch.learn(trajectory_from_attitude(t_s, along, 0.0, 0.0, 90.0 + 0 * t_s, max_gap_s=2.0))
    for _ in watch.following(scans):
        pass
    return watch


def test_saved_implement__tells_a_session_without_transitions_what_the_tool_does(
    watch: Callable[..., Any], session: Session, tmp_path: Path
) -> None:
    learned = watch().learned.implement
    save_implement(tmp_path / "implement.npz", learned)
    scene = replace(Scene(), duration_s=16.0, lowered_s=(2.0,), lifted_s=(30.0,))  # at work all along
    assert MOUNTING.rpy_deg == session.lidar.rpy_deg
    alone = seen_through(session, scene, None)._tools[0].learned
    assert alone.implement is None
    assert [notice.code for notice in alone.notices] == ["implement-never-moves"]
    found = seen_through(session, scene, tmp_path / "implement.npz")
    assert [notice.code for notice in found._tools[0].learned.notices] == ["implement-from-earlier"]
    assert found._tools[0].heights is not None
    heights = found._tools[0].heights.heights()
    assert np.abs(heights.height_m[np.isfinite(heights.height_m)]).max() < 0.05
    assert np.isfinite(heights.height_m).mean() > 0.95


def test_saved_implement__is_the_same_when_it_comes_back(watch: Callable[..., Any], tmp_path: Path) -> None:
    kept = watch().learned.implement
    save_implement(tmp_path / "implement.npz", kept)
    back = load_implement(tmp_path / "implement.npz")
    assert (back.levels, back.working_m, back.points, back.gain) == (
        kept.levels,
        kept.working_m,
        kept.points,
        kept.gain,
    )
    assert back.levels.hidden is ToolState.UNKNOWN
    for name in ("ground", "box_m", "split", "clockwise", "turn_s"):
        assert getattr(back.region, name) == getattr(kept.region, name)
    np.testing.assert_array_equal(back.region.still_m, kept.region.still_m)
    np.testing.assert_array_equal(back.template.odds, kept.template.odds)
    assert back.template.grid == kept.template.grid
    assert not np.array_equal(kept.images.up_m, kept.images.down_m, equal_nan=True)
    for name in ("up_m", "down_m", "implement", "azimuth_deg"):
        np.testing.assert_array_equal(getattr(back.images, name), getattr(kept.images, name), err_msg=name)


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 torn"])
def test_load_implement__other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "implement.npz").write_bytes(content)
    with pytest.raises(InputError) as error:
        load_implement(tmp_path / "implement.npz")
    assert error.value.code == "implement-unreadable"


def test_load_implement__an_archive_of_other_arrays_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "implement.npz", form=np.int64(1), ground=np.zeros(3))
    with pytest.raises(InputError) as error:
        load_implement(tmp_path / "implement.npz")
    assert error.value.code == "implement-unreadable"


@pytest.mark.parametrize(
    ("key", "fault"),
    [
        ("lift_m = 45.0", "implement.lift_m"),
        ("region_m = [1.0, -1.0, 0.0, 1.0]", "implement.region_m"),
        ("region_m = [-3500.0, -900.0, -1.0, 1.0]", "implement.region_m"),
    ],
)
def test_session__what_no_lift_or_region_can_be_is_refused(key: str, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        parse_session(SESSION.replace("working_depth_m = 0.12", key))
