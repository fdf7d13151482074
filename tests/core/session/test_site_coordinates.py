"""What will happen to the coordinates, text before the run."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod, Transformer

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.session.site_coordinates import SiteCoordinates, site_coordinates

TSUKUBA = 140.08785504166664, 36.103774791666666


def session(folder: Path, crs: str, lon: float = TSUKUBA[0], lat: float = TSUKUBA[1], day: str = "2023-06-11") -> Path:
    """A session whose trajectory stands at a place."""
    rows = "".join(
        f"{np.datetime64(day).astype('datetime64[s]').astype(int) + i},{lon},{lat},70,0,0,0\n" for i in range(3)
    )
    (folder / "drive.csv").write_text(f"time_unix_s,lon_deg,lat_deg,h_m,roll_deg,pitch_deg,heading_deg\n{rows}")
    (folder / "none.pcap").write_bytes(b"")
    text = f'furrowmap = 1\n[recording]\nlidar = ["none.pcap"]\n[crs]\n{crs}\n[trajectory]\nfiles = ["drive.csv"]\n'
    (folder / "session.toml").write_text(text)
    return folder / "session.toml"


def words(site: SiteCoordinates) -> dict[str, str]:
    return dict(site.sentences)


def test_a_move_between_epochs_is_told_with_size_and_direction(shared_data: Path, tmp_path: Path) -> None:
    shutil.copyfile(shared_data / "geo" / "semidynaexe_sample.par", tmp_path / "SemiDyna2023.par")
    crs = 'map = "EPSG:6677"\nheights = "GSIGEO2011"\ncoordinates = "current-epoch"\nparameters = "SemiDyna2023.par"'
    site = site_coordinates(session(tmp_path, crs))
    said = words(site)
    assert "42.6 cm north-west" in said["positions"]
    assert "SemiDyna2023.par" in said["positions"]
    assert "9.6 cm down" in said["positions"]
    assert "40.186 m above the ellipsoid" in said["heights"]
    assert [move["step"] for move in site.plain()["moves"]] == ["epoch", "heights"]


def test_as_recorded_says_that_nothing_is_moved(tmp_path: Path) -> None:
    site = site_coordinates(session(tmp_path, 'map = "EPSG:6677"'))
    assert "are not transformed" in words(site)["positions"]
    assert "are ellipsoidal" in words(site)["heights"]
    assert site.plain()["moves"] == []


@pytest.mark.parametrize(("day", "geoid"), [("2025-03-31", "GSIGEO2011"), ("2026-06-11", "JPGEO2024")])
def test_in_japan_it_names_the_geoid_of_the_day_and_what_jgd2024_is(tmp_path: Path, day: str, geoid: str) -> None:
    said = words(site_coordinates(session(tmp_path, 'map = "EPSG:6677"', day=day)))
    assert f'`heights = "{geoid}"`' in said["heights"]
    assert "JGD2011 and JGD2024" in said["positions"]
    elsewhere = words(site_coordinates(session(tmp_path, 'map = "EPSG:32634"', 20.9, 52.4)))
    assert "JGD" not in elsewhere["positions"] + elsewhere["heights"]


@pytest.mark.parametrize(
    ("crs", "lon", "lat"),
    [
        ("EPSG:6677", *TSUKUBA),
        ("EPSG:32634", 20.9356, 52.3758),
        ("EPSG:32635", 23.9, 52.0),  # beyond the border of zone 34
        ("EPSG:32755", 147.3, -35.1),
        ("EPSG:32760", 179.9, -17.0),
        ("EPSG:32701", -179.9, -17.0),
    ],
)
def test_grid_figures_are_those_of_short_ways_on_the_ellipsoid(
    tmp_path: Path, crs: str, lon: float, lat: float
) -> None:
    """A way of 100 m to the true north, on the map: its direction is the convergence, its length the scale."""
    site = site_coordinates(session(tmp_path, f'map = "{crs}"', lon, lat))
    base = site.frame.crs.geodetic_crs
    to_map = Transformer.from_crs(base, crs, always_xy=True)
    geod = Geod(ellps="WGS84")
    ends = [geod.fwd(lon, lat, azimuth, 50.0)[:2] for azimuth in (180.0, 0.0)]
    (e0, n0), (e1, n1) = (to_map.transform(*end) for end in ends)
    assert site.convergence_deg == pytest.approx(-np.degrees(np.arctan2(e1 - e0, n1 - n0)), abs=1e-6)
    assert f"° {'east' if e1 < e0 else 'west'} of true north" in words(site)["grid"]
    assert site.scale == pytest.approx(np.hypot(e1 - e0, n1 - n0) / 100.0, abs=1e-8)
    assert site.hectare_m2 == pytest.approx(1e4 / site.scale**2, rel=1e-6)
    assert (site.easting_m, site.northing_m) == pytest.approx(to_map.transform(lon, lat), abs=1e-3)


def test_a_place_beyond_the_zone_is_told_the_better_one(tmp_path: Path) -> None:
    site = site_coordinates(session(tmp_path, 'map = "EPSG:32634"', 24.2, 52.0))
    assert "EPSG:32635" in words(site)["map"]


def test_a_missing_file_stops_as_the_run_would(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match=r"crs\.parameters"):
        site_coordinates(session(tmp_path, 'map = "EPSG:6677"\ncoordinates = "current-epoch"'))
