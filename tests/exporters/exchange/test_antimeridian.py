"""Products across the antimeridian: GeoJSON and STAC as RFC 7946 has them."""

import datetime as dt
import json
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.exporters.exchange.stac import table_item
from furrowmap.exporters.exchange.vectors import FORMATS, changed_crs, write_vectors
from furrowmap.exporters.files.provenance import Origin

FIJI = CRS("EPSG:32760")
FIELD_M = (819_735.0, 8_140_147.0, 819_843.0, 8_140_204.0)


def test_stac__box_has_west_beyond_east_and_the_footprint_is_cut() -> None:
    day = dt.date(2026, 5, 12)
    start = dt.datetime(2026, 5, 12, 9, 30, tzinfo=dt.UTC)
    item = table_item("passes", day, (start, start), FIJI, FIELD_M, [], {"passes.parquet": 1})
    west, south, east, north = item["bbox"]
    assert (round(west, 3), round(east, 3)) == (179.999, -179.999)
    assert south < -16.79 < north + 0.02
    footprint = shapely.geometry.shape(item["geometry"])
    assert footprint.geom_type == "MultiPolygon"
    assert all(np.ptp(np.array(part.bounds)[0::2]) < 0.01 for part in footprint.geoms)


def test_vectors__in_degrees_are_cut(tmp_path: Path) -> None:
    shapes = np.array([shapely.box(*FIELD_M), shapely.LineString([FIELD_M[:2], FIELD_M[2:]])], object)
    layers = {
        "field": VectorLayer(shapes[:1], {"name": np.array(["a"], object)}, FIJI),
        "path": VectorLayer(shapes[1:], {"name": np.array(["b"], object)}, FIJI),
    }
    degrees, _ = changed_crs(layers, CRS("EPSG:4326"))
    zone = ZoneInfo("Pacific/Fiji")
    for to in ("geojson", "flatgeobuf", "kml"):
        files, _ = write_vectors(FORMATS[to], tmp_path / to, degrees, Origin("test"), zone)
        assert files
    found = json.loads((tmp_path / "geojson" / "field.geojson").read_text())["features"][0]["geometry"]
    assert found["type"] == "MultiPolygon"
    assert (tmp_path / "kml").read_text().count("<Polygon>") == 2
