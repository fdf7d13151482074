"""Poses of other software: arrays that do not belong together are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from furrowmap.core.values.pose_track import PoseTrack

GOOD: dict[str, Any] = {
    "t_s": np.arange(3.0), "position": np.zeros((3, 3)), "projected": True, "roll_deg": np.zeros(3),
    "pitch_deg": np.zeros(3), "heading_deg": np.zeros(3), "true_north": False, "sigma": np.full((3, 6), np.nan),
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": np.zeros((3, 2))}, "PoseTrack.position has shape"),
        ({"sigma": np.zeros((3, 3))}, "PoseTrack.sigma"),
        ({"roll_deg": np.zeros(2)}, "PoseTrack.roll_deg has shape"),
        ({"heading_deg": np.zeros((3, 1))}, "PoseTrack.heading_deg has shape"),
        ({"t_s": np.array([0.0, 1.0, 1.0])}, "does not increase"),
    ],
)
def test_pose_track__refuses_arrays_that_do_not_belong_together(change: dict[str, Any], words: str) -> None:
    assert len(PoseTrack(**GOOD)) == 3
    with pytest.raises(ValueError, match=words):
        PoseTrack(**GOOD | change)
