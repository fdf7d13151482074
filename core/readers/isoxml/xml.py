"""Untrusted XML: elements and their attributes, without document types, entities or deep nesting."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final
from xml.parsers import expat  # document types, and with them entities, are rejected below

from furrowmap.core.readers.text_encoding import known_page
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text

MAX_LEVELS: Final = 64
MAX_ELEMENTS: Final = 5_000_000


@dataclass(slots=True)
class Element:
    """An element, its attributes, its children in their order, and the text directly in it (task data have none)."""

    tag: str
    attributes: dict[str, str]
    children: "list[Element]" = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> "Iterator[Element]":
        """The children of that tag."""
        return (child for child in self.children if child.tag == tag)

    def get(self, name: str) -> str:
        """An attribute; "" if it is missing."""
        return self.attributes.get(name, "")


def parse_xml(data: bytes, name: str) -> Element:
    """The root element of an XML document.

    InputError if it is not well-formed (with line and column), declares a document type, or has more elements or levels
    than any task data.
    """
    document = Element("", {})
    path = [document]
    texts: list[list[str]] = [[]]
    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MAX_ELEMENTS or len(path) > MAX_LEVELS:
            what = Text(
                "more than {max_elements:,} elements, or more than {max_levels} levels",
                max_elements=MAX_ELEMENTS,
                max_levels=MAX_LEVELS,
            )
            raise InputError("xml-hostile", name=name, what=what)
        path[-1].children.append(Element(tag, attributes))
        path.append(path[-1].children[-1])
        texts.append([])

    def end(_: str) -> None:
        path.pop().text = "".join(texts.pop())

    def add_text(text: str) -> None:
        if not text.isspace():
            texts[-1].append(text)

    def refuse_doctype(*_: object) -> None:
        what = Text("a document type, which can refer to other files and expand without limit")
        raise InputError("xml-hostile", name=name, what=what)

    data, encoding = _in_known_encoding(data)
    parser = expat.ParserCreate(encoding)
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = add_text
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        parser.Parse(data, True)  # noqa: FBT003 (expat takes it by position only)
    except expat.ExpatError as error:
        what = f"{name}, line {error.lineno}, column {error.offset + 1}: {expat.ErrorString(error.code)}"
        raise InputError("xml-damaged", what=what) from None
    except (LookupError, ValueError) as error:  # an encoding that Python does not know, or expat cannot use
        raise InputError("xml-damaged", what=f"{name}, line 1: {error}") from None
    return document.children[0]  # expat rejects a document without an element


_DECLARED: Final = re.compile(
    rb"""^(?:\xef\xbb\xbf)?<\?xml[^>]{0,200}?\sencoding\s*=\s*["']([A-Za-z][\w.:-]{0,40})["']"""
)
_OF_EXPAT: Final = ("utf-8", "utf-16", "iso8859-1", "ascii")


def _in_known_encoding(data: bytes) -> tuple[bytes, str | None]:
    """A document as UTF-8 if it declares a code page that expat cannot read, such as Shift_JIS or windows-874.

    One that is not valid in it, or of an unknown name, stays as it is, for expat to refuse.
    """
    declared = _DECLARED.match(data)
    page = known_page(declared[1].decode("ascii")) if declared is not None else None
    if page is None or page in _OF_EXPAT:
        return data, None
    try:
        return data.decode(page).encode(), "utf-8"
    except UnicodeError:
        return data, None
