"""Every accuracy that a result states, against the truth of sessions that were filled in wrongly by hand."""

from __future__ import annotations

import html
import importlib.util
import json
import re
import sys
import types
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pytest
import rasterio
import rasterio.transform

import furrowmap
from furrowmap.core.values.trajectory import SIGMA_NAMES
from furrowmap.exporters.reports.area_units import HECTARE, area_text

FIGURES = Path(__file__).resolve().parents[2] / "plugin" / "figures.py"
PLACES = r"\[(?:antenna|lidar)\]\n(?:[^\[\n][^\n]*\n)*\n?"
WRONG = {
    "nothing filled in": lambda text: re.sub(PLACES, "", text),
    "a scanner 64 cm too low": lambda text: text.replace("0.041, 2.416]", "0.041, 1.776]"),
    "an antenna 40 cm too far to the left": lambda text: text.replace("[1.847, -0.052,", "[1.847, 0.348,"),
}
RESTS_ON = {
    "sigma_e_m": {"antenna.xyz_m"},
    "sigma_n_m": {"antenna.xyz_m"},
    "sigma_h_m": {"antenna.xyz_m", "lidar.xyz_m"},
    "sigma_heading_deg": {"antenna.xyz_m", "lidar.rpy_deg"},
}
"""The stated places on which a claim rests."""
IN_DOCK = {
    "antenna.xyz_m": "position of the antenna",
    "lidar.xyz_m": "position of the scanner",
    "lidar.rpy_deg": "orientation of the scanner",
}
LEAST_M = 0.03
"""Errors below it are not worth a claim: the truth itself is gridded."""


@pytest.fixture(scope="module", params=WRONG)
def wrong(
    request: pytest.FixtureRequest, simulated: furrowmap.Simulated, tmp_path_factory: pytest.TempPathFactory
) -> furrowmap.Result:
    text = simulated.session.read_text(encoding="utf-8")
    session = simulated.session.with_name("misstated.toml")
    session.write_text(WRONG[request.param](text), encoding="utf-8")
    assert session.read_text(encoding="utf-8") != text
    return furrowmap.run(session, tmp_path_factory.mktemp("misstated") / "result")


def dock_rows(report: dict[str, Any]) -> dict[str, str]:
    """What the dock shows of a report; the plugin's words without QGIS around them."""
    core = types.ModuleType("qgis.PyQt.QtCore")
    core.QCoreApplication = types.SimpleNamespace(translate=lambda _context, text: text)  # type: ignore[attr-defined]
    core.QDateTime = types.SimpleNamespace(  # type: ignore[attr-defined]
        fromString=lambda *_: types.SimpleNamespace(isValid=lambda: False)
    )
    qgis_core = types.ModuleType("qgis.core")
    qgis_core.QgsApplication = types.SimpleNamespace(locale=lambda: "en")  # type: ignore[attr-defined]
    core.Qt = types.SimpleNamespace(DateFormat=types.SimpleNamespace(ISODateWithMs=0))  # type: ignore[attr-defined]
    core.QLocale = core.QXmlStreamReader = None  # type: ignore[attr-defined]
    core.QTranslator = object  # type: ignore[attr-defined]
    spec = importlib.util.spec_from_file_location("dock_of_claims.figures", FIGURES)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        package = types.ModuleType("dock_of_claims")
        package.__path__ = [str(FIGURES.parent)]
        patch.setitem(sys.modules, "dock_of_claims", package)
        patch.setitem(sys.modules, "qgis", types.ModuleType("qgis"))
        patch.setitem(sys.modules, "qgis.core", qgis_core)
        patch.setitem(sys.modules, "qgis.PyQt", types.ModuleType("qgis.PyQt"))
        patch.setitem(sys.modules, "qgis.PyQt.QtCore", core)
        spec.loader.exec_module(module)
        return dict(module.figure_rows(report))


def errors(result: furrowmap.Result, truth: Path) -> dict[str, float]:
    """Median error of the vehicle's place and heading, and of the surface, against the truth."""
    table = np.genfromtxt(truth / "trajectory.csv", delimiter=",", names=True)
    poses: gpd.GeoDataFrame = result.layer("trajectory")
    t_s = poses["t_s"].to_numpy()
    e, n, h, heading = (np.interp(t_s, table["time_unix_s"], table[k]) for k in ("e_m", "n_m", "h_m", "heading_deg"))
    turned = (poses["heading_deg"].to_numpy() - heading + 180.0) % 360.0 - 180.0
    off = {
        "sigma_e_m": poses.geometry.x.to_numpy() - e,
        "sigma_n_m": poses.geometry.y.to_numpy() - n,
        "sigma_h_m": poses.geometry.z.to_numpy() - h,
        "sigma_heading_deg": turned,
    }
    found = {name: abs(float(np.median(values))) for name, values in off.items()}
    found["sigma_h_m"] = max(found["sigma_h_m"], surface_error(result.path / "dsm.tif", truth / "surface.npz"))
    return found


