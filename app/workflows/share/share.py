"""A result for people without a GIS: a web page, or a project for QField."""

from dataclasses import dataclass
from pathlib import Path

from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.files.result_folder import open_result, reading_result
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.exporters.share.field_project import FIELD_PRODUCTS, PROJECT_FILE, write_field_project
from furrowmap.exporters.share.page import INDEX, PAGE_PRODUCTS, SHARE_REPORT, write_page
from furrowmap.workflows.share.export import refuse_result


@dataclass(frozen=True)
class Shared:
    """What was written.

    Attributes:
        start: the file to open: the page, or the project.
        files: that were written.
    """

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
        language: "en" or "ja": of a project (by default the user's), or in which a page begins (by default that of its
            reader's browser; each page has both).

    Raises:
        InputError: if the folder contains no result, or a file of it is damaged.
        RefusedError: if the folder holds another page or project or the result of a run, or this installation lacks the
            page's scripts.
    """
    opened = open_result(Path(result))
    here = opened.folder.resolve()
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
