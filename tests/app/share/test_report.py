"""The report page of a result again: in another language and unit, and pages."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import furrowmap
from furrowmap.core.runtime.settings import using
from furrowmap.exporters.reports import printed_pages as pages
from tests.exporters.reports.test_page_language import PAGE


@pytest.fixture
def result(tmp_path: Path) -> Path:
    (tmp_path / "report.html").write_text(PAGE, encoding="utf-8")
    return tmp_path


def test_report__in_japanese_and_ares_and_back(result: Path) -> None:
    with using(language="ja"):
        written = furrowmap.write_report_page(result, area_unit="10a")
    assert written == result / "report.html"
    assert ">54.21 a</data> を作業" in written.read_text(encoding="utf-8").replace("\u00a0", " ")
    furrowmap.write_report_page(result, language="en", area_unit="ha")
    assert written.read_text(encoding="utf-8").replace("\u00a0", " ") == PAGE


def test_report__of_an_earlier_version_stays_in_its_language(result: Path) -> None:
    """Its texts are there in one language alone; area and PDF can be changed."""
    page = result / "report.html"
    page.write_text(re.sub(r'<meta name="furrowmap-texts".*?>\n', "", PAGE), encoding="utf-8")
    furrowmap.write_report_page(result, area_unit="10a")
    assert ">54.21 a</data> worked in 3 passes" in page.read_text(encoding="utf-8").replace("\u00a0", " ")
    with using(language="ja"), pytest.raises(furrowmap.InputError, match="no texts in the language") as refused:
        furrowmap.write_report_page(result, area_unit="10a")
    assert refused.value.code == "result-unreadable"


def test_report__is_printed_with_its_fonts(result: Path) -> None:
    if pages.browser() is None:
        pytest.skip("no Chromium, Chrome or Edge")
    content = furrowmap.write_report_page(result, pdf=True).read_bytes()
    assert content.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", content)) == 1
    assert b"/FontFile2" in content or b"/Type3" in content


def test_report__without_a_page_or_a_browser_is_refused(
    tmp_path: Path, result: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(furrowmap.InputError) as refused:
        furrowmap.write_report_page(tmp_path / "none")
    assert refused.value.code == "result-unreadable"
    for browser in ("no-such-program", shutil.which("true") or "true"):
        monkeypatch.setenv(pages.BROWSER_VARIABLE, browser)
        with pytest.raises(furrowmap.RefusedError) as missing:
            furrowmap.write_report_page(result, pdf=True)
        assert missing.value.code == "browser-missing"
        assert not (result / "report.pdf").exists()
