"""Figures that the glossary, the page on reliability and others state, against those in force."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.adjustment.knots import KNOT_STEP_S, knots_over
from furrowmap.core.matching.gauss_newton import COARSE_EVERY
from furrowmap.core.matching.portions import windows
from furrowmap.core.runtime import memory, settings
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.session.session_file import MAX_PLACE_M, parse_session
from furrowmap.core.trajectory.used_positions import usable
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.inertial import IMU_CLASSES
from furrowmap.exporters.cloud.writer import MEMORY_POINTS
from furrowmap.exporters.files.lease import MAX_SILENCE_S

ROOT = Path(__file__).resolve().parents[2]


def stated(page: str, *sentences: str) -> None:
    """A page has these words, wherever its lines break."""
    flat = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    assert [words for words in sentences if words not in flat] == []


def test_glossary__distances_of_knots_and_length_of_windows() -> None:
    stated("docs/reference/glossary.md", "A time at which the pose is estimated, every 25 ms")
    knots = knots_over(np.linspace(1.75e9, 1.75e9 + 4.0, 4000))
    np.testing.assert_allclose(np.diff(knots.t_s), 0.025, atol=1e-6)
    few = knots_over(np.array([100.0, 100.4, 101.0, 120.0, 120.5]))  # a new chain after each longer pause
    starts = [chain.begin_s for chain in few.chains]
    np.testing.assert_allclose(starts, [100.0 - 0.0125, 120.0 - 0.0125])
    assert all(0.0 < chain.end_s - end_s < 0.05 for chain, end_s in zip(few.chains, (101.0, 120.5), strict=True))
    stated("docs/reference/glossary.md", "*Coarse knots*, one second apart, carry slow corrections")
    assert pytest.approx(1.0) == COARSE_EVERY * KNOT_STEP_S
    stated("docs/reference/glossary.md", "A part of three seconds of a chain that is matched to its own ground first")
    parts = windows(np.linspace(knots.t_s[0], knots.t_s[-1], 1000), knots, 1, [])
    assert max(0.004 * (part.stop - part.start) for _, part in parts) == pytest.approx(3.0, abs=0.05)


def test_session_page__positions_that_are_used_unless_fixes_are_named() -> None:
    stated("docs/reference/session.md", "Default: fixed and float if there is any fixed position, else all.")
    with_fixed = (Fix.FIXED, Fix.FLOAT, Fix.DGPS, Fix.SINGLE, Fix.FIXED, Fix.PPP)
    assert used(*with_fixed) == [Fix.FIXED, Fix.FLOAT, Fix.FIXED]
    without = (Fix.FLOAT, Fix.DGPS, Fix.SINGLE, Fix.PPP)
    assert used(*without) == list(without)
    assert used(*with_fixed, fixes=(Fix.DGPS, Fix.SINGLE)) == [Fix.DGPS, Fix.SINGLE]


def used(*kinds: Fix, fixes: tuple[Fix, ...] | None = None) -> list[Fix]:
    """Of positions of these kinds, those that a run uses."""
    n = len(kinds)
    place = {"lon_deg": np.full(n, 140.0), "lat_deg": np.full(n, 36.0), "height_m": np.full(n, 50.0)}
    track = GnssTrack.build(1.75e9 + np.arange(n, dtype=np.float64), fix=np.array(kinds), **place)
    return [Fix(kind) for kind in usable(track, fixes).track.fix.tolist()]


def test_session_page__defaults_of_an_imu() -> None:
    stated("docs/reference/session.md", 'model, or "consumer", "industrial" (default), "tactical"')
    least = 'furrowmap = 1\n[recording]\ngnss = ["a.nmea"]\n[crs]\nmap = "EPSG:6677"\n[imu]\nfiles = ["imu.csv"]\n'
    imu = parse_session(least).imu
    assert imu is not None
    assert (imu.kind, imu.xyz_m, imu.rpy_deg) == ("industrial", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert set(IMU_CLASSES) == {"consumer", "industrial", "tactical"}
    worst_first = [IMU_CLASSES[name]["gyro_deg_s_rthz"] for name in ("consumer", "industrial", "tactical")]
    assert worst_first == sorted(worst_first, reverse=True)


def test_session_page__noise_of_each_class() -> None:
    page = (ROOT / "docs/reference/session.md").read_text(encoding="utf-8")
    head, *rows = (
        re.findall(r"[^|`\s]+", line) for line in page.splitlines() if re.match(r" *\| (`\w+_|figure)", line)
    )
    stated_figures = {kind: {row[0]: float(row[k]) for row in rows} for k, kind in enumerate(head[1:], start=1)}
    assert stated_figures == IMU_CLASSES


def test_commands_page__threads_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    stated("docs/reference/commands.md", "else the number of processors, at most 8]")
    monkeypatch.delenv(settings.THREADS_VARIABLE, raising=False)
    for processors, expected in ((1, 1), (5, 5), (8, 8), (9, 8), (64, 8)):
        monkeypatch.setattr(settings, "available_processors", lambda processors=processors: processors)
        assert settings.threads() == expected


def test_reliability_page__half_of_what_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stated("docs/reliability.md", "or takes more than half of the free memory or disk (`--allow-large`)")
    free = 8 * memory.FREE_BYTES
    monkeypatch.setattr(memory, "free_memory_bytes", lambda: free)
    monkeypatch.setattr(memory.shutil, "disk_usage", lambda _: type("Usage", (), {"free": free}))
    memory.expect_memory("x", free // 2)
    memory.expect_disk("x", tmp_path, free // 2)
    with pytest.raises(RefusedError, match="More than half of the free memory"):
        memory.expect_memory("x", free // 2 + 1)
    with pytest.raises(RefusedError, match="More than half of the free space"):
        memory.expect_disk("x", tmp_path, free // 2 + 1)


def test_reliability_page__points_in_memory() -> None:
    stated("docs/reliability.md", "60 bytes for each of at most 8 million points in memory")
    assert MEMORY_POINTS == 8_000_000


@pytest.mark.parametrize(
    ("page", "sentence", "value"),
    [
        ("docs/reference/session.md", "more than {} m is an error", MAX_PLACE_M),
        ("docs/reliability.md", "if its heartbeat does not change for {} s", MAX_SILENCE_S),
    ],
)
def test_figure__is_that_of_the_page(page: str, sentence: str, value: float) -> None:
    stated(page, sentence.format(f"{value:g}"))


@pytest.mark.parametrize(
    ("page", "sentence", "constant", "value"),
    [
        ("docs/reliability.md", "A process that sends nothing for half an hour is terminated", "SILENT_S", 1800.0),
        ("docs/reference/worker.md", "does not react within twenty seconds", "CANCEL_S", 20.0),
    ],
)
def test_figure__of_the_plugin(page: str, sentence: str, constant: str, value: float) -> None:
    """Nothing of the plugin can be imported outside QGIS."""
    stated(page, sentence)
    (found,) = re.findall(rf"^{constant} = ([\d.]+)$", (ROOT / "plugin" / "worker.py").read_text("utf-8"), re.MULTILINE)
    assert float(found) == value
