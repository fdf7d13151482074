"""A run that was killed after matching does not match again, and its result is that of an uninterrupted run."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import msgspec
import numpy as np
import pytest
from pandas.testing import assert_frame_equal

import furrowmap
from furrowmap.core.matching import session_match
from furrowmap.core.session.opened import open_session
from furrowmap.core.trajectory.located import locate
from furrowmap.exporters.files.file_records import FileRecord
from furrowmap.exporters.files.lease import leases
from furrowmap.workflows.run.run import KeptMatching

KILLED_AFTER_MATCHING = """
import os, sys
import furrowmap
from furrowmap.workflows.run.run import KeptMatching
save = KeptMatching.save
def last(self, found):
    save(self, found)
    os.kill(os.getpid(), 9)
KeptMatching.save = last
furrowmap.run(sys.argv[1], sys.argv[2])
"""


CLOUD = "cloud.copc.laz"


def digests(folder: Path) -> dict[str, str]:
    names = (CLOUD, "dsm.tif", "dsm_before.tif", "change.tif", "states.csv", "implement.npz", "session.toml")
    return {n: hashlib.sha256((folder / n).read_bytes()).hexdigest() for n in names if (folder / n).exists()}


def unchanging(report: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in report.items() if key != "timings"}


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")
def test_promise_20__resumed_run_uses_the_matching_and_gives_the_same_result(
    simulated: furrowmap.Simulated, result: furrowmap.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = result.path.with_name("resumed")  # beside the other one: products state where the session lies
    command = [sys.executable, "-c", KILLED_AFTER_MATCHING, str(simulated.session), str(folder)]
    assert subprocess.run(command, check=False).returncode == -9
    assert not (folder / "report.json").exists()
    with pytest.raises(furrowmap.InputError):  # nothing to read, and what was kept stays
        furrowmap.open_result(folder)
    assert leases(folder)
    monkeypatch.setattr(session_match, "match_session", None)
    resumed = furrowmap.run(simulated.session, folder, resume=True)
    assert not leases(folder)
    ours, theirs = digests(folder), digests(result.path)
    assert ours.keys() == theirs.keys()
    assert {name for name in ours if ours[name] != theirs[name]} <= {CLOUD}
    assert_same_points(folder / CLOUD, result.path / CLOUD)
    assert unchanging(resumed.report) == unchanging(result.report)
    for name in result.layers:
        # Matching sums in parallel, so that two runs may differ in the last digit of a sigma.
        assert_frame_equal(resumed.layers[name].to_wkt(), result.layers[name].to_wkt(), rtol=1e-12)


def assert_same_points(one: Path, other: Path) -> None:
    """Of two runs: matching sums in parallel, so that a coordinate may be rounded to the next step of the file."""
    clouds = [laspy.read(path) for path in (one, other)]
    orders = [np.lexsort((cloud.intensity, cloud.return_number, cloud.gps_time)) for cloud in clouds]
    assert [str(name) for name in clouds[0].point_format.dimension_names] == [
        str(name) for name in clouds[1].point_format.dimension_names
    ]
    for name in clouds[0].point_format.dimension_names:
        a, b = (np.asarray(cloud[name])[order] for cloud, order in zip(clouds, orders, strict=True))
        np.testing.assert_allclose(
            a.astype(float), b.astype(float), rtol=0, atol=1.0 if name in "XYZ" else 0.0, err_msg=name
        )


def test_kept_matching__is_that_of_the_same_session_and_recordings_only(
    simulated: furrowmap.Simulated, result: furrowmap.Result, tmp_path: Path
) -> None:
    opened, inputs = open_session(Path(simulated.session)), [FileRecord("a", 1, "00")]
    trajectory = locate(opened.positions(), opened.session, opened.frame).trajectory
    kept = KeptMatching(tmp_path / "kept", opened, inputs)
    assert kept.load() is None
    kept.save(session_match.MatchedSession(trajectory, (), None))
    back = kept.load()
    assert back is not None
    assert np.array_equal(back.trajectory.xyz_m, trajectory.xyz_m)
    other = replace(opened, session=msgspec.structs.replace(opened.session, name="other"))
    assert KeptMatching(tmp_path / "kept", other, inputs).load() is None
    assert KeptMatching(tmp_path / "kept", opened, [FileRecord("a", 1, "01")]).load() is None
    (tmp_path / "kept").write_bytes((tmp_path / "kept").read_bytes()[:-3])
    assert kept.load() is None
