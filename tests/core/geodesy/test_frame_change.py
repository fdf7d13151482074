"""Positions in an ITRF on maps that move with their plate: against EUREF's own parameters, and refused without any."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import Transformer

from furrowmap.core.geodesy.coordinates import transform_track
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.session import Crs

FloatArray = NDArray[np.float64]

LON_LAT_H = (11.3885, 55.328, 70.0)
GEOCENTRIC = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
MAS = np.pi / 180.0 / 3.6e6


def track(height_m: float = LON_LAT_H[2]) -> GnssTrack:
    begin = dt.datetime(2026, 5, 23, 9, tzinfo=dt.UTC).timestamp()
    n = 4
    return GnssTrack.build(
        begin + np.arange(n),
        lon_deg=np.full(n, LON_LAT_H[0]),
        lat_deg=LON_LAT_H[1] + 1e-5 * np.arange(n),
        height_m=np.full(n, height_m),
    )


def by_euref(lon_lat_h: FloatArray, epoch: float) -> FloatArray:
    """ITRF2020 to ETRF2000 by table 4 of EUREF Technical Note 1 (2020): parameters at 2015.0, and their rates."""
    since = epoch - 2015.0
    shift = 1e-3 * (np.array([53.8, 51.8, -82.2]) + since * np.array([0.1, 0.0, -1.7]))
    scale = 1e-9 * (2.25 + 0.11 * since)
    turn = MAS * (np.array([2.106, 12.740, -20.592]) + since * np.array([0.081, 0.490, -0.792]))
    xyz = np.array(GEOCENTRIC.transform(*lon_lat_h, direction="INVERSE"))
    return np.array(GEOCENTRIC.transform(*(xyz + shift + scale * xyz + np.cross(turn, xyz))))


def test_positions__are_where_eurefs_parameters_put_them() -> None:
    recorded = track()
    frame = map_frame(Crs(map="EPSG:25832", coordinates="itrf2020 to etrf2000"))
    moved, done = transform_track(recorded, frame)
    for k in range(len(recorded)):
        epoch = 2026.0 + (recorded.t_s[k] - dt.datetime(2026, 1, 1, tzinfo=dt.UTC).timestamp()) / 31_536_000.0
        right = by_euref(np.array([recorded.lon_deg[k], recorded.lat_deg[k], recorded.height_m[k]]), epoch)
        np.testing.assert_allclose([moved.lon_deg[k], moved.lat_deg[k]], right[:2], rtol=0, atol=3e-9)
        assert abs(moved.height_m[k] - right[2]) < 2e-4
    assert done.epoch is not None
    assert 0.8 < np.hypot(done.epoch.east_m, done.epoch.north_m) < 1.0
    assert done.epoch.file == "ITRF2020 to ETRF2000 (1)"
    assert done.account(frame)["moves"][0]["up_m"] == round(done.epoch.up_m, 4) != 0.0
    assert str(frame.sentences[0]) == (
        "Recorded positions are transformed to the frame of the map with ITRF2020 to ETRF2000 (1)."
    )


def test_positions__without_heights_are_transformed_on_the_map() -> None:
    frame = map_frame(Crs(map="EPSG:25832", coordinates="ITRF2020 to ETRF2000"))
    (flat, _), (whole, _) = (transform_track(each, frame) for each in (track(np.nan), track()))
    np.testing.assert_allclose(flat.lon_deg, whole.lon_deg, rtol=0, atol=1e-10)
    assert np.isnan(flat.height_m).all()


def moved_m(code: str, lon: float, lat: float) -> FloatArray:
    """(2,) easting and northing by which a place of a country moves."""
    recorded = track()
    there = GnssTrack.build(recorded.t_s, lon_deg=np.full(4, lon), lat_deg=np.full(4, lat), height_m=recorded.height_m)
    _, done = transform_track(there, map_frame(Crs(map=code, coordinates="ITRF2020")))
    assert done.epoch is not None
    return np.array([done.epoch.east_m, done.epoch.north_m])


def test_other_countries__need_no_realisation() -> None:
    """Australia has moved by 7 cm a year to the north-east since 2020.0; NAD83 lies a metre or two from the ITRF."""
    years = 6.4
    np.testing.assert_allclose(moved_m("EPSG:7855", 148.0, -35.3) / years, [-0.018, -0.055], rtol=0, atol=0.01)
    assert 0.5 < np.hypot(*moved_m("EPSG:6345", -87.6, 42.0)) < 2.0


@pytest.mark.parametrize("asked", ["ITRF2020", "ITRF2020 to NAD83(2011)", "ITRF2020 to no frame"])
def test_map_on_etrs89__needs_the_realisation(asked: str) -> None:
    with pytest.raises(InputError) as caught:
        map_frame(Crs(map="EPSG:25832", coordinates=asked))
    assert caught.value.code == "frame-realization"
    assert "European Terrestrial Reference Frame 2000" in str(caught.value)


def test_frames_without_parameters__are_refused() -> None:
    with pytest.raises(RefusedError) as caught:
        map_frame(Crs(map="EPSG:2193", coordinates="ITRF2020"))  # New Zealand: a grid of velocities
    assert caught.value.code == "frame-change-unknown"
    assert "nzgd2000" in str(caught.value)
    with pytest.raises(RefusedError) as caught:
        map_frame(Crs(map="EPSG:2154", coordinates="ITRF2020"))  # France: RGF93
    assert caught.value.code == "frame-change-unknown"


def test_other_words__are_no_frames() -> None:
    with pytest.raises(InputError) as caught:
        map_frame(Crs(map="EPSG:25832", coordinates="today"))
    assert caught.value.code == "crs-coordinates"