def surface_error(dsm: Path, truth: Path) -> float:
    with np.load(truth) as held, rasterio.open(dsm) as made:
        height, step = made.read(1, masked=True).filled(np.nan), float(held["cell_m"])
        row, column = np.indices(height.shape)
        x, y = (
            np.reshape(values, height.shape)
            for values in rasterio.transform.xy(made.transform, row.ravel(), column.ravel())
        )
        i, j = ((y - held["n0"]) / step).astype(int), ((x - held["e0"]) / step).astype(int)
        inside = (i >= 0) & (i < held["after"].shape[0]) & (j >= 0) & (j < held["after"].shape[1])
        ground = held["after"][i[inside], j[inside]] + held["h0_m"]
        return abs(float(np.nanmedian(height[inside] - ground)))


def test_promise__no_accuracy_is_claimed_that_is_wrong(wrong: furrowmap.Result, simulated: furrowmap.Simulated) -> None:
    """A claim holds within three standard deviations, or names the place it rests on beside it, or there is none."""
    report, page = wrong.report, (wrong.path / "report.html").read_text(encoding="utf-8")
    accuracy, rows = report["accuracy"], dock_rows(report)
    conditions = [*accuracy["unstated"], *accuracy["unconfirmed"]]
    for name, error in errors(wrong, simulated.folder / "truth").items():
        claimed = accuracy[name]["median"]
        floor = LEAST_M if name.endswith("_m") else 0.3
        if RESTS_ON[name].isdisjoint(conditions) and error > floor:
            assert claimed is None or error < 3.0 * claimed, (name, error, claimed)
    for key in conditions:
        assert IN_DOCK[key] in rows["Accuracy"]
        assert key in page[page.index("Accuracy and warnings") :]
    for key in accuracy["unstated"]:
        assert any(f"[{key.split('.')[0]}]" in doubt for doubt in report["verdict"]["doubts"])
    alarms = page[: page.index("<section")]
    assert alarms.count('class="alarm"') == len(report["verdict"]["findings"])
    assert all(html.escape(doubt) in alarms for doubt in report["verdict"]["doubts"])


@pytest.mark.parametrize("wrong", ["nothing filled in"], indirect=True)
def test_promise__what_was_not_filled_in_claims_nothing(wrong: furrowmap.Result) -> None:
    report = wrong.report
    assert report["accuracy"]["unstated"] == ["antenna.xyz_m", "lidar.xyz_m", "lidar.rpy_deg"]
    assert {value for name in SIGMA_NAMES for value in report["accuracy"][f"sigma_{name}"].values()} == {None}
    assert [label for label in dock_rows(report) if "ccuracy" in label] == ["Accuracy"]
    assert not [row for row in dock_rows(report).values() if "±" in row]
    page = (wrong.path / "report.html").read_text(encoding="utf-8")
    claims = page[page.index("margin of error") : page.index("± is twice")]
    assert not re.search(r"\d (cm|°)", claims)
    layer = wrong.layer("trajectory")
    assert layer[[f"sigma_{name}" for name in SIGMA_NAMES]].isna().all(axis=None)
    item = json.loads((wrong.path / "item.json").read_text(encoding="utf-8"))
    assert item["properties"]["furrowmap:unstated"] == report["accuracy"]["unstated"]
    with rasterio.open(wrong.path / "dsm.tif") as dsm:
        assert "antenna.xyz_m" in dsm.tags()["NOT_STATED"]


@pytest.mark.parametrize("sigma_m2", [0.0, 0.2])
@pytest.mark.parametrize("area_m2", [0.0, 4.2, 42.5, 999.9, 5421.3, 25_000.0])
def test_dock__has_areas_in_the_digits_and_units_of_pages(area_m2: float, sigma_m2: float) -> None:
    level = " (95 %)" if area_m2 * sigma_m2 > 0.0 else ""
    shown = dock_rows({"figures": {"worked_area_m2": area_m2, "worked_area_sigma_m2": sigma_m2}})["Worked"]
    assert shown == str(area_text(area_m2, HECTARE, sigma_m2 if area_m2 > 0.0 else None)) + level


def test_dock__shows_the_shares_of_positions_without_rounding_any_away() -> None:
    shares = {"fixed": 0.9996, "float": 0.0, "none": 0.0004}
    shown = dock_rows({"figures": {"fix": shares}})["Positions"]
    assert shown == "RTK fixed > 99.9 %, no position < 0.1 %, RTK float 0 %"
    assert dock_rows({"figures": {"fix": {"fixed": 1.0}}})["Positions"] == "RTK fixed 100 %"
