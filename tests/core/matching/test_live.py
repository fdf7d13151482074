"""Live matching: as near to the truth as its sigmas say, without a look ahead."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.matching.live import LiveMatching, LivePose
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.session.inputs import open_positions
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.rotation import wrap_deg
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Crs

FloatArray = NDArray[np.float64]


def live_poses(recording, scans: Iterable[Scan], track: GnssTrack, frame: MapFrame | None = None) -> list[LivePose]:
    session = recording.session
    live = LiveMatching(session.lidar.mounting, session.antenna.xyz_m, None, frame or map_frame(session.crs))
    poses, heard = [], 0
    for scan in scans:
        now = int(np.searchsorted(track.t_s, scan.t_s[-1], side="right"))
        if now > heard:
            live.hear(track[heard:now])
            heard = now
        pose = live.see(scan)
        if pose is not None:
            poses.append(pose)
    return poses


@pytest.fixture(scope="module")
def track(straight) -> GnssTrack:
    reader = open_positions(straight.inputs, straight.session)
    assert isinstance(reader, GivesTrack)
    return reader.track()


@pytest.fixture(scope="module")
def poses(straight, track) -> list[LivePose]:
    return live_poses(straight, straight.scans(), track)


def errors(poses: list[LivePose], straight) -> FloatArray:
    """(n, 6) easting, northing, height (m), roll, pitch, heading (degrees) of poses less the truth's."""
    truth = straight.truth.at([pose.t_s for pose in poses])
    rotation = Rotation.from_quat(np.array([pose.quaternion for pose in poses]), scalar_first=True)
    off = (rotation * Rotation.from_quat(truth.quaternion, scalar_first=True).inv()).as_rotvec()
    axes = Rotation.from_quat(truth.quaternion, scalar_first=True).as_matrix()
    roll, pitch = (np.degrees(np.einsum("ni,ni->n", off, axes[:, :, axis])) for axis in range(2))
    place = np.array([pose.xyz_m for pose in poses]) - truth.xyz_m
    return np.column_stack([place, roll, pitch, wrap_deg(-np.degrees(off[:, 2]))])


def test_gives_a_pose_for_every_scan_once_the_heading_shows(poses, straight) -> None:
    times = np.array([pose.t_s for pose in poses])
    assert len(poses) > 30
    assert np.diff(times[:-1]) == pytest.approx(0.1, abs=0.02)
    assert times[-1] > straight.truth.span_s[1] - 1.0


def test_positions_are_brought_to_the_maps_heights(straight, track, poses) -> None:
    """Above a geoid each pose is lower by the geoid's height there, and nothing else is changed by a millimetre."""
    frame = map_frame(Crs(map=straight.session.crs.map, heights="JPGEO2024"))
    soon_s = poses[5].t_s
    some = live_poses(straight, (scan for scan in straight.scans() if scan.t_s[0] < soon_s), track, frame)
    assert len(some) >= 5
    for low, high in zip(some, poses, strict=False):
        lon, lat = frame.to_lon_lat(high.xyz_m[:1], high.xyz_m[1:2])
        assert low.t_s == high.t_s
        assert low.xyz_m[2] - high.xyz_m[2] == pytest.approx(-frame.heights.geoid_m(lon, lat)[0], abs=2e-3)
        np.testing.assert_allclose(low.xyz_m[:2], high.xyz_m[:2], atol=2e-3)


def test_is_near_to_the_truth(poses, straight) -> None:
    """A straight drive does not show the mean roll, nor the sway of what lies across it; the rest it shows."""
    off = errors(poses, straight)
    lever = straight.session.antenna.xyz_m[2]
    across = abs(np.radians(off[:, 3].mean())) * lever
    assert np.sqrt((off[:, :2] ** 2).mean(axis=0)).max() < 0.03 + across
    assert np.sqrt((off[:, 5] ** 2).mean()) < 1.5
    assert off[:, 3].std() < 0.15
    assert off[:, 4].std() < 0.15
    assert off[:, 2].std() < 0.015


def test_errors_are_what_the_sigmas_say(poses, straight) -> None:
    sigma = np.array([pose.sigma for pose in poses])
    assert np.isfinite(sigma).all()
    assert (sigma > 0).all()
    assert (np.abs(errors(poses, straight)) < 4.0 * sigma).mean() > 0.95


def test_no_pose_without_a_heading(straight, track) -> None:
    """As long as the vehicle stands, nothing shows where it heads."""
    standing_until_s = straight.truth.t_s[0] + 1.0
    scans = (scan for scan in straight.scans() if scan.t_s[-1] < standing_until_s + 0.5)
    assert live_poses(straight, scans, track) == []


def test_scans_without_positions_wait(straight, track) -> None:
    assert live_poses(straight, straight.scans(), track[:0]) == []


def test_an_outage_is_said_and_got_over(straight, track, poses) -> None:
    """Two seconds without positions, soon after the start: sigmas grow, and the place comes back with the positions."""
    end_s = track.t_s[-1]
    cut = track[(track.t_s < end_s - 3.0) | (track.t_s > end_s - 1.0)]
    without = live_poses(straight, straight.scans(), cut)
    gone = np.array([end_s - 1.6 < pose.t_s < end_s - 1.1 for pose in without])
    assert gone.any()
    sigma = np.array([pose.sigma for pose in without])
    whole = np.array([pose.sigma for pose in poses])
    assert (sigma[gone][:, [0, 1, 5]] > whole[gone][:, [0, 1, 5]]).all()
    assert np.hypot(*errors(without, straight)[-1, :2]) < 0.1
