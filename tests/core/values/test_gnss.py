"""A GNSS track: what is not stated is unknown, and times increase."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.values.gnss import Fix, GnssTrack


def test_build__fills_what_is_not_stated_with_unknown() -> None:
    track = GnssTrack.build(np.array([1.0, 2.0]), source="a.nmea", lat_deg=np.array([35.0, 36.0]))
    np.testing.assert_array_equal(track.lat_deg, [35.0, 36.0])
    np.testing.assert_array_equal(track.fix, [Fix.NONE, Fix.NONE])
    np.testing.assert_array_equal(track.satellites, [-1, -1])
    for name in set(GnssTrack.columns()) - {"t_s", "lat_deg", "fix", "satellites"}:
        assert np.isnan(getattr(track, name)).all(), name
    assert (track.fix.dtype, track.satellites.dtype, track.t_s.dtype) == (np.int8, np.int16, np.float64)


def test_index__takes_the_same_epochs_of_every_column() -> None:
    t_s = np.arange(5.0)
    columns = {name: t_s + k for k, name in enumerate(GnssTrack.columns()[1:])}
    track = GnssTrack.build(t_s, source="a.nmea", **columns)
    for index in (slice(1, 4), t_s > 2, np.array([0, 2, 4])):
        part = track[index]
        assert part.source == "a.nmea"
        for name in GnssTrack.columns():
            np.testing.assert_array_equal(getattr(part, name), getattr(track, name)[index])


@pytest.mark.parametrize("t_s", [[1.0, 1.0], [2.0, 1.0], [0.0, np.nan]])
def test_track__refuses_times_that_do_not_increase(t_s: list[float]) -> None:
    with pytest.raises(ValueError, match="does not increase"):
        GnssTrack.build(np.array(t_s))


def test_track__refuses_columns_of_another_length() -> None:
    with pytest.raises(ValueError, match="hdop"):
        GnssTrack.build(np.array([1.0, 2.0]), hdop=np.array([1.0]))


def test_fix__has_the_codes_of_gga() -> None:
    assert {fix.value: fix.label for fix in (Fix.NONE, Fix.SINGLE, Fix.DGPS, Fix.FIXED, Fix.FLOAT)} == {
        0: "none", 1: "single", 2: "dgps", 4: "fixed", 5: "float",
    }  # fmt: skip
