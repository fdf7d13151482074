"""What people read of a drive and of a flight: every word in Japanese, and every ± the same in all places."""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import furrowmap
from furrowmap.core.runtime.languages.texts import SHARE, texts_of
from furrowmap.core.runtime.settings import using
from furrowmap.core.values.margins import margin, with_margin
from furrowmap.exporters.files.result_folder import ResultFolder, open_result
from furrowmap.exporters.reports.page_language import in_language
from furrowmap.exporters.share import page as page_module
from tests.exporters.reports.page_texts import texts
from tests.exporters.vectors.test_style_words import SYMBOLS
from tests.test_end_to_end import session_folder
from tests.test_flight_end_to_end import flight_session

if TYPE_CHECKING:
    from conftest import QgisRoot

JAPANESE = texts_of("ja", SHARE)
CHECKOUT = Path(__file__).resolve().parents[2]
NAMES = {
    *("POSIX", "SBAS", "GNSS", "IMU", "FIX", "FLOAT", "RMS", "CRS", "EPSG", "JGD", "ETRS", "Japan", "UTM", "CS", "IX"),
    *("Plane", "Rectangular", "zone", "Europe", "Copenhagen", "Asia", "Tokyo", "LiDAR", "deg", "mps", "furrowmap"),
    *("parcels", "strip", "rotary", "tiller", "nbsp"),
}
"""Of devices, systems, places, layers; the tool's is the user's."""
CODE = re.compile(r"\[\w+\]|[\w./-]*[\w-][._/][\w./-]+")
"""Names of files and keys."""
MARGIN = re.compile(r"(?:[-+]?\d[\d,]*(?:\.\d+)? )?± \d[\d,]*(?:\.\d+)?(?:°| (?:cm|mm|m²|m³|s|ha)\b)")
SIGMAS = {
    "area_m2": ("area_sigma_m2", " m²", 1.0),
    "depth_m": ("depth_sigma_m", " cm", 100.0),
    "mean_height_m": ("height_sigma_m", " cm", 100.0),
    "volume_m3": ("volume_sigma_m3", " m³", 1.0),
}
"""Standard deviation, unit and factor of what layers have."""


@dataclass(frozen=True)
class Shown:
    """A result, and what people read of it in Japanese: in QGIS, of a farm map with it, and of its QField project."""

    result: ResultFolder
    qgis: dict[str, Any]
    farm: dict[str, Any]
    phone: dict[str, Any]

    @property
    def tips(self) -> list[list[str]]:
        """Map tips of all layers, in each of the three places."""
        places = [place["layers"].values() for place in (self.qgis, self.farm, self.phone)]
        return [[tip for words in place for tip in words.get("map tips", ())] for place in places]


@pytest.fixture(scope="module")
def shown(
    shared_data: Path,
    run_once: Callable[[str, Callable[[Path], Path]], furrowmap.Result],
    qgis: QgisRoot,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Shown]:
    """A drive and a flight."""
    work = tmp_path_factory.mktemp("shown")
    sessions = {
        "tractor_loop": partial(session_folder, shared_data, "tractor_loop", truth=False),
        "uav_wheat": partial(flight_session, shared_data),
    }
    places: dict[str, list[Path]] = {}
    for name, session in sessions.items():
        result = run_once(name, session)
        with using(language="ja"):
            furrowmap.add_to_farm_map(work / f"{name}.gpkg", [result.path])
        phone = furrowmap.share(result.path, work / name, qfield=True, language="ja")
        places[name] = [result.path, work / f"{name}.gpkg", phone.start]
    (work / "furrowmap").symlink_to(CHECKOUT / "plugin")
    script = Path(__file__).with_name("shown_in_qgis.py")
    told = qgis.run("python3", script, work / "furrowmap", *(place for three in places.values() for place in three))
    answers = iter(json.loads(told.splitlines()[-1]))
    return {name: Shown(open_result(three[0]), *(next(answers) for _ in three)) for name, three in places.items()}


