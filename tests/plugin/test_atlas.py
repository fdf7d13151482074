"""Pages of the atlas show the figures of their pass alone; legends have the colours of the map."""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np
import pytest

from furrowmap.core.values.margins import with_margin
from furrowmap.exporters.reports.drawings import pass_colour
from tests.exporters.farm.result_folders import write_result

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[2]


def test_pages__of_the_passes_have_their_own_figures(
    qgis: QgisRoot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It begins at 15:00 UTC, midnight in Japan."""
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    result = write_result(tmp_path / "result")
    report = json.loads((result / "report.json").read_text(encoding="utf-8"))
    report["figures"] |= {"time_zone": "Asia/Tokyo", "start_local": "2026-06-12T00:00:00.000+09:00"}
    report["verdict"] = {"text": "These results contradict each other: positions drift.", "doubts": ["No mounting."]}
    (result / "report.json").write_text(json.dumps(report), encoding="utf-8")
    (tmp_path / "furrowmap").symlink_to(CHECKOUT / "plugin")
    told = qgis.run("python3", Path(__file__).with_name("atlas_in_qgis.py"), tmp_path / "furrowmap", result, tmp_path)
    whole = qgis.run("pdftotext", "-layout", tmp_path / "page.pdf", "-")
    printed = qgis.run("pdftotext", "-layout", tmp_path / "atlas.pdf", "-")
    pages = unicodedata.normalize("NFKC", printed).split("\f")[:-1]  # without ligatures
    passes = gpd.read_file(result / "field.gpkg", layer="passes")
    assert f"{report['figures']['worked_area_m2']:.1f} m²" in whole
    assert len(pages) == len(passes) == 3
    assert all("contradict each other: positions drift." in page and "No mounting." in page for page in (whole, *pages))
    for page, one in zip(pages, passes.itertuples(), strict=True):
        assert f"North field, pass {passes['pass'][one.Index]}" in page
        assert f"{with_margin(one.area_m2, one.area_sigma_m2, ' m²')} (95 %)" in page.replace("m2", "m²")
        assert f"{one.length_m:.1f} m" in page
        assert f"{with_margin(one.depth_m, one.depth_sigma_m, ' cm', 100.0)} (95 %)" in page
        local = one.start.tz_convert("Asia/Tokyo")
        assert f"{local:%H:%M:%S}" in page
        assert "(Asia/Tokyo)" in page
    seen = json.loads(told.splitlines()[-1])
    assert seen["pages of two tools"] == ["front, pass 2", "rear, pass 1", "rear, pass 3"]
    assert "2026-06-12 01:23 (JST)" in seen["old report"].values()
    assert {"map", "legend", "scale"} < {name for name, *_ in seen["boxes"]}
    for k, (name, left, top, right, bottom) in enumerate(seen["boxes"]):
        assert 0.0 <= left < right <= 297.0, name
        assert 0.0 <= top < bottom <= 210.0, name
        for other, *box in seen["boxes"][:k]:
            assert box[0] >= right or box[2] <= left or box[1] >= bottom or box[3] <= top, (name, other)
    colours = {"first pass": pass_colour(1, 3), "passes between": pass_colour(2, 3), "last pass": pass_colour(3, 3)}
    assert {label: seen["legend"][label] for label in colours} == colours  # those of the map, of the report and of KML
    assert len(set(np.round(passes["area_m2"], 1))) > 1
