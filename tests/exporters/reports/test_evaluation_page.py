"""The evaluation's files: one set of figures in all three, and a page that needs nothing but itself."""

from __future__ import annotations

import csv
import html
import json
import re
import sqlite3
from contextlib import closing
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely

from furrowmap.core.accuracy.evaluation import Evaluation, evaluate
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.runtime.settings import using
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.exporters.reports.evaluation_figures import EPOCH_COLUMNS
from furrowmap.exporters.reports.evaluation_page import EVALUATION_PRODUCTS, page, write_evaluation
from furrowmap.exporters.reports.page_language import in_language
from tests.exporters.reports.page_texts import texts


def driven(n: int = 300, *, source: str = "test.pos", still: bool = False) -> tuple[GnssTrack, GnssTrack]:
    """A drive northwards with a gap and three kinds of fix, and its reference."""
    rng = np.random.default_rng(8)
    t_s = 1_780_000_000.0 + np.arange(n) + np.where(np.arange(n) > n // 2, 30.0, 0.0)
    lat = 36.0 + (0.0 if still else 1e-5) * np.arange(n)
    fix = np.select([np.arange(n) < n // 5, np.arange(n) < n // 3], [Fix.SINGLE, Fix.PPP], Fix.FIXED).astype(np.int8)
    truth = GnssTrack.build(
        t_s, source="reference.pos", service="rtk", lon_deg=np.full(n, 140.0), lat_deg=lat, height_m=np.full(n, 50.0),
        fix=np.full(n, Fix.FIXED, np.int8),
    )  # fmt: skip
    test = GnssTrack.build(
        t_s, source=source, service="madoca", lon_deg=truth.lon_deg + rng.normal(0.0, 2e-7, n),
        lat_deg=lat + rng.normal(0.0, 2e-7, n), height_m=truth.height_m + rng.normal(0.1, 0.03, n), fix=fix,
        sigma_e_m=np.full(n, 0.02), sigma_n_m=np.full(n, 0.02), age_s=np.full(n, 1.5),
    )  # fmt: skip
    return test, truth


def judged(**options: object) -> dict[str, Evaluation]:
    return {"MADOCA": evaluate(*driven(**options))}  # type: ignore[arg-type]


def services() -> dict[str, Evaluation]:
    """Two services against the same reference, one of them worse."""
    test, truth = driven()
    worse = replace(test, lon_deg=truth.lon_deg + 5e-6, source="slas.pos", service="slas")
    return {"MADOCA": evaluate(test, truth), "SLAS": evaluate(worse, truth)}


def test_figures__are_the_same_in_table_and_json(tmp_path: Path) -> None:
    found = judged()
    write_evaluation(tmp_path / "out", found, overwrite=False)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(EVALUATION_PRODUCTS)
    (told,) = json.loads((tmp_path / "out/evaluation.json").read_text())["services"]
    with (tmp_path / "out/epochs.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == EPOCH_COLUMNS
    assert len(rows) == told["epochs"]["compared"] == 300
    for kind in ("all", "single", "ppp", "fixed"):
        mine = [row for row in rows if kind in ("all", row["fix"])]
        for quantity, column in (("X", "x_m"), ("Z", "z_m"), ("2D", "error_2d_m"), ("3D", "error_3d_m")):
            values = np.array([float(row[column]) for row in mine])
            table = told["tables"][kind][quantity]
            assert table["n"] == len(values)
            assert table["average_m"] == pytest.approx(values.mean(), abs=2e-4)
            assert table["rmse_m"] == pytest.approx(np.sqrt(np.mean(values**2)), abs=2e-4)
    assert told["test"]["service"] == "madoca"
    assert told["continuity"]["gaps"] == 1


def test_services__are_in_one_table_as_one_by_one(tmp_path: Path) -> None:
    found = services()
    write_evaluation(tmp_path / "both", found, overwrite=False)
    with (tmp_path / "both/services.csv").open(encoding="utf-8", newline="") as file:
        both = list(csv.DictReader(file))
    alone = []
    for name, one in found.items():
        write_evaluation(tmp_path / name, {name: one}, overwrite=False)
        with (tmp_path / name / "services.csv").open(encoding="utf-8", newline="") as file:
            alone += list(csv.DictReader(file))
    assert both == alone
    (row,) = [row for row in both if (row["service"], row["fix"], row["quantity"]) == ("SLAS", "all", "X")]
    east_m = np.radians(5e-6) * 6_378_137.0 / np.sqrt(1 - 0.00669438 * np.sin(np.radians(36.0)) ** 2)
    assert float(row["average_m"]) == pytest.approx(east_m * np.cos(np.radians(36.0015)), abs=2e-4)


def test_layers__of_services_lie_where_the_logs_do(tmp_path: Path) -> None:
    found = services()
    write_evaluation(tmp_path, found, overwrite=False)
    errors = geopandas.read_file(tmp_path / "evaluation.gpkg", layer="gnss_errors")
    tracks = geopandas.read_file(tmp_path / "evaluation.gpkg", layer="gnss_tracks").set_index("service")
    assert errors.crs.to_epsg() == tracks.crs.to_epsg() == 4326
    assert errors.groupby("service").size().to_dict() == {"MADOCA": 300, "SLAS": 300}
    slas = errors[errors["service"] == "SLAS"]
    np.testing.assert_allclose(slas.geometry.x, 140.0 + 5e-6, rtol=0, atol=1e-12)
    np.testing.assert_allclose(slas["error_2d_m"], np.hypot(slas["x_m"], slas["y_m"]), atol=1e-12)
    assert list(tracks.index) == ["MADOCA", "SLAS", "reference"]
    assert list(tracks["is_reference"]) == [False, False, True]
    true = shapely.get_coordinates(tracks.geometry["reference"])
    np.testing.assert_allclose(true[:, 0], 140.0, rtol=0, atol=1e-10)  # 0.01 mm
    assert len(shapely.get_parts(tracks.geometry["SLAS"])) == 2, "no line across the gap"


def test_times__are_local_for_people_and_utc_in_the_data(tmp_path: Path) -> None:
    write_evaluation(tmp_path, judged(), overwrite=False)
    text = (tmp_path / "evaluation.html").read_text(encoding="utf-8")
    assert "2026-05-29, 05:26:40 to 05:32:09 (Asia/Tokyo, UTC+09:00)" in text  # the day after that of UTC
    assert "2026-05-28" not in text
    with closing(sqlite3.connect(tmp_path / "evaluation.gpkg")) as base:
        (style,) = base.execute("SELECT styleQML FROM layer_styles WHERE f_table_name = 'gnss_errors'").fetchone()
        times = [row[0] for row in base.execute('SELECT "time" FROM gnss_errors ORDER BY "time"')]
    assert "to_interval('32400 seconds')" in style
    assert "(Asia/Tokyo)" in style
    assert "2026-05-28T20:26:40" in times[0]
    assert "2026-05-28T20:26:40.000Z" in (tmp_path / "epochs.csv").read_text(encoding="utf-8")
    told = json.loads((tmp_path / "evaluation.json").read_text(encoding="utf-8"))["services"][0]
    assert told["continuity"]["first"] == "2026-05-28T20:26:40.000Z"


def test_page__of_several_services_has_them_side_by_side() -> None:
    text = in_language(page(services()), "en").partition("<body>")[2]
    table = text.partition("Services side by side")[2].partition("</section>")[0]
    assert re.findall(r"<th class=.text.[^>]*>(\w+):", table) == ["MADOCA", "SLAS"]
    assert table.count("<td>RMSE</td>") == 2
    assert text.count('class="service"') == 4
    assert "SLAS: Trajectories" in text
    assert "nan" not in re.sub(r"<style>.*?</style>", "", text, flags=re.DOTALL).lower()


def test_page__needs_nothing_but_itself_and_is_whole() -> None:
    class Tags(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.open: list[str] = []

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            if tag not in ("meta", "br", "img", "link"):
                self.open.append(tag)

        def handle_endtag(self, tag: str) -> None:
            while self.open and self.open[-1] != tag:
                assert self.open.pop() in ("rect", "path", "line", "polyline", "image", "li")
            self.open.pop()

    text = page(judged())
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert re.findall(r"(?:src|href)=\"(?!data:)[^\"]*\"|https?://|<script", text) == []
    assert "Services side by side" not in text
    for words in ("Standard deviation", "95 % below", "Trajectories", "Errors over time", "population", "MADOCA"):
        assert words in text


@pytest.mark.parametrize(("n", "still"), [(2, False), (5, True), (300, True)])
def test_page__of_few_epochs_or_of_an_antenna_at_rest(n: int, still: bool) -> None:
    assert "nan" not in re.sub(r"<style>.*?</style>", "", page(judged(n=n, still=still)), flags=re.DOTALL).lower()


def test_page__shows_hostile_names_as_text() -> None:
    text = page(judged(source='<script>alert(1)</script>"><img onerror=x>.pos'))
    assert "<script>alert" not in text
    assert "<img onerror" not in text


def test_earlier_evaluations__are_not_replaced_unasked(tmp_path: Path) -> None:
    found = judged()
    write_evaluation(tmp_path, found, overwrite=False)
    with pytest.raises(RefusedError) as error:
        write_evaluation(tmp_path, found, overwrite=False)
    assert error.value.code == "output-exists"
    write_evaluation(tmp_path, found, overwrite=True)


def test_page__in_japanese_has_no_english_but_names(tmp_path: Path) -> None:
    for name, found in {"one": judged(), "two": services()}.items():
        with using(language="ja"):
            write_evaluation(tmp_path / name, found, overwrite=False)
        shown = (tmp_path / name / "evaluation.html").read_text(encoding="utf-8")
        names = r"furrowmap [0-9.]+|(test|slas|reference)\.pos|--antenna-offset|Asia/Tokyo|Iglewicz and Hoaglin 1993"
        names += "|MADOCA|SLAS|CLAS|RMSE|FLOAT|GNSS"
        said = [re.sub(names, "", html.unescape(text)) for text in texts(shown)]
        assert not [text for text in said if re.search("[A-Za-z]{4}", text)]
        assert "単独測位" in shown
