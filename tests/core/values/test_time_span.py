"""The part of a recording between two times."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.time_span import WHOLE_SPAN, inertial_within, scans_within, track_within

ENDS = st.one_of(st.just(-math.inf), st.just(math.inf), st.floats(-2.0, 14.0))


def scan(number: int, t_s: np.ndarray) -> Scan:
    n = len(t_s)
    return Scan(
        number=number,
        t_s=t_s,
        xyz_m=np.column_stack([t_s, t_s, t_s]).astype(np.float32),
        intensity=np.zeros(n, np.uint8),
        laser=np.zeros(n, np.uint8),
        column=np.zeros(n, np.uint16),
        return_number=np.ones(n, np.uint8),
        returns=np.ones(n, np.uint8),
    )


SCANS = [scan(k, np.linspace(k, k + 0.95, 20 if k != 4 else 0)) for k in range(12)]
TIMES = np.concatenate([one.t_s for one in SCANS])


@given(begin_s=ENDS, end_s=ENDS)
def test_scans__have_the_returns_of_the_span_and_no_others(begin_s: float, end_s: float) -> None:
    found = list(scans_within(iter(SCANS), (begin_s, end_s)))
    inside = TIMES[(begin_s <= TIMES) & (end_s >= TIMES)]
    np.testing.assert_array_equal(np.concatenate([TIMES[:0], *(one.t_s for one in found)]), inside)
    for one in found:
        whole = SCANS[one.number]
        assert one.whole == (len(one) == len(whole)), "what is cut is no whole revolution"


def test_scans__after_the_end_are_not_read() -> None:
    read = []

    def reading():  # type: ignore[no-untyped-def]
        for one in SCANS:
            read.append(one.number)
            yield one

    assert [one.number for one in scans_within(reading(), (1.0, 2.0))] == [1, 2]
    assert max(read) <= 3


def test_tracks__of_positions_poses_and_imu_are_cut_at_both_ends() -> None:
    t_s = np.arange(10.0)
    zeros = np.zeros((10, 3))
    track = GnssTrack.build(t_s, source="gnss.nmea", lon_deg=t_s, lat_deg=t_s)
    poses = PoseTrack(t_s, zeros, True, t_s, t_s, t_s, False, np.zeros((10, 6)), "poses.csv")
    imu = InertialTrack(t_s, zeros, zeros, "imu.csv")
    for found in (track_within(track, (2.5, 6.0)), track_within(poses, (2.5, 6.0)), inertial_within(imu, (2.5, 6.0))):
        assert found.t_s.tolist() == [3.0, 4.0, 5.0, 6.0]
    assert track_within(track, (2.5, 6.0)).lon_deg.tolist() == [3.0, 4.0, 5.0, 6.0]
    assert track_within(poses, (2.5, 6.0)).heading_deg.tolist() == [3.0, 4.0, 5.0, 6.0]
    assert track_within(track, WHOLE_SPAN) is track
    assert len(inertial_within(imu, WHOLE_SPAN)) == 10


@pytest.mark.parametrize("span_s", [(20.0, 30.0), (-math.inf, -1.0), (4.2, 4.8)])
def test_spans_without_positions__are_refused_with_the_times_there_are(span_s: tuple[float, float]) -> None:
    t_s = np.arange(10.0)
    track = GnssTrack.build(t_s, source="gnss.nmea", lon_deg=t_s, lat_deg=t_s)
    poses = PoseTrack(t_s, np.zeros((10, 3)), True, t_s, t_s, t_s, False, np.zeros((10, 6)), "a.csv")
    for call in (lambda: track_within(track, span_s), lambda: track_within(poses, span_s)):
        with pytest.raises(InputError) as error:
            call()
        assert error.value.code == "no-such-time"
        assert "1970-01-01T00:00:00" in error.value.lines[0]
        assert "1970-01-01T00:00:09" in error.value.lines[0]
