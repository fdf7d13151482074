"""A result for people without a GIS: a web page, a project for QField, or its report page again."""

from dataclasses import dataclass
from pathlib import Path

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import read_own, resolved
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import REPORT_PAGE, open_result, reading_result
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.exporters.reports.area_units import area_unit_of, in_area_unit
from furrowmap.exporters.reports.page_language import has_other_languages, in_language, language_of, unbroken
from furrowmap.exporters.reports.printed_pages import write_pdf
from furrowmap.exporters.share.field_project import FIELD_PRODUCTS, PROJECT_FILE, write_field_project
from furrowmap.exporters.share.page import INDEX, PAGE_PRODUCTS, SHARE_REPORT, write_page
from furrowmap.workflows.share.export import refuse_result


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
        language: its code, such as "en"; by default the user's, or else that of the page.
        area_unit: "ha", "10a" or "acre"; by default that of the page.
        pdf: write a PDF, on A4.

    Returns:
        The file written.

    Raises:
        InputError: if there is no page, it cannot be read or written, or an earlier version wrote it in one language.
        RefusedError: if a PDF is asked for and no browser is installed, or it fails.
    """
    source = Path(result) / REPORT_PAGE
    try:
        page = read_own(Path(result), REPORT_PAGE).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("result-unreadable", source=source, error=error) from None
    shown = language or language_of_user(language_of(page))
    if shown != language_of(page) and not has_other_languages(page):
        raise InputError("result-unreadable.one-language", source=source, language=shown)
    page = unbroken(in_area_unit(in_language(page, shown), area_unit or area_unit_of(page)))
    target = Path(out) if out is not None else source.with_suffix(".pdf" if pdf else ".html")
    if pdf:
        write_pdf(target, page)
    else:
        with atomic_output(target) as unfinished:
            unfinished.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")
    return target


@dataclass(frozen=True)
class Shared:
    """What was written, and the file to open: the page, or the project."""

    folder: Path
    start: Path
    files: tuple[Path, ...]
    size_bytes: int


def share(
    result: str | Path,
    out: str | Path | None = None,
    *,
    qfield: bool = False,
    language: str | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> Shared:
    """Write a result as a folder for people without a GIS: a web page, or a project for QField.

    The page shows map, layers, figures and the cloud in three dimensions, and measures; it needs no network and opens
    from disk or from any web server. The folder is written whole or not at all.

    Args:
        result: folder that a run wrote.
        out: the folder to write; by default beside the result, named after it.
        qfield: write a QGIS project with its layers for QField instead of a page.
        language: its code, such as "en": of a project (by default the user's), or in which a page begins (by default
            that of its reader's browser; each page has all).

    Raises:
        InputError: if the folder contains no result, or a file of it is damaged.
        RefusedError: if the folder holds another page or project or the result of a run, or this installation lacks the
            page's scripts.
    """
    opened = open_result(Path(result))
    here = resolved(opened.folder)
    target = Path(out) if out is not None else here.with_name(f"{here.name}_{'qfield' if qfield else 'page'}")
    if target.is_dir():
        recover(target)
        refuse_result(target)
        refuse_products(target, FIELD_PRODUCTS if qfield else PAGE_PRODUCTS, overwrite=overwrite)
    progress("reading results", 0.0)
    with reading_result(opened.folder), staged_folder(target) as staging:
        if qfield:
            names = write_field_project(staging, opened, language or language_of_user(), progress)
        else:
            names = write_page(staging, opened, language or "", progress)
        size_bytes = sum((staging / name).stat().st_size for name in names)
        account = {**opened.origin.metadata, "products": [*names, SHARE_REPORT]}
        (staging / SHARE_REPORT).write_text(json_text(account), encoding="utf-8")
        size_bytes += (staging / SHARE_REPORT).stat().st_size
    files = tuple(target / name for name in sorted([*names, SHARE_REPORT]))
    return Shared(target, target / (PROJECT_FILE if qfield else INDEX), files, size_bytes)
