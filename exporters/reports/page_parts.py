"""Parts of the HTML reports: single files without external resources."""

from __future__ import annotations

import base64
import hashlib
import html
from collections.abc import Collection, Iterable, Sequence
from importlib.resources import files
from string import Template

from furrowmap.core.runtime.errors import printable


def filled(
    *,
    title: str,
    when: str,
    summary: str,
    figures: Iterable[str],
    sections: Iterable[str],
    provenance: str,
    alarm: str = "",
) -> str:
    """The HTML of a report.

    Args:
        title: of the page; HTML, like all others.
        when: the time covered.
        summary: a sentence or two.
        figures: of :func:`key_figure`.
        sections: of :func:`section`.
        provenance: software and inputs.
        alarm: of :func:`alarm`, above all else.
    """
    page = files("furrowmap.exporters.reports").joinpath("report.html").read_text("utf-8")
    return Template(page).substitute(
        policy=policy(page),
        title=title,
        when=when,
        summary=summary,
        figures="\n".join(figures),
        sections="\n".join(sections),
        provenance=provenance,
        alarm=alarm,
    )


def policy(page: str, *more: str) -> str:
    """The Content-Security-Policy of a page: its own style sheet, embedded images, `more`, and nothing else."""
    sheet = page.partition("<style>")[2].partition("</style>")[0]
    named = {part.split()[0] for part in more}
    digest = base64.b64encode(hashlib.sha256(sheet.encode()).digest()).decode("ascii")
    own = ("img-src data:", f"style-src 'sha256-{digest}'", "base-uri 'none'", "form-action 'none'")
    return "; ".join(("default-src 'none'", *more, *(part for part in own if part.split()[0] not in named)))


def escape(text: str) -> str:
    """Text as HTML, with escapes for control characters."""
    return html.escape(printable(text))


def alarm(text: str) -> str:
    """What casts doubt on all of a page; nothing for no text."""
    return f'<p class="alarm" role="alert">{escape(text)}</p>' if text else ""


def key_figure(value: str, name: str, *, loud: bool = False) -> str:
    """A large figure at the top of a page; a loud one is highlighted."""
    kind = ' class="loud"' if loud else ""
    return f"<div{kind}><b>{escape(value)}</b><span>{escape(name)}</span></div>"


def key(rows: Iterable[tuple[str, str]]) -> str:
    """The legend of a drawing: rows of CSS colour and text."""
    swatch = '<svg aria-hidden="true" viewBox="0 0 16 11"><rect width="16" height="11" fill="{}"/></svg>'
    items = "".join(f"<li>{swatch.format(escape(colour))}{escape(text)}</li>" for colour, text in rows)
    return f'<ul class="key">{items}</ul>'


def figure(content: str, caption: str) -> str:
    """A drawing or an image with a caption in text."""
    return f"<figure>{content}<figcaption>{escape(caption)}</figcaption></figure>"


def remark(text: str) -> str:
    """A paragraph in small print."""
    return f'<p class="soft">{escape(text)}</p>'


def section(title: str, content: str) -> str:
    """A section of a page; the title is text, the content HTML."""
    return f"<section>\n<h2>{escape(title)}</h2>\n{content}\n</section>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], texts: Collection[int] = ()) -> str:
    """A table of texts.

    Args:
        head: of the columns.
        rows: with a cell for each column.
        texts: columns of words, which begin at the left and wrap; the first one does in any case.
    """
    return table_of_cells(head, [[escape(cell) for cell in row] for row in rows], texts)


def table_of_cells(head: Sequence[str], rows: Iterable[Sequence[str]], texts: Collection[int] = ()) -> str:
    """The same of cells in HTML."""
    kinds = [' class="text"' if k in texts else "" for k in range(len(head))]
    top = "".join(f"<th{kind}>{escape(cell)}</th>" for kind, cell in zip(kinds, head, strict=True))
    body = "".join(
        f"<tr>{''.join(f'<td{kind}>{cell}</td>' for kind, cell in zip(kinds, row, strict=True))}</tr>" for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def days_words(first: str, last: str) -> str:
    """The days from a first to a last one, in any language: "2026-06-11 – 2026-06-18"."""
    return first if first == last else f"{first} – {last}"


def duration_words(length_s: float) -> str:
    """Seconds, minutes or hours."""
    whole = round(length_s)
    if whole >= 3600:
        return f"{whole // 3600} h {whole // 60 % 60:02d} min"
    return f"{whole // 60} min {whole % 60:02d} s" if whole >= 60 else f"{whole} s"
