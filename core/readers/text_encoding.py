"""The code page of text that states none, or a wrong one: by validity, then by which text is more plausible.

Most text is valid in two code pages: 'Témoin' of Windows-1252 is 'T駑oin' in that of Japanese Windows, and '北' of the
latter is '–k'. Each character costs about as many bits as it takes to name it among those of its kind, more where
its neighbours make it unlikely; the cheaper text is taken.
"""

import codecs
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from furrowmap.core.runtime.errors import Notice

UTF_8: Final = "utf-8"
SHIFT_JIS: Final = "cp932"
WINDOWS_1252: Final = "cp1252"
_PAGES: Final = (SHIFT_JIS, WINDOWS_1252)
_JAPANESE_NAMES: Final = ("shiftjis", "sjis", "ms932", "xsjis", "windows31j")
_MOST_COMPARED: Final = 2000
"""Texts that are compared."""
_FIRST_RARE_KANJI: Final = 0x98
"""First byte of the rarer of the two levels of kanji (JIS X 0208)."""
_MARKS_BEHIND_NUMBERS: Final = frozenset("°²³µ½¼¾ºª")
_QUOTES: Final = {"“": "”", "„": "“", "‘": "’", "«": "»"}
_SIGNS: Final = frozenset("§€£±×·–—…™®©\u00a0«»“”„‘")
_SHOWN_CHARACTERS: Final = 30


@dataclass(frozen=True)
class Decoded:
    """Texts, and the code page that they were read in.

    Attributes:
        open: whether the file leaves the code page open: another one is as valid.
        example: the first text with a character besides ASCII.
    """

    texts: list[str]
    page: str
    open: bool
    example: str

    def notice(self, key: str, path: object, **stated: str) -> Notice:
        """That the code page was chosen; the key tells how to state it."""
        return Notice(key, path=path, page=self.page, example=self.example[:_SHOWN_CHARACTERS], **stated)


def known_page(name: str) -> str | None:
    """The codec of a code page as files name it (`932`, `ANSI 1252`, `SJIS`, `ISO 88591`); None if unknown."""
    if not name.strip():
        return None
    plain = name.strip().casefold().removeprefix("ansi ").removeprefix("oem ")
    plain = re.sub(r"^(windows|ibm)[ _-]?(\d+)$", r"\2", plain)
    if re.sub(r"[^a-z0-9]", "", plain) in _JAPANESE_NAMES:
        return SHIFT_JIS
    for spelled in (f"cp{plain}", plain, re.sub(r"^(iso)?[ _-]*8859[ _-]*(\d+)$", r"iso8859-\2", plain)):
        try:
            b"a".decode(spelled)
        except (LookupError, ValueError):  # LookupError also of codecs that are no code pages
            continue
        return codecs.lookup(spelled).name
    return None


def decoded(texts: Sequence[bytes], stated: str | None = None) -> Decoded | None:
    """Texts in one code page: that stated, else UTF-8, else the most plausible; None if they are in none.

    The last character of a text may be cut, as in fields of fixed width.
    """
    special = list(dict.fromkeys(text for text in texts if not text.isascii()))
    if stated is not None and (whole := _in_page(texts, stated)) is not None:
        return Decoded(whole, stated, open=False, example="")
    if (whole := _in_page(texts, UTF_8)) is not None and (not special or any(not text.isascii() for text in whole)):
        return Decoded(whole, UTF_8, open=False, example=_first_special(whole))
    compared = special[:_MOST_COMPARED]
    valid = [page for page in _PAGES if _in_page(special, page) is not None]
    if not valid:
        return None
    page = min(valid, key=lambda page: sum(_cost(text, page) for text in compared))
    found = _in_page(texts, page)
    assert found is not None
    # Every text is valid in the single-byte code pages of other languages.
    return Decoded(found, page, open=len(valid) > 1 or page == WINDOWS_1252, example=_first_special(found))


def _first_special(texts: Iterable[str]) -> str:
    return next((text.strip() for text in texts if not text.isascii()), "")


def _in_page(texts: Iterable[bytes], page: str) -> list[str] | None:
    """Texts in a code page, without a last character that is cut; None if they are not valid in it."""
    decoder = codecs.getincrementaldecoder(page)
    try:
        return [text.decode("ascii") if text.isascii() else decoder().decode(text) for text in texts]
    except UnicodeDecodeError:
        return None


def _cost(text: bytes, page: str) -> float:
    (characters,) = _in_page([text], page) or [""]
    cut = 20.0 if page == SHIFT_JIS and len(characters.encode(page)) < len(text) else 0.0
    cost = _japanese if page == SHIFT_JIS else _western
    padded = f" {characters} "
    return cut + sum(cost(padded, k) for k in range(1, len(padded) - 1) if not padded[k].isascii())


def _japanese(text: str, k: int) -> float:
    """The cost of a character of Japanese text, with that of Latin letters beside it."""
    one = text[k]
    letters = sum(other.isascii() and other.isalpha() for other in (text[k - 1], text[k + 1]))
    if "\uff61" <= one <= "\uff9f":  # half-width: in words, not alone
        alone = not any("\uff61" <= other <= "\uff9f" for other in (text[k - 1], text[k + 1]))
        return (15.0 if alone else 6.0) + 4.0 * letters
    if "\u3000" <= one <= "\u30ff" or "\uff01" <= one <= "\uff5e":
        return 7.0 + 2.0 * letters
    if "\u4e00" <= one <= "\u9fff":
        rare = one.encode(SHIFT_JIS)[0] >= _FIRST_RARE_KANJI
        return (18.0 if rare else 11.0) + (4.0 if rare else 2.0) * letters
    if "\ue000" <= one <= "\uf8ff" and not one >= "\uf900":  # for private use
        return 40.0
    return 14.0 + 2.0 * letters


def _western(text: str, k: int) -> float:
    """The cost of a character of Western European text."""
    before = text[k - 1]
    one = text[k]
    after = text[k + 1]
    if one.isalpha() and one not in "ƒˆªºµþÞ":
        beside = [other for other in (before, after) if other.isalpha()]
        lone = 10.0 if not beside else 5.0 if any(other.isascii() for other in beside) else 9.0
        return lone + (6.0 if one.isupper() and before.islower() else 0.0)
    if one == "’" and before.isalpha() and after.isalpha():
        return 6.0
    if one in _MARKS_BEHIND_NUMBERS:
        return 8.0
    if one in _QUOTES and _QUOTES[one] not in text[k:]:
        return 20.0
    return 11.0 if one in _SIGNS else 16.0
