"""Fields, areas and parcels across the antimeridian, in every notation, are those of the same ground elsewhere."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS, Geod

from furrowmap.core.readers.areas.area import polygons_on_map, read_area
from furrowmap.core.readers.boundary_file import read_fields
from furrowmap.core.readers.facts import position_facts
from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.poses.pose_file import pose_facts
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.pose_track import PoseTrack

WGS84 = Geod(ellps="WGS84")
UTM_60S = CRS("EPSG:32760")
WIDE, HIGH, SOUTH = 0.001, 0.0005, -16.8
UNREADABLE = partial(InputError, "boundary-unreadable", path=Path("field"), formats="")


def ring(west: float, east: float) -> list[list[float]]:
    north = SOUTH + HIGH
    return [[west, SOUTH], [east, SOUTH], [east, north], [west, north], [west, SOUTH]]


def notations(west: float) -> dict[str, dict[str, object]]:
    """One field from 0.0005° west of the antimeridian to 0.0005° east of it, as programs write it."""
    east = west + WIDE
    hole = [[179.9998, SOUTH + 0.0001], [-179.9998, SOUTH + 0.0001], [-179.9998, SOUTH + 0.0002]]
    return {
        "beyond 180": {"type": "Polygon", "coordinates": [ring(west, east)]},
        "beyond -180": {"type": "Polygon", "coordinates": [ring(west - 360.0, east - 360.0)]},
        "in one ring": {"type": "Polygon", "coordinates": [ring(west, east - 360.0)]},
        "from the east": {"type": "Polygon", "coordinates": [[*ring(west, east - 360.0)[1:], [east - 360.0, SOUTH]]]},
        "cut": {"type": "MultiPolygon", "coordinates": [[ring(west, 180.0)], [ring(-180.0, east - 360.0)]]},
        "cut, east first": {"type": "MultiPolygon", "coordinates": [[ring(-180.0, east - 360.0)], [ring(west, 180.0)]]},
        "with a hole": {"type": "Polygon", "coordinates": [ring(west, east - 360.0), [*hole, hole[0]]]},
    }


def written(folder: Path, name: str, geometry: dict[str, object]) -> Path:
    path = folder / f"{name}.geojson"
    feature = {"type": "Feature", "properties": {"id": "1", "name": "field"}, "geometry": geometry}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}), encoding="utf-8")
    return path


def test_fields__in_every_notation_are_one_field(tmp_path: Path) -> None:
    elsewhere = read_fields(written(tmp_path, "there", {"type": "Polygon", "coordinates": [ring(150.0, 150.001)]}))[0]
    area = abs(WGS84.geometry_area_perimeter(elsewhere[0].outline)[0])
    for name, geometry in notations(179.9995).items():
        (field,) = read_fields(written(tmp_path, name, geometry))[0]
        assert field.outline.geom_type == "Polygon", name
        assert np.ptp(np.array(field.outline.bounds)[0::2]) == pytest.approx(WIDE, abs=1e-9), name
        found = abs(WGS84.geometry_area_perimeter(shapely.orient_polygons(field.outline))[0])
        share = 1.0 - 0.5 * 0.0004 * 0.0001 / (WIDE * HIGH) if name == "with a hole" else 1.0
        assert found == pytest.approx(share * area, rel=1e-5), name


@pytest.mark.parametrize("crs", ["EPSG:32760", "EPSG:32701", "EPSG:3832"])
def test_areas__in_every_notation_are_valid_and_the_same_on_the_map(crs: str, tmp_path: Path) -> None:
    whole = None  # cut fields have corners more, and a parallel is curved
    for name, geometry in notations(179.9995).items():
        if name == "with a hole":
            continue
        area = read_area(written(tmp_path, name, geometry), CRS(crs))
        assert len(area.polygons) == 1, name
        whole = whole or area.polygons[0]
        assert shapely.symmetric_difference(whole, area.polygons[0]).area < 0.01, (
            name
        )  # a parallel is curved, and a cut one has a corner more


def test_corner_tables__in_degrees(tmp_path: Path) -> None:
    path = tmp_path / "corners.csv"
    rows = "".join(f"a,{lon},{lat}\n" for lon, lat in ring(179.9995, -179.9995)[:-1])
    path.write_text("id,lon_deg,lat_deg\n" + rows)
    (shape,) = polygons_on_map(path, UTM_60S, UNREADABLE).shapes
    assert shape.area == pytest.approx(5908.666, abs=0.01)


def test_features_on_both_sides__are_joined_to_a_whole(tmp_path: Path) -> None:
    halves = [ring(179.9995, 180.0), ring(-180.0, -179.9995)]
    features = [
        {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [half]}} for half in halves
    ]
    path = tmp_path / "two.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    area = read_area(path, UTM_60S)
    assert sum(part.area for part in area.polygons) == pytest.approx(5908.666, abs=0.01)


def test_task_data__with_rings_across_the_antimeridian(tmp_path: Path) -> None:
    def line(corners: list[list[float]]) -> str:
        points = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in corners[:-1])
        return f'<LSG A="1">{points}</LSG>'

    for number, rings in enumerate(([ring(179.9995, -179.9995)], [ring(179.9995, 180.0), ring(-180.0, -179.9995)])):
        folder = tmp_path / f"TASKDATA{number}"
        folder.mkdir()
        polygon = f'<PLN A="1">{"".join(map(line, rings))}</PLN>'
        text = f'<ISO11783_TaskData VersionMajor="4"><PFD A="PFD1" C="field" D="0">{polygon}</PFD></ISO11783_TaskData>'
        (folder / "TASKDATA.XML").write_text(text)
        (field,) = read_fields(folder)[0]
        assert field.outline.geom_type == "Polygon"
        assert abs(WGS84.geometry_area_perimeter(field.outline)[0]) == pytest.approx(5898.46, abs=0.01)


def test_poses__state_west_and_east(tmp_path: Path) -> None:
    t_s = np.arange(5.0)
    lon = np.array([179.9998, 179.9999, -180.0, -179.9999, -179.9998])
    position = np.column_stack([lon, np.full(5, SOUTH), np.zeros(5)])
    level = np.zeros(5)
    track = PoseTrack(t_s, position, False, level, level, level, True, np.full((5, 6), np.nan))
    assert pose_facts(track)["lon_deg"] == [179.9998, -179.9998]


def test_datum__is_refused_in_every_notation(tmp_path: Path) -> None:
    for name, geometry in notations(179.9995).items():
        with pytest.raises(InputError) as refused:
            polygons_on_map(written(tmp_path, name, geometry), CRS("EPSG:3460"), UNREADABLE)
        assert refused.value.code == "polygons-datum", name


def test_foreign_field__of_fiji(shared_data: Path) -> None:
    folder = shared_data / "foreign" / "17-antimeridian"
    for name in ("over", "split", "unsplit"):
        (field,) = read_fields(folder / f"{name}.geojson")[0]
        assert abs(WGS84.geometry_area_perimeter(field.outline)[0]) == pytest.approx(5898.5, abs=0.1), name
        (shape,) = polygons_on_map(folder / f"{name}.geojson", UTM_60S, UNREADABLE).shapes
        assert shape.area == pytest.approx(5908.7, abs=0.1), name
    facts = position_facts(NmeaLog([folder / "half.nmea"], ReadOptions()).track())
    assert abs(facts["place"]["lon_deg"]) == pytest.approx(180.0, abs=1e-4)
    assert facts["place"]["lat_deg"] == pytest.approx(-16.8, abs=1e-4)
