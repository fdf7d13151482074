"""Which scans a preview looks at."""

from __future__ import annotations

import gzip
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.pipeline.preview_story import PREVIEW_LENGTH_S, PREVIEW_PERIOD_S, preview_scans
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.velodyne.captures import VelodynePcap
from furrowmap.core.values.scan import Scan


def scan(t_s: float, n: int = 1) -> Scan:
    few = np.zeros(n, np.uint8)
    return Scan(0, np.full(n, t_s), np.zeros((n, 3), np.float32), few, few, few.astype(np.uint16), few, few)


@given(
    steps=st.lists(st.floats(0.02, 20.0), min_size=1, max_size=60),
    period_s=st.floats(PREVIEW_PERIOD_S, 60.0),
)
def test_preview_scans__are_never_further_apart_than_the_period_and_the_next_scan(
    steps: list[float], period_s: float
) -> None:
    t_s = np.cumsum(steps)
    kept = [float(s.t_s[0]) for s in preview_scans(map(scan, t_s.tolist()), period_s)]
    assert kept[0] == t_s[0]
    for left_out in sorted(set(t_s.tolist()) - set(kept)):
        before = max(t for t in kept if t < left_out)
        assert left_out - before < period_s
    looks = [t for t, previous in zip(kept, [-np.inf, *kept], strict=False) if t - previous >= PREVIEW_LENGTH_S]
    assert all(b - a >= period_s - 2 * PREVIEW_LENGTH_S for a, b in pairwise(looks))


def test_preview_scans__leave_out_scans_without_returns() -> None:
    assert [len(s) for s in preview_scans(iter([scan(0.0, 0), scan(0.1), scan(0.2, 0)]), 1.0)] == [1]


@pytest.fixture(scope="module")
def capture(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first six seconds of a tractor's scans."""
    path = tmp_path_factory.mktemp("capture") / "capture.pcap"
    with gzip.open(shared_data / "tractor_loop" / "recording.pcap.gz") as stream:
        path.write_bytes(stream.read(24 + 1264 * 4500))
    return path


def test_a_capture_at_a_glance_gives_the_points_of_the_whole_one(capture: Path) -> None:
    """Times too, though the stamps of most packets are never seen."""
    whole, some = (
        np.concatenate([np.column_stack([s.t_s, s.xyz_m]) for s in VelodynePcap([capture], options).scans()])
        for options in (ReadOptions(), ReadOptions(glance_s=1.0))
    )
    assert 0.08 * len(whole) < len(some) < 0.16 * len(whole)
    assert len(np.unique(np.floor(some[:, 0]))) >= 5
    every = {row.tobytes() for row in whole}
    assert all(row.tobytes() in every for row in some)
