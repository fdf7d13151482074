"""The report page of a result: in another language or unit, and as PDF."""

from pathlib import Path

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import REPORT_PAGE
from furrowmap.exporters.reports.area_units import in_area_unit
from furrowmap.exporters.reports.page_language import in_language, language_of
from furrowmap.exporters.reports.printed import write_pdf


def write_report_page(
    result: str | Path,
    out: str | Path | None = None,
    *,
    language: str | None = None,
    area_unit: str | None = None,
    pdf: bool = False,
) -> Path:
    """Write the report page of a result in another language or unit, or as PDF; nothing is computed again.

    Args:
        result: its folder.
        out: the page or PDF; by default `report.html` of the result is replaced, or `report.pdf` written beside it.
        language: "en" or "ja"; by default that of the page.
        area_unit: "ha", "10a" or "acre"; by default that of the page.
        pdf: write a PDF, on A4.

    Returns:
        The file written.

    Raises:
        InputError: if there is no page, or it cannot be read or written.
        RefusedError: if a PDF is asked for and no browser is installed, or it fails.
    """
    source = Path(result) / REPORT_PAGE
    try:
        page = source.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("result-unreadable", source=source, error=error) from None
    page = in_language(page, language or language_of_user(language_of(page)))
    page = in_area_unit(page, area_unit) if area_unit is not None else page
    target = Path(out) if out is not None else source.with_suffix(".pdf" if pdf else ".html")
    if pdf:
        write_pdf(target, page)
    else:
        with atomic_output(target) as unfinished:
            unfinished.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")
    return target
