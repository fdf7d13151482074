"""The depth of a pass comes with twice its standard deviation wherever people read it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import geopandas as gpd
import numpy as np
import pytest

from furrowmap.core.coverage.field_work import SOIL_SIGMA_M
from furrowmap.core.values.margins import with_margin
from furrowmap.exporters.files.result_folder import open_result, packaged_style
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.reports.page_language import chosen
from furrowmap.exporters.share.page_features import shared_layer
from furrowmap.workflows.share.export import export
from tests.exporters.farm.result_folders import field, write_result

TOKYO = ZoneInfo("Asia/Tokyo")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_result(tmp_path_factory.mktemp("depths") / "result")


def test_depth__in_report_page_and_kml(written: Path, tmp_path: Path) -> None:
    passes = gpd.read_file(written / "field.gpkg", layer="passes")
    np.testing.assert_allclose(passes["depth_sigma_m"], np.hypot(SOIL_SIGMA_M, passes["depth_spread_m"]))
    export([written], "kml", tmp_path / "field.kml")
    marks = ET.parse(tmp_path / "field.kml").findall(".//{*}Data[@name='depth_sigma_m']")
    page = shared_layer("passes", open_result(written).layer("passes"), TOKYO, shown=True)
    report = chosen(render("passes.html", work=field()[1], zone=TOKYO, several=False, max_rows=60), "en")
    assert page is not None
    assert "depth (approximate, ± 95 %)" in report
    for one, mark, shown in zip(passes.itertuples(), marks, page["features"], strict=True):
        words = with_margin(one.depth_m, one.depth_sigma_m, " cm", 100.0)
        assert dict(shown["rows"])["Depth (approximate)"] == f"{words} (95 %)"
        assert f"<td>{words}</td>" in report
        assert mark.findtext("{*}displayName") == "standard deviation of the depth (m)"
        assert float(mark.findtext("{*}value") or "nan") == pytest.approx(one.depth_sigma_m, abs=1e-4)


@pytest.mark.parametrize("layer", ["passes", "coverage", "zones", "misses", "overlaps"])
def test_map_tips__have_no_sign_for_a_standard_deviation_that_is_unknown(layer: str) -> None:
    tip = packaged_style(f"{layer}.qml").partition("<mapTip")[2]
    assert "area_sigma_m2" in tip
    for before in tip.split("±")[:-1]:
        assert before.endswith("' ")
        assert "coalesce(" in before
