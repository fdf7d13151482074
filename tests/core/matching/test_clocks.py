"""Clocks, lever arm and mounting that are stated wrongly, on a short simulated drive with a turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.matching.clock_offset import search_clock_offset
from furrowmap.core.matching.consistency import Cause, GroundTilt, ground_tilt
from furrowmap.core.matching.matched import Matched
from furrowmap.core.matching.placing import Sensor
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.matching.session_match import match_session
from furrowmap.core.pipeline.run import run
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.readers.reader import GivesPoses, ReadOptions, open_recording
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.simulator.scenario import Scenario, ScenarioDrive, ScenarioField
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.located import locate
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import named_offset
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

TURNING = Scenario(
    name="turning",
    seed=23,
    field=ScenarioField(margin_m=8.0),
    drive=ScenarioDrive(
        passes=2,
        pass_m=(4.0,),
        speed_turn_mps=1.6,
        accel_mps2=1.2,
        stand_start_s=0.6,
        stand_end_s=0.4,
        gear_s=0.5,
        lead_in_m=0.4,
    ),
)

Misstated = Callable[[Session], Session]


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> tuple[OpenSession, Trajectory]:
    folder: Path = tmp_path_factory.mktemp("clocks") / "turning"
    opened = open_session(simulate(TURNING, folder).session)
    poses = open_recording([folder / "truth" / "trajectory.csv"], ReadOptions())
    assert isinstance(poses, GivesPoses)
    return opened, trajectory_from_poses(poses.poses(), opened.frame)


def as_stated(session: Session) -> Session:
    return session


def clock(offset_s: float) -> Misstated:
    def changed(session: Session) -> Session:
        recording = msgspec.structs.replace(session.recording, lidar_minus_gnss_s=offset_s)
        return msgspec.structs.replace(session, recording=recording)

    return changed


def lever_back(session: Session) -> Session:
    assert session.antenna is not None
    x, y, z = session.antenna.xyz_m
    return msgspec.structs.replace(session, antenna=msgspec.structs.replace(session.antenna, xyz_m=(-x, y, z)))


def lever_aside(session: Session) -> Session:
    assert session.antenna is not None
    x, y, z = session.antenna.xyz_m
    return msgspec.structs.replace(session, antenna=msgspec.structs.replace(session.antenna, xyz_m=(x, y + 0.4, z)))


def matched(opened: OpenSession, misstated: Misstated) -> Matched:
    opened = replace(opened, session=misstated(opened.session))
    located = locate(opened.positions(), opened.session, opened.frame)
    found = match_session(located, opened.lidar(float(np.mean(located.trajectory.span_s))), opened.session).matched
    assert found is not None
    return found


def errors_m(found: Matched, truth: Trajectory) -> NDArray[np.float64]:
    """(n, 2) of places at the knots, whose times are those of the positions' clock."""
    t_s = found.trajectory.t_s
    inside = (t_s > truth.span_s[0]) & (t_s < truth.span_s[1])
    errors: NDArray[np.float64] = (found.trajectory.at(t_s[inside]).xyz_m - truth.at(t_s[inside]).xyz_m)[:, :2]
    return errors


def test_promise_13__right_clocks_and_lever_arm_stay_as_they_are(turning: tuple[OpenSession, Trajectory]) -> None:
    opened, truth = turning
    found = matched(opened, as_stated)
    assert found.clock_used_s == 0.0
    assert abs(found.seen.constants.clock_s) < 2.0 * found.seen.constants.clock_sigma_s < 0.02
    assert found.seen.plain()["consistent"]
    assert {notice.code for notice in found.notices} & {"clock-offset", "contradiction"} == set()
    assert np.sqrt(np.mean(errors_m(found, truth) ** 2)) < 0.02


@pytest.mark.parametrize("offset_s", [0.06, -4.0])
def test_promise_13__an_offset_that_the_scans_show_is_used_and_reported(
    turning: tuple[OpenSession, Trajectory], offset_s: float
) -> None:
    opened, truth = turning
    found = matched(opened, clock(offset_s))
    constants = found.seen.constants
    assert found.clock_used_s == pytest.approx(-offset_s, abs=4.0 * constants.clock_sigma_s)
    assert [notice.code for notice in found.notices] == ["clock-offset"]
    assert np.sqrt(np.mean(errors_m(found, truth) ** 2)) < 0.03


