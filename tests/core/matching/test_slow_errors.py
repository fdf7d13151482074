"""Positions that err slowly together are seen by the way that scans show, and standard deviations grow to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from furrowmap.core.values.gnss import Positions
from tests.core.conftest import Recording
from tests.core.matching.test_match_notices import matched


def test_slow_errors__are_named_and_within_their_standard_deviations(straight: Recording) -> None:
    def creeping(right: Positions) -> Positions:
        """0.3 m, stated as centimetres; the map's axes and the height err each in its own way."""
        since_s = right.t_s - right.t_s[0]
        error_m = 0.3 * np.sin(2.0 * np.pi * since_s[:, None] / (25.0, 40.0, 30.0) + (0.3, 1.0, -0.5))
        return replace(right, xyz_m=right.xyz_m + error_m)

    _, found = matched(straight.opened.file, creeping)
    (notice,) = (one for one in found.notices if one.code == "contradiction")
    assert "positions err slowly together" in notice.text
    assert "The likely cause is the positions" in notice.text
    t_s = found.trajectory.t_s
    t_s = t_s[(t_s > straight.truth.span_s[0] + 0.1) & (t_s < straight.truth.span_s[1] - 0.1)]
    ours, true = found.trajectory.at(t_s), straight.truth.at(t_s)
    sigma = np.array([np.interp(t_s, found.trajectory.t_s, one) for one in found.trajectory.sigma[:, :3].T]).T
    off = np.sqrt(np.mean(((ours.xyz_m - true.xyz_m) / sigma) ** 2, axis=0))
    assert off.max() < 2.5
    assert sigma.max() < 2.0


def test_positions_fixed_wrongly__are_named_and_pull_nothing(shared_data: Path) -> None:
    def stepping(right: Positions) -> Positions:
        """0.1 m off for ten seconds."""
        since_s = right.t_s - right.t_s[0]
        return replace(right, xyz_m=right.xyz_m + np.outer((since_s > 15.0) & (since_s < 25.0), [0.06, -0.08, 0.0]))

    sample = shared_data / "tractor_loop"
    _, found = matched(sample / "session.toml", stepping)
    assert [one.key for one in found.notices if one.code in ("gnss-steps", "contradiction")] == ["gnss-steps.shown"]
    t_s, *true = np.loadtxt(sample / "truth" / "trajectory.csv", delimiter=",", skiprows=1, usecols=(0, 1, 2)).T
    inside = (found.trajectory.t_s > t_s[0]) & (found.trajectory.t_s < t_s[-1])
    at_s = found.trajectory.t_s[inside]
    off_m = [
        ours - np.interp(at_s, t_s, one) for ours, one in zip(found.trajectory.xyz_m[inside].T, true, strict=False)
    ]
    assert np.hypot(*off_m).max() < 0.04