def of_page(result: ResultFolder) -> Iterator[str]:
    """What the shared page says in Japanese."""
    for figure in page_module._figures(result.report):
        yield figure["value"]["ja"]
        yield from (JAPANESE.get(word, word) for word in figure["name"])
    for text in page_module._notes(result.report):
        yield text["ja"]
    layers, _, _ = page_module._layers(result, result.zone)
    for layer in layers:
        said = [layer["title"], *(one["label"] for one in layer["legend"])]
        said += [word for one in layer["features"] for row in one["rows"] for word in row]
        yield from (JAPANESE.get(word, word) for word in said)


def in_japanese(result: ResultFolder) -> list[str]:
    """The texts of `report.html` in Japanese."""
    page = (result.folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    return [html.unescape(text) for text in texts(in_language(page, "ja"))]


@pytest.mark.parametrize("name", ["tractor_loop", "uav_wheat"])
def test_result__is_japanese_everywhere(shown: dict[str, Shown], name: str) -> None:
    one = shown[name]
    said = {f"{where}: {layer}, {kind}": words
            for where, place in (("QGIS", one.qgis), ("farm map", one.farm), ("QField", one.phone))
            for layer, kinds in place["layers"].items() for kind, words in kinds.items()}  # fmt: skip
    said["dock"] = [word for row in one.qgis["figures"] for word in row]
    said |= {"print": one.qgis["print"], "page": list(of_page(one.result)), "report": in_japanese(one.result)}
    assert all(said[kind] for kind in ("dock", "print", "page", "report"))
    for place, words in said.items():
        for word in words:
            own = word.replace(one.result.name, " ").replace(str(one.result.folder), " ")
            latin = set(re.findall(r"[A-Za-z]{2,}", CODE.sub(" ", re.sub(r"<[^>]*>", " ", own))))
            assert latin <= SYMBOLS | NAMES, (place, word)


def margins_of_layer(result: ResultFolder, name: str) -> set[str]:
    """What stands with a ± of the features of a layer."""
    found = set()
    for row in result.layer(name).rows():
        for field, (sigma, unit, factor) in SIGMAS.items():
            if row.get(sigma):
                found.add(with_margin(row[field], row[sigma], unit, factor))
        if row.get("sigma_s"):
            found.add(margin(row["sigma_s"], " s"))
    return {words for words in found if "±" in words}


def margins_in(words: Any) -> set[str]:
    return {found for text in words for found in MARGIN.findall(html.unescape(text))}


@pytest.mark.parametrize("name", ["tractor_loop", "uav_wheat"])
def test_margins__are_the_same_everywhere(shown: dict[str, Shown], name: str) -> None:
    one = shown[name]
    report, accuracy = one.result.report, one.result.report["accuracy"]
    areas = {
        with_margin(report["figures"].get(f"{kind}_area_m2"), report["figures"].get(f"{kind}_area_sigma_m2"), " m²")
        for kind in ("worked", "overlap", "missed", "unworked")
    }
    east, north, up, heading = (accuracy[f"sigma_{axis}"]["median"] for axis in ("e_m", "n_m", "h_m", "heading_deg"))
    main = {words for words in areas if "±" in words} | {
        margin(math.hypot(east, north), " cm", 100.0),
        margin(up, " cm", 100.0),
    }
    whole = main | {margin(heading, "°")}
    features = {layer: margins_of_layer(one.result, layer) for layer in one.result.layer_names}
    rows = features.get("passes", set()) | features.get("parcels", set())
    assert len(rows) >= 6
    every = set().union(*features.values())
    assert margins_in(word for row in one.qgis["figures"] for word in row) == whole
    assert margins_in(one.qgis["print"]) == whole | features.get("passes", set())
    page = margins_in(of_page(one.result))
    sheet = margins_in(
        [
            re.sub(
                "<[^>]*>", "\n", (one.result.folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
            )
        ]
    )
    assert main | rows <= page <= main | every
    assert whole | rows <= sheet
    for tips in one.tips:
        assert rows <= margins_in(tips) <= every
    assert all("(95 %)" in text for text in chain(one.qgis["print"], *one.tips) if "±" in text)
