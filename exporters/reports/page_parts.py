"""What the pages to read are put together from: one file of HTML each, which needs nothing but itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from string import Template


def filled(
    *, title: str, when: str, summary: str, figures: Iterable[str], sections: Iterable[str], provenance: str
) -> str:
    """A whole page.

    Args:
        title: of the page; HTML, as all others are.
        when: of what time it tells.
        summary: all of it in a sentence or two.
        figures: of :func:`key_figure`, the most telling ones.
        sections: of :func:`section`.
        provenance: what it was made of.
    """
    template = Template(files("furrowmap.exporters.reports").joinpath("report.html").read_text("utf-8"))
    return template.substitute(
        title=title,
        when=when,
        summary=summary,
        figures="\n".join(figures),
        sections="\n".join(sections),
        provenance=provenance,
    )


def key_figure(value: str, name: str, *, loud: bool = False) -> str:
    """A figure that stands large at the head of a page; a loud one asks to be looked at."""
    kind = ' class="loud"' if loud else ""
    return f"<div{kind}><b>{escape(value)}</b><span>{escape(name)}</span></div>"


def key(rows: Iterable[tuple[str, str]]) -> str:
    """What the colours of a drawing mean: rows of CSS colour and words."""
    items = "".join(f'<li><i style="background:{colour}"></i>{escape(text)}</li>' for colour, text in rows)
    return f'<ul class="key">{items}</ul>'


def section(title: str, content: str) -> str:
    """A part of a page under a title in words; the content is HTML."""
    return f"<section>\n<h2>{escape(title)}</h2>\n{content}\n</section>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of words under heads in words."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"
