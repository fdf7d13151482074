"""Which stated places a recording confirms: the keys that are left in the report."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.matching.consistency import Seen
from furrowmap.core.matching.matched import Matched
from furrowmap.core.matching.mounting_calibration import MountingCalibration
from furrowmap.core.pipeline.run_result import unconfirmed_places
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.trajectory import trajectory_from_attitude

SESSION = parse_session(
    'furrowmap = 1\n[recording]\nlidar = ["a.pcap"]\ngnss = ["a.nmea"]\n[crs]\nmap = "EPSG:6677"\n'
    "[lidar]\nxyz_m = [0, 0, 2]\nrpy_deg = [0, 0, 0]\n[antenna]\nxyz_m = [0, 0, 2.5]\n"
)
ALL = ("antenna.xyz_m", "lidar.xyz_m", "lidar.rpy_deg")


def driven(turn_deg: float, source: str = "gnss", *codes: str) -> Located:
    """A drive whose heading differs from its mean by half of `turn_deg`."""
    t_s = np.arange(0.0, 20.0)
    heading = 350.0 + turn_deg * (t_s >= 10.0)
    xyz = np.column_stack([t_s, 0.0 * t_s, 0.0 * t_s])
    trajectory = trajectory_from_attitude(t_s, xyz, 0.0, 0.0, heading, max_gap_s=2.0)
    return Located(trajectory, source, {}, tuple(Notice.from_values(code, {}) for code in codes))


def matched(located: Located, *, sigma_height_m: float = 0.01, facing_shown: bool = True) -> Matched:
    stands = MountingCalibration(0.0, 0.0, 0.0, 0.0, (0.1, 0.1, 0.1), sigma_height_m)
    return Matched(located.trajectory, Mounting(), None, stands, facing_shown, Seen(), {}, ())


def test_a_session_without_scans__has_nothing_to_confirm() -> None:
    session = parse_session(
        'furrowmap = 1\n[recording]\ngnss = ["a.nmea"]\n[crs]\nmap = "EPSG:6677"\n'
        "[antenna]\nxyz_m = [0, 0, 2.5]\n[implement]\nwidth_m = 3.0\nxy_m = [-1, 0]\n"
        'states = ["s.csv"]\n'
    )
    assert unconfirmed_places(session, driven(180.0), None, None) == ()


def test_without_scan_matching__only_a_stated_trajectory_has_its_lever_arm() -> None:
    assert unconfirmed_places(SESSION, driven(180.0), None, None) == ALL
    assert unconfirmed_places(SESSION, driven(180.0, "file"), None, None) == ALL[1:]


@pytest.mark.parametrize(("turn_deg", "left"), [(180.0, ()), (100.0, ()), (80.0, ALL[:1]), (0.0, ALL[:1])])
def test_a_lever_arm__is_shown_where_the_vehicle_turns_across_north_or_not(
    turn_deg: float, left: tuple[str, ...]
) -> None:
    drive = driven(turn_deg)
    assert unconfirmed_places(SESSION, drive, matched(drive), None) == left


def test_what_matching_does_not_show__is_named() -> None:
    drive = driven(180.0)
    assert unconfirmed_places(SESSION, drive, matched(drive, sigma_height_m=np.inf), None) == ("lidar.xyz_m",)
    assert unconfirmed_places(SESSION, drive, matched(drive, facing_shown=False), None) == ("lidar.rpy_deg",)
    assumed = driven(180.0, "gnss", "lever-assumed")
    assert unconfirmed_places(SESSION, assumed, matched(assumed), None) == ("antenna.xyz_m",)


def test_what_is_not_stated__is_not_to_be_confirmed() -> None:
    nothing = parse_session('furrowmap = 1\n[recording]\nlidar = ["a"]\ngnss = ["b"]\n[crs]\nmap = "EPSG:6677"\n')
    assert nothing.unstated == ALL
    assert unconfirmed_places(nothing, driven(180.0), None, None) == ()
