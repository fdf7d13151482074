"""The texts of errors and warnings as templates, by code, from the source; … stands for what varies.

A catalogue of a language (core/runtime/languages) has an entry for each: ``python scripts/message_texts.py`` prints
those that it lacks.
"""

from __future__ import annotations

import ast
import re
import runpy
from itertools import product
from pathlib import Path
from typing import Any, Final

HOLE: Final = "…"
MOST: Final = 24
"""Variants of one text; texts with more have a hole for each choice."""
CALLS: Final[Any] = runpy.run_path(str(Path(__file__).with_name("code_reference.py")))["calls"]


def templates() -> dict[str, list[str]]:
    """Every text of each code: those of warnings, and the three parts of errors."""
    found: dict[str, dict[str, None]] = {}
    for call in CALLS():
        for text in call.texts:
            for one in variants(text, call.words):
                if re.search(r"[A-Za-z]{2}", one):
                    found.setdefault(call.code, {}).setdefault(one)
    return {code: list(texts) for code, texts in sorted(found.items())}


def variants(node: ast.expr | None, words: dict[str, list[ast.expr]]) -> list[str]:
    """The texts that an expression can be; values known only at run time become holes."""
    texts = dict.fromkeys(re.sub(rf"{HOLE}(?:{HOLE})+", HOLE, " ".join(t.split())) for t in _raw(node, words))
    return list(texts)


def _raw(node: ast.expr | None, words: dict[str, list[ast.expr]]) -> list[str]:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    if isinstance(node, ast.JoinedStr):
        return _joined([_raw(value, words) for value in node.values])
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _joined([_raw(node.left, words), _raw(node.right, words)])
    if isinstance(node, ast.IfExp):
        return [*_raw(node.body, words), *_raw(node.orelse, words)]
    if isinstance(node, ast.FormattedValue):
        return _raw(node.value, words)
    if isinstance(node, ast.Name) and node.id in words:
        inner = {name: values for name, values in words.items() if name != node.id}
        return [text for value in words[node.id] for text in _raw(value, inner)]
    return [HOLE]


def _joined(parts: list[list[str]]) -> list[str]:
    """Every combination of the variants of parts of a text."""
    number = 1
    for part in parts:
        number *= len(part)
    if number > MOST:
        parts = [part if len(part) == 1 else [HOLE] for part in parts]
    return ["".join(choice) for choice in product(*parts)]


if __name__ == "__main__":
    from furrowmap.core.runtime.languages.catalogue import catalogue

    known = catalogue("ja")
    for code, texts in templates().items():
        for text in texts:
            if text not in known.of_code(code):
                print(f"{code}\t{text}")
