"""Each page of the atlas names its pass and shows the figures of that pass alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np

from tests.exporters.farm.result_folders import write_result

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[2]


def test_pages__of_the_passes_have_their_own_figures(qgis: QgisRoot, tmp_path: Path) -> None:
    """It begins at 15:00 UTC, midnight in Japan."""
    result = write_result(tmp_path / "result")
    report = json.loads((result / "report.json").read_text(encoding="utf-8"))
    report["figures"] |= {"time_zone": "Asia/Tokyo", "start_local": "2026-06-12T00:00:00.000+09:00"}
    (result / "report.json").write_text(json.dumps(report), encoding="utf-8")
    (tmp_path / "furrowmap").symlink_to(CHECKOUT / "plugin")
    qgis.run("python3", Path(__file__).with_name("atlas_in_qgis.py"), tmp_path / "furrowmap", result, tmp_path)
    whole = qgis.run("pdftotext", "-layout", tmp_path / "page.pdf", "-")
    pages = qgis.run("pdftotext", "-layout", tmp_path / "atlas.pdf", "-").split("\f")[:-1]
    passes = gpd.read_file(result / "field.gpkg", layer="passes")
    assert f"{report['figures']['worked_area_m2']:.1f} m²" in whole
    assert len(pages) == len(passes) == 3
    for page, one in zip(pages, passes.itertuples(), strict=True):
        assert f"North field, pass {passes['pass'][one.Index]}" in page
        assert f"{one.area_m2:.1f} ± {2 * one.area_sigma_m2:.1f} m²" in page
        assert f"{one.length_m:.1f} m" in page
        assert f"{100 * one.depth_m:.0f} ± {200 * one.depth_sigma_m:.0f} cm" in page
        local = one.start.tz_convert("Asia/Tokyo")
        assert f"{local:%H:%M:%S}" in page
        assert "(Asia/Tokyo)" in page
    assert len(set(np.round(passes["area_m2"], 1))) > 1
