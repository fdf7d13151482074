"""Set a value in the text of a TOML file; comments and all other characters are kept."""

import re
import tomllib
from typing import Final

from furrowmap.core.runtime.errors import RefusedError

_TABLE_HEADER: Final = re.compile(r"^[ \t]*\[+[ \t]*[A-Za-z]", re.MULTILINE)
_TOML_VALUE: Final = r"(\[[^\]]*\]|[^#\n]*?)(\s*(?:#[^\n]*)?)$"


_CALIBRATED: Final = re.compile(r"(;\s*|#\s*)?calibrated with the recording of .*$")


def with_value(text: str, table: str, key: str, value: str, origin: str = "") -> str:
    """The text with a key of a table set; a missing table or key is added.

    In a table with a header, `origin` becomes a comment behind the value: it follows the comment that is there, and
    replaces that of an earlier calibration.

    The table may be written as ``[table]``, ``table.key = …`` or ``table = { … }``; of several ``[[table]]`` it is the
    first. Line ends are kept. RefusedError if the table is written in another way.
    """
    windows = "\r\n" in text
    plain = text.replace("\r\n", "\n")
    changed = _changed(plain, table, key, value, origin)
    wanted = tomllib.loads(plain)
    tables = wanted.setdefault(table, {})
    (tables[0] if isinstance(tables, list) else tables)[key] = tomllib.loads(f"value = {value}")["value"]
    try:
        done = tomllib.loads(changed) == wanted
    except tomllib.TOMLDecodeError:
        done = False
    if not done:
        raise RefusedError("session-not-changed", key=key, table=table, value=value)
    return changed.replace("\n", "\r\n") if windows else changed


def _changed(text: str, table: str, key: str, value: str, origin: str) -> str:
    head = re.search(rf"^[ \t]*\[\[?[ \t]*{table}[ \t]*\]\]?[^\n]*\n?", text, re.MULTILINE)
    if head is not None:
        return _in_table(text, head, key, value, origin)
    first = _TABLE_HEADER.search(text)
    end = first.start() if first is not None else len(text)
    root = text[:end]
    rest = text[end:]
    inline = re.search(rf"^[ \t]*{table}[ \t]*=[ \t]*\{{([^}}\n]*)\}}", root, re.MULTILINE)
    if inline is not None:
        return root[: inline.start(1)] + _in_braces(inline.group(1), key, value) + root[inline.end(1) :] + rest
    dotted = list(re.finditer(rf"^[ \t]*{table}[ \t]*\.[ \t]*(\w+)[ \t]*=[ \t]*{_TOML_VALUE}", root, re.MULTILINE))
    for line in dotted:
        if line.group(1) == key:
            return root[: line.start(2)] + value + root[line.end(2) :] + rest
    if dotted:
        last = dotted[-1].end()
        return f"{root[:last]}\n{table}.{key} = {value}{root[last:]}{rest}"
    return f"{text.rstrip()}\n\n[{table}]\n{key} = {value}{_commented('', origin)}\n"


def _commented(comment: str, origin: str) -> str:
    """The comment behind a value, with where it is from."""
    if not origin:
        return comment
    words = comment.rstrip()
    kept = _CALIBRATED.sub("", words).rstrip()
    return (f"{kept}; {origin}" if kept.lstrip(" #") else f"   # {origin}") + comment[len(words) :]


def _in_table(text: str, head: re.Match[str], key: str, value: str, origin: str) -> str:
    after = _TABLE_HEADER.search(text, head.end())
    end = after.start() if after is not None else len(text)
    body = text[head.end() : end]
    line = re.compile(rf"^([ \t]*{key}\s*=\s*){_TOML_VALUE}", re.MULTILINE)
    if line.search(body):
        body = line.sub(lambda found: found.group(1) + value + _commented(found.group(3), origin), body, count=1)
    else:
        body = f"{key} = {value}{_commented('', origin)}\n{body}"
    before = text[: head.end()]
    return (before if before.endswith("\n") else before + "\n") + body + text[end:]


def _in_braces(inside: str, key: str, value: str) -> str:
    """The content of the braces of an inline table, with the key set."""
    there = re.compile(rf"((?:^|,)\s*{key}\s*=\s*)(\[[^\]]*\]|[^,\[\]]*?)(\s*(?:,|$))")
    if there.search(inside):
        return there.sub(lambda found: found.group(1) + value + found.group(3), inside, count=1)
    return f"{inside.rstrip()}, {key} = {value} " if inside.strip() else f" {key} = {value} "