@pytest.mark.parametrize("misstated", [lever_back, lever_aside])
def test_promise_12__a_wrong_lever_arm_contradicts_what_scans_show(
    turning: tuple[OpenSession, Trajectory], misstated: Misstated
) -> None:
    opened, truth = turning
    found = matched(opened, misstated)
    assert found.notices[0].code == "contradiction"
    assert found.clock_used_s == 0.0
    assert found.seen.cause in {Cause.LEVER_ARM, Cause.CLOCK_OR_LEVER_ARM}
    over = np.sqrt(np.mean(errors_m(found, truth) ** 2)) / np.median(found.trajectory.sigma[:, :2])
    assert over < 5.0


def test_promise_12__a_scanner_upside_down_is_seen_by_the_ground_above_it(
    turning: tuple[OpenSession, Trajectory],
) -> None:
    opened, _ = turning
    scans = []
    for scan in opened.lidar(0.0).scans():
        scans.append(scan)
        if len(scans) == 15:
            break
    (x, y, z), xyz_m = opened.session.lidar.rpy_deg, opened.session.lidar.xyz_m
    assert ground_tilt(scans, Mounting(xyz_m, (x, y, z))) == GroundTilt()
    over, pitched, rolled = (
        ground_tilt(scans, Mounting(xyz_m, rpy)) for rpy in ((x + 180.0, y, z), (x, -y, z), (x + 40.0, y, z))
    )
    assert over.upside_down
    assert over.tilt_deg > 90.0
    assert not pitched.upside_down
    assert pitched.tilt_deg == pytest.approx(2.0 * y, abs=5.0)
    assert 25.0 < rolled.tilt_deg < 45.0
    assert not rolled.upside_down


def test_promise_13__leap_seconds_and_seconds_are_found_in_loops(shared_data: Path) -> None:
    opened = open_session(shared_data / "tractor_fishtail" / "session.toml")
    located = locate(opened.positions(), opened.session, opened.frame)
    mounting = opened.session.lidar.mounting
    returns = ground_returns(opened.lidar(located.trajectory.span_s[0]).scans(), mounting, located.trajectory)
    sensor = Sensor(np.asarray(mounting.xyz_m), np.eye(3))
    assert search_clock_offset(returns, sensor, located.trajectory) is None
    for offset_s in (18.0, -5.0):
        late = replace(returns, t_s=np.asarray(returns.t_s) + offset_s)
        found = search_clock_offset(late, sensor, located.trajectory)
        assert found is not None
        assert found.certain
        assert found.clock_s == pytest.approx(offset_s, abs=0.15)


@pytest.mark.parametrize(
    ("offset_s", "named"),
    [(18.02, "leap seconds"), (-18.3, "leap seconds"), (3600.2, "local time"), (-32400.0, "local time"), (7.0, "")],
)
def test_promise_13__common_offsets_are_named(offset_s: float, named: str) -> None:
    cause = named_offset(offset_s)
    assert (named in str(cause)) if named else not cause


class NoSink:
    """Takes no points."""

    def __call__(
        self, frame: MapFrame, origin_m: tuple[float, float, float], frames: object
    ) -> Callable[[PlacedScan], None]:
        """Nothing."""
        return self.add

    def add(self, placed: PlacedScan) -> None:
        """Nothing."""


@pytest.mark.parametrize(("offset_s", "cause"), [(9 * 3600.0, "a local time"), (-1024 * 604_800.0, "rollover")])
def test_promise_13__clocks_without_overlap_end_in_both_spans_and_the_offset_that_fits(
    turning: tuple[OpenSession, Trajectory], offset_s: float, cause: str
) -> None:
    opened, truth = turning
    opened = replace(opened, session=clock(offset_s)(opened.session))
    with pytest.raises(InputError) as caught:
        run(opened, NoSink())
    assert caught.value.code == "no-common-time"
    what, _, remedy = caught.value.lines
    for t_s in truth.span_s:
        assert iso_utc(t_s)[:16] in what
        assert iso_utc(t_s - offset_s)[:16] in what
    assert cause in remedy
    assert float(remedy.split("lidar_minus_gnss_s = ")[1].split("`")[0]) == pytest.approx(0.0, abs=0.05)
