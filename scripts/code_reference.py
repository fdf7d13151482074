"""Writes docs/reference/codes.md from the codes in the source: ``python scripts/code_reference.py``."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

CHECKOUT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = CHECKOUT / "docs" / "reference" / "codes.md"
PARTS: Final = ("app", "core", "exporters", "cli")
NOTICE: Final = "Notice"
CODE: Final = "code"
"""What the argument is called by which errors, and functions that make them, are given their code."""
ANYTHING: Final = "…"
"""Stands for what differs from case to case: a file, a number."""
HEAD: Final = """\
# Codes of errors and warnings

<!-- Written by scripts/code_reference.py from the source. -->

Programs tell errors and warnings apart by their codes: `code` in the JSON of an error, `warnings` in
`report.json`. … stands for what differs from case to case; a code that is used in several places has a line for each.
"""


Words: TypeAlias = dict[str, list[ast.expr]]
"""What may have been assigned to each name where a code is told."""


Helpers: TypeAlias = dict[str, tuple[ast.FunctionDef, Words]]
"""Functions by name that tell with a code that they are given, each with what its file assigns."""


class Told(NamedTuple):
    """A code where it is used, and the sentences told with it."""

    code: str
    says: str
    remedy: str
    error: bool


def page() -> str:
    """The page as it should be."""
    told = sorted(set(found()))
    errors = [f"| `{t.code}` | {t.says} | {t.remedy} |" for t in told if t.error]
    notices = [f"| `{t.code}` | {t.says} |" for t in told if not t.error]
    return "\n".join(
        [
            HEAD,
            "## Warnings\n",
            "They do not change the exit status; they are told at the end of a run, on its page and in its report.\n",
            "| code | says |\n| --- | --- |",
            *notices,
            "\n## Errors\n",
            "| code | says | what to do |\n| --- | --- | --- |",
            *errors,
            "",
        ]
    )


def found() -> Iterator[Told]:
    """Every place of the source where a code is used."""
    for part in PARTS:
        for folder in sorted({file.parent for file in (CHECKOUT / part).rglob("*.py")}):
            trees = [ast.parse(file.read_text(encoding="utf-8")) for file in sorted(folder.glob("*.py"))]
            helpers = {name: helper for tree in trees for name, helper in _helpers(tree).items()}  # of base classes too
            for tree in trees:
                yield from _found(tree.body, {}, helpers | _helpers(tree))


def _helpers(tree: ast.Module) -> Helpers:
    """Functions that tell with a code that they are given, each with the words of its file."""
    simple = [statement for statement in tree.body if isinstance(statement, ast.Assign | ast.AnnAssign)]
    words = {name: values for statement in simple for name, values in _assigned(statement).items()}
    return {
        node.name: (node, words)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and CODE in {argument.arg for argument in node.args.args}
    }


def _found(block: list[ast.stmt], outer: Words, helpers: Helpers) -> Iterator[Told]:
    """The codes of a block of statements, of which each knows what was assigned before it."""
    words = dict(outer)
    for statement in block:
        blocks = list(_blocks(statement))
        within = {node for inner in blocks for line in inner for node in ast.walk(line)}
        for call in ast.walk(statement):
            if isinstance(call, ast.Call) and call not in within:
                yield from _told(call, words)
                helper = helpers.get(_name(call))
                if helper is not None:
                    yield from _helped(call, *helper, words)
        for inner in blocks:
            yield from _found(inner, words, helpers)
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            words |= _assigned(statement)
        elif not isinstance(statement, ast.FunctionDef | ast.ClassDef):
            words |= {name: words.get(name, []) + values for name, values in _assigned(statement).items()}


def _helped(call: ast.Call, helper: ast.FunctionDef, own: Words, words: Words) -> Iterator[Told]:
    """What a helper with its own words tells where it is called so, among these words."""
    names = [argument.arg for argument in helper.args.args if argument.arg not in ("self", "cls")]
    given = dict(zip(names, call.args, strict=False)) | {k.arg: k.value for k in call.keywords if k.arg}
    if CODE not in given:
        return
    known = {n: words.get(value.id, [value]) if isinstance(value, ast.Name) else [value] for n, value in given.items()}
    for inner in ast.walk(helper):
        if isinstance(inner, ast.Call):
            for code in _constants(given[CODE]):
                yield from _told(inner, own | known, given=code)


def _blocks(statement: ast.stmt) -> Iterator[list[ast.stmt]]:
    """The blocks of statements within a statement: a function's body, the branches of an `if`."""
    for _, value in ast.iter_fields(statement):
        if isinstance(value, list) and value and isinstance(value[0], ast.stmt):
            yield value
        elif isinstance(value, list):
            yield from (part.body for part in value if isinstance(part, ast.ExceptHandler | ast.match_case))


def _assigned(statement: ast.stmt) -> Words:
    """What a statement assigns to names, in any of its branches."""
    words: Words = {}
    for node in ast.walk(statement):
        if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(node.value, ast.expr):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                if isinstance(target, ast.Name):
                    words.setdefault(target.id, []).append(node.value)
    return words


def _name(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")


def _told(call: ast.Call, words: Words, given: str = "") -> Iterator[Told]:
    """What a call tells; `given` is the code that a helper was given, whose own calls these are."""
    arguments = call.args
    code = next((keyword.value for keyword in call.keywords if keyword.arg == CODE), None)
    if _name(call) == NOTICE and arguments:
        says = arguments[1] if len(arguments) > 1 else next((k.value for k in call.keywords if k.arg == "text"), None)
        for each in _codes(arguments[0], given):
            yield Told(each, _first(_text(says, words)), "", error=False)
    elif code is not None and len(arguments) >= 3:
        for each in _codes(code, given):
            yield Told(each, _text(arguments[0], words), _text(arguments[2], words), error=True)


def _codes(node: ast.expr, given: str) -> list[str]:
    """The codes that an expression can be."""
    if given:
        return [given] if isinstance(node, ast.Name) and node.id == CODE else []
    return list(_constants(node))


def _constants(node: ast.expr) -> Iterator[str]:
    """The texts that an expression can be."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from _constants(node.body)
        yield from _constants(node.orelse)


def _text(node: ast.expr | None, words: Words) -> str:
    """An expression as a table's cell; what is known only when it is told becomes an ellipsis."""
    text = re.sub(r"\s+", " ", _raw(node, words)).replace("|", "\\|").replace("<", "&lt;").strip()
    return re.sub(rf"{ANYTHING}(?:\s*{ANYTHING})+", ANYTHING, text)


def _raw(node: ast.expr | None, words: Words) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(_raw(value, words) for value in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _raw(node.left, words) + _raw(node.right, words)
    if isinstance(node, ast.IfExp):
        branches = dict.fromkeys(_raw(branch, words) for branch in (node.body, node.orelse))
        return " / ".join(branches) if all(re.search(r"\w|…", branch) for branch in branches) else ANYTHING
    if isinstance(node, ast.FormattedValue):
        return _raw(node.value, words) if isinstance(node.value, ast.Name) else ANYTHING
    if isinstance(node, ast.Name) and node.id in words:
        texts = [_raw(value, {}) for value in words[node.id]]
        return ANYTHING if ANYTHING in texts else " / ".join(filter(None, texts))
    return ANYTHING


def _first(text: str) -> str:
    """The first two sentences."""
    sentences = re.split(r"(?<=[.!?]) (?=[A-Z`…])", text)
    return " ".join(sentences[:2])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
