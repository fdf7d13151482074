"""The boundary among the files of a folder: taken where it is the drive's, told with the reason where it is not."""

from __future__ import annotations

from pathlib import Path

import geopandas as gpd
import pytest
from shapely import Point, box

from furrowmap.core.session.examination import Examined
from furrowmap.core.session.proposal import Proposal, propose_session
from furrowmap.core.session.session_file import parse_session
from furrowmap.core.session.trial_files import TrialFiles

LAT_DEG, LON_DEG = 36.0, 140.0


def log(folder: Path) -> Path:
    """A short drive to the north from 36° N, 140° E."""
    rows = []
    for second in range(20):
        row = f"GPGGA,0123{second:02d}.00,3600.{second:04d},N,14000.0000,E,4,18,0.6,25.0,M,40.0,M,1.0,0001"
        check = 0
        for sign in row:
            check ^= ord(sign)
        rows.append(f"${row}*{check:02X}\r\n")
    path = folder / "gnss.nmea"
    path.write_text("".join(rows))
    return path


def polygon(path: Path, east_deg: float = 0.0, **layer: str) -> None:
    """A square of some 200 m about the drive, or so far east of it."""
    shape = box(LON_DEG - 0.001 + east_deg, LAT_DEG - 0.001, LON_DEG + 0.001 + east_deg, LAT_DEG + 0.001)
    gpd.GeoDataFrame({"name": ["North"]}, geometry=[shape], crs="EPSG:4326").to_file(path, **layer)


def proposal(folder: Path) -> Proposal:
    recording = log(folder)
    beside = TrialFiles.among(sorted(folder.iterdir()))
    return propose_session([Examined.read(recording)], folder, beside=beside)


def unused(found: Proposal) -> dict[str, str]:
    return {dict(notice.values)["file"]: notice.key for notice in found.missing if notice.code == "recording-unused"}


@pytest.mark.parametrize("name", ["boundary.geojson", "parcel 12.shp", "圃場.gpkg"])
def test_boundary__of_the_drive_is_in_the_session(tmp_path: Path, name: str) -> None:
    polygon(tmp_path / name)
    found = proposal(tmp_path)
    session = parse_session(found.text)
    assert session.field.boundary == name
    assert unused(found) == {}
    assert any(name in notice.text and "boundary of the field" in notice.text for notice in found.found)


def test_boundary__that_is_not_used_is_told_with_its_reason(tmp_path: Path) -> None:
    polygon(tmp_path / "boundary far.geojson", east_deg=0.1)
    polygon(tmp_path / "field.geojson")
    polygon(tmp_path / "more.geojson")
    (tmp_path / "broken boundary.shp").write_bytes(b"no shapefile")
    polygon(tmp_path / "boundary farm.gpkg", layer="fields")
    polygon(tmp_path / "boundary farm.gpkg", layer="sessions")
    found = proposal(tmp_path)
    session = parse_session(found.text)
    assert session.field.boundary == "field.geojson"
    assert unused(found) == {
        "boundary far.geojson": "recording-unused.boundary-elsewhere",
        "more.geojson": "recording-unused.other-boundary",
        "broken boundary.shp": "recording-unused",
        "boundary farm.gpkg": "recording-unused.several-layers",
    }
    elsewhere = next(notice for notice in found.missing if notice.key == "recording-unused.boundary-elsewhere")
    assert dict(elsewhere.values)["apart_m"] == pytest.approx(0.099 * 111_195.0 * 0.809, rel=0.01)


def test_points__are_no_boundary(tmp_path: Path) -> None:
    gpd.GeoDataFrame({"n": [1]}, geometry=[Point(LON_DEG, LAT_DEG)], crs="EPSG:4326").to_file(tmp_path / "tree.geojson")
    found = proposal(tmp_path)
    assert parse_session(found.text).field.boundary is None
    assert unused(found) == {"tree.geojson": "recording-unused"}


def test_flight__has_no_use_for_a_boundary(shared_data: Path) -> None:
    folder = shared_data / "uav_wheat"
    beside = TrialFiles.among([folder / "parcels.geojson", shared_data / "tractor_loop" / "boundary.geojson"])
    recordings = [Examined.read(folder / name) for name in ("imu.csv", "gnss.nmea")]
    found = propose_session(recordings, folder, None, beside)
    assert "[field]" not in found.text
    assert unused(found) == {"boundary.geojson": "recording-unused.boundary-of-flight"}
