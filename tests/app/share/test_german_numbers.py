"""The report page and the shared page of a drive in German: the numbers of the English ones, with their own marks."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import shapely

import furrowmap
from furrowmap.core.runtime.languages.texts import LANGUAGES, in_marks
from furrowmap.exporters.share import page as page_module
from tests.app.told_progress import Told
from tests.exporters.reports.page_texts import NUMBER, decimal_points, in_german, numbers, texts

if TYPE_CHECKING:
    from playwright.sync_api import Browser


def written(result: furrowmap.Result | Path, path: Path, language: str, unit: str | None = None) -> str:
    folder = result if isinstance(result, Path) else result.path
    return furrowmap.write_report_page(folder, path, language=language, area_unit=unit).read_text(encoding="utf-8")


@pytest.mark.parametrize("unit", ["ha", "10a", "acre"])
def test_report__has_the_numbers_of_the_english_one(result: furrowmap.Result, tmp_path: Path, unit: str) -> None:
    english, german = (written(result, tmp_path / f"{one}.html", one, unit) for one in ("en", "de"))
    assert numbers(german) == Counter({in_german(key): n for key, n in numbers(english).items()})
    assert not [text for text in texts(german) if decimal_points(text)]
    assert sum("," in number for number in numbers(german)) > 20


@pytest.mark.parametrize("unit", ["ha", "10a", "acre"])
def test_report__changes_the_marks_of_areas_with_its_language(
    result: furrowmap.Result, tmp_path: Path, unit: str
) -> None:
    """The unit stays the one that the page has."""
    page = tmp_path / "report.html"
    english = written(result, page, "en", unit)
    german = written(tmp_path, page, "de")
    assert german == written(result, tmp_path / "other.html", "de", unit)
    assert re.search(r'<data class="area" value="[\d.]+"[^>]*>\d+,\d+', german)
    assert written(tmp_path, page, "en") == english


def test_report__in_json_has_german_numbers_in_german_texts_alone(result: furrowmap.Result) -> None:
    report = json.loads((result.path / "report.json").read_text(encoding="utf-8"))
    assert report["warnings"]
    for warning in report["warnings"]:
        assert not decimal_points(warning["text_de"])


@pytest.fixture(scope="module")
def shared(result: furrowmap.Result, page_scripts: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page_module, "MAX_SHARED_POINTS", 1_000)
        out = tmp_path_factory.mktemp("shared") / "page"
        return furrowmap.share(result.path, out, language="de", progress=Told()).folder


def script(folder: Path) -> dict[str, Any]:
    text = (folder / "data.js").read_text(encoding="ascii")
    content: dict[str, Any] = json.loads(text.removeprefix("window.furrowmapData=").removesuffix(";\n"))
    return content


def test_shared_page__has_its_figures_in_german(shared: Path) -> None:
    figures = script(shared)["figures"]
    assert sum("," in figure["value"]["de"] for figure in figures) > 4
    for figure in figures:
        values = {language: NUMBER.findall(figure["value"][language]) for language in LANGUAGES}
        assert values["de"] == [in_german(number) for number in values["en"]]
        assert values["ja"] == values["en"]


def test_shared_page__shows_a_tapped_pass_and_the_cloud_with_german_numbers(shared: Path, browser: Browser) -> None:
    data = script(shared)
    context = browser.new_context(viewport={"width": 1280, "height": 800}, locale="de-DE")
    page = context.new_page()
    page.goto(f"{shared.as_uri()}/index.html")
    page.wait_for_selector("body[data-map=shown]")
    page.uncheck("#layers input[name=coverage]")  # it lies above the passes
    page.check("#layers input[name=passes]")
    panel = page.inner_text("#panel").split("furrowmap", maxsplit=1)[0]
    assert not decimal_points(panel), panel
    passes = next(layer for layer in data["layers"] if layer["name"] == "passes")
    inside = shapely.geometry.shape(passes["features"][0]["geometry"]).representative_point()
    place = page.evaluate(
        "([x, y]) => { const [a, b] = furrowmapPage.map.getPixelFromCoordinate([x, y]);"
        " const box = document.getElementById('map').getBoundingClientRect(); return [box.x + a, box.y + b]; }",
        [inside.x, inside.y + 0.4],
    )
    page.mouse.click(*place)
    page.wait_for_selector("#card:not([hidden])")
    card = page.inner_text("#card")
    assert in_marks(dict(passes["features"][0]["rows"])["Area"], "de") in card
    assert not decimal_points(card), card
    page.click("#solid")
    page.wait_for_selector("body[data-cloud=shown]")
    heights = page.inner_text("#cloud-key .key")
    assert re.search(r"\d,\d\d m", heights)
    page.select_option("#language", "en")
    assert re.search(r"\d\.\d\d m", page.inner_text("#cloud-key .key"))
    context.close()
