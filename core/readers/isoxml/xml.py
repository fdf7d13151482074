"""Untrusted XML: elements and their attributes, without document types, entities or deep nesting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final
from xml.parsers import expat  # document types, and with them entities, are rejected below

from furrowmap.core.runtime.errors import InputError

DEEPEST: Final = 64
MOST_ELEMENTS: Final = 5_000_000


@dataclass
class Element:
    """An element, its attributes, its children in their order, and the text directly in it (task data have none)."""

    tag: str
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> Iterator[Element]:
        """The children of that tag."""
        return (child for child in self.children if child.tag == tag)

    def get(self, name: str) -> str:
        """An attribute; "" if it is missing."""
        return self.attributes.get(name, "")


def parse_xml(data: bytes, name: str) -> Element:
    """The root element of an XML document.

    Args:
        data: the file's bytes.
        name: name of the file for messages.

    Raises:
        InputError: if it is not well-formed (with line and column), declares a document type, or has more elements or
            levels than any task data.
    """
    tree = _Tree(name)
    parser = expat.ParserCreate()
    parser.StartElementHandler = tree.start
    parser.EndElementHandler = tree.end
    parser.CharacterDataHandler = tree.characters
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = tree.doctype
    try:
        parser.Parse(data, True)  # noqa: FBT003 (expat takes it by position only)
    except expat.ExpatError as error:
        raise _damaged(
            f"{name}, line {error.lineno}, column {error.offset + 1}: {expat.ErrorString(error.code)}"
        ) from None
    except (LookupError, ValueError) as error:  # an encoding that Python does not know, or expat cannot use
        raise _damaged(f"{name}, line 1: {error}") from None
    assert tree.root is not None  # expat rejects a document without an element
    return tree.root


def _damaged(what: str) -> InputError:
    return InputError("xml-damaged", what=what)


class _Tree:
    """Builds the elements from expat's events."""

    def __init__(self, name: str) -> None:
        self.root: Element | None = None
        self._name = name
        self._open: list[Element] = []
        self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes)
        self._count += 1
        if self._count > MOST_ELEMENTS or len(self._open) >= DEEPEST:
            raise self._hostile(f"more than {MOST_ELEMENTS:,} elements, or more than {DEEPEST} levels")
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def end(self, tag: str) -> None:  # noqa: ARG002 (expat's signature)
        self._open.pop()

    def characters(self, text: str) -> None:
        if not text.isspace():
            self._open[-1].text += text

    def doctype(self, *_: object) -> None:
        raise self._hostile("a document type, which can refer to other files and expand without limit")

    def _hostile(self, what: str) -> InputError:
        return InputError("xml-hostile", name=self._name, what=what)
