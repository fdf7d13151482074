"""Parts of the HTML reports: single files without external resources."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from string import Template


def filled(
    *, title: str, when: str, summary: str, figures: Iterable[str], sections: Iterable[str], provenance: str
) -> str:
    """The HTML of a report.

    Args:
        title: of the page; HTML, like all others.
        when: the time covered.
        summary: a sentence or two.
        figures: of :func:`key_figure`.
        sections: of :func:`section`.
        provenance: software and inputs.
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
    """A large figure at the top of a page; a loud one is highlighted."""
    kind = ' class="loud"' if loud else ""
    return f"<div{kind}><b>{escape(value)}</b><span>{escape(name)}</span></div>"


def key(rows: Iterable[tuple[str, str]]) -> str:
    """The legend of a drawing: rows of CSS colour and text."""
    items = "".join(f'<li><i style="background:{colour}"></i>{escape(text)}</li>' for colour, text in rows)
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


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of texts."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"
