# SPDX-License-Identifier: GPL-2.0-or-later
"""The plugin's texts in the user's language.

Qt reads compiled translations (.qm). These are binary, so they are neither in the repository nor in the zip: the .ts
files of ``i18n`` are compiled in memory when the plugin starts, within milliseconds.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, QLocale, QTranslator, QXmlStreamReader

QM_MAGIC = bytes.fromhex("3cb86418caef9c95cd211cbf60a1bddd")
HASHES = 0x42
MESSAGES = 0x69
END = 1
TRANSLATION = 3
SOURCE = 6
CONTEXT = 7
COMMENT = 8


def install_translator(locale: str | None = None) -> QTranslator | None:
    """Translate the plugin's texts into the language of QGIS; returns the translator, None if there is none."""
    locale = locale or QgsApplication.locale() or ""
    path = translation_file(locale[:2])
    if not path.is_file():
        return None
    translator = Translator(compiled(messages(path)))
    QCoreApplication.installTranslator(translator)
    return translator


def translation_file(language: str) -> Path:
    """The file of a language, by its code; it exists for each language of furrowmap but English."""
    return Path(__file__).with_name("i18n") / f"furrowmap_{language}.ts"


def in_marks(text: str) -> str:
    """Numbers in English notation with the marks of the language, if the plugin has texts in it: "0,5 ha" in German."""
    language = (QgsApplication.locale() or "")[:2]
    if not translation_file(language).is_file():
        return text
    locale = QLocale(language)
    marks = {".": str(locale.decimalPoint()), ",": str(locale.groupSeparator())}
    return re.sub(r"(?<=\d)[.,](?=\d)", lambda mark: marks[mark[0]], text)


class Translator(QTranslator):
    """A translator that keeps the content it reads from."""

    def __init__(self, content: bytes) -> None:
        super().__init__()
        self.content = content
        self.loadFromData(content)


def messages(path: Path) -> dict[tuple[str, str], str]:
    """The finished translations in a .ts file: (context, source) → translation."""
    reader = QXmlStreamReader(path.read_text(encoding="utf-8"))
    found: dict[tuple[str, str], str] = {}
    context = source = ""
    while not reader.atEnd():
        if reader.readNext() != QXmlStreamReader.TokenType.StartElement:
            continue
        element = str(reader.name())
        if element == "name":
            context = reader.readElementText()
        elif element == "source":
            source = reader.readElementText()
        elif element == "translation" and not reader.attributes().hasAttribute("type"):
            found[context, source] = reader.readElementText()
    return found


def compiled(translations: Mapping[tuple[str, str], str]) -> bytes:
    """The content of a .qm file, as Qt's `lrelease` writes it and QTranslator reads it."""
    hashes = []
    body = bytearray()
    for (context, source), translation in translations.items():
        hashes.append((elf_hash(source.encode()), len(body)))
        for tag, text in (
            (TRANSLATION, translation.encode("utf-16-be")),
            (COMMENT, b""),
            (SOURCE, source.encode()),
            (CONTEXT, context.encode()),
        ):
            body += struct.pack(">BI", tag, len(text)) + text
        body.append(END)
    table = b"".join(struct.pack(">II", *entry) for entry in sorted(hashes))
    sections = ((HASHES, table), (MESSAGES, bytes(body)))
    return QM_MAGIC + b"".join(struct.pack(">BI", tag, len(content)) + content for tag, content in sections)


def elf_hash(text: bytes) -> int:
    """The hash of System V's ELF, by which Qt looks source texts up."""
    value = 0
    for byte in text:
        value = (value << 4) + byte
        high = value & 0xF0000000
        value = (value ^ (high >> 24)) & ~high & 0xFFFFFFFF
    return value or 1
