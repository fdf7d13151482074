"""By how much a live session differed from the run of its recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.live.difference import LIVE_LOG, LiveDifference, live_difference
from furrowmap.core.values.trajectory import ScanPoses

from ..conftest import Recording

LINE = {"t_s": 0.0, "e_m": 0.0, "n_m": 0.0, "heading_deg": 0.0, "worked_m2": 12.0}


def test_difference__is_that_which_was_shown(straight: Recording, tmp_path: Path) -> None:
    """3 cm ahead and 4 cm aside of the truth, and half a degree off; the last line was cut by a loss of power."""
    poses = ScanPoses.at_knots(straight.truth)
    t_s = np.arange(poses.t_s[0] + 0.5, poses.t_s[-1], 1.0)
    true = straight.truth.at(t_s)
    heading_deg = true.attitude_deg()[2] + 0.5
    rows = zip(t_s.tolist(), *(true.xyz_m[:, :2] + [0.03, 0.04]).T.tolist(), heading_deg.tolist(), strict=True)
    lines = [json.dumps(LINE | {"t_s": t, "e_m": e, "n_m": n, "heading_deg": h}) for t, e, n, h in rows]
    log = tmp_path / LIVE_LOG
    assert live_difference(tmp_path, "EPSG:6677", poses, 10.0) is None
    log.write_text("\n".join(['{"crs":"EPSG:6677"}', *lines, lines[0][:30]]))
    found = live_difference(tmp_path, "EPSG:6677", poses, 10.0)
    assert isinstance(found, LiveDifference)
    assert found.seconds == len(t_s)
    assert found.place_m == pytest.approx((0.05, 0.05), abs=0.002)
    assert found.heading_deg == pytest.approx((0.5, 0.5), abs=0.05)
    assert found.worked_m2 == (12.0, 10.0)
    log.write_text("\n".join(['{"crs":"EPSG:6677"}', *lines[: len(lines) // 2]]))
    part = live_difference(tmp_path, "EPSG:6677", poses, 10.0)
    assert part is not None
    assert part.worked_m2 is None
    assert live_difference(tmp_path, "EPSG:32654", poses, 10.0) is None
    for text in ("", "[]", '{"crs":"EPSG:6677"}\n[1]\n{}', '{"crs":"EPSG:6677"}\n' + json.dumps(LINE)):
        log.write_text(text)
        assert live_difference(tmp_path, "EPSG:6677", poses, 10.0) is None
