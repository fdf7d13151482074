"""The layer of the fields in task data: outlines where they are known, and whose field and task each row is."""

from __future__ import annotations

from pathlib import Path

import geopandas
import pytest
from pyproj import Geod

from furrowmap.core.coverage.task_work import task_works
from furrowmap.exporters.vectors.task_fields import write_fields
from tests.core.coverage.test_task_work import passes

CORNERS = [(141.339, 43.049), (141.341, 43.049), (141.341, 43.051)]


@pytest.mark.parametrize(("corner", "known"), [("141.341", True), ("0.0", False)])
def test_fields__have_their_outline_where_it_is_usable(corner: str, known: bool, tmp_path: Path) -> None:
    """The boundary is a right-angled triangle, 0.002° by 0.002°; with a corner far away it is dropped."""
    works = task_works(passes(tmp_path, corner=corner))
    write_fields(tmp_path / "fields.gpkg", works)
    (row,) = geopandas.read_file(tmp_path / "fields.gpkg", layer="fields").itertuples()
    assert (row.task, row.field, row.passes) == ("TSK1", "north", 3)
    assert (row.geometry is not None) == known
    layer = geopandas.read_file(tmp_path / "fields.gpkg", layer="passes")
    assert set(layer["task"]) == {"TSK1"}
    assert set(layer["field"]) == {"north"}
    if known:
        area_m2 = abs(Geod(ellps="GRS80").polygon_area_perimeter(*zip(*CORNERS, strict=True))[0])
        assert row.boundary_area_m2 == pytest.approx(area_m2, rel=1e-4)
        assert row.geometry.area == pytest.approx(area_m2, rel=2e-3)  # of the map's plane
