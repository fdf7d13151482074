"""A further scanner that sees nothing of the first one's ground; tests/test_two_scanners.py has one that does."""

from __future__ import annotations

import numpy as np

from furrowmap.core.matching.relative_mounting import FirstScanner, relative_mounting
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import trajectory_from_attitude

SESSION = parse_session(
    'furrowmap = 1\nrecording = { lidar = ["a.pcap"], gnss = ["a.nmea"] }\ncrs = { map = "EPSG:6677" }\n'
)


def test_mounting_without_common_ground__is_as_stated() -> None:
    t_s = np.arange(0.0, 2.0, 0.1)
    zero = np.zeros(len(t_s))
    trajectory = trajectory_from_attitude(t_s, np.column_stack([t_s, zero, zero]), zero, zero, zero, max_gap_s=1.0)
    stated, seen = Mounting((1.9, 0.0, 2.2), (0.0, 35.0, 0.0)), list[Scan]()
    first = FirstScanner.of_scans([], Mounting((-0.6, 0.0, 2.4), (0.0, 40.0, 180.0)), trajectory, SESSION)
    found = relative_mounting(first, [], stated, seen.append)
    assert not found.used
    assert found.mounting == stated
    assert found.clock_used_s == 0.0
    assert found.off == ()
    assert [notice.code for notice in found.notices(0.0)] == ["scanner-mounting-assumed"]
    assert found.plain()["correction"]["roll_deg"] == {"value": 0.0, "sigma": None}
