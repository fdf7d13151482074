"""Writes docs/reference/codes.md from the codes in the source: ``python scripts/code_reference.py``."""

from __future__ import annotations

import ast
import re
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

CHECKOUT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = CHECKOUT / "docs" / "reference" / "codes.md"
PARTS: Final = ("app", "core", "exporters", "cli")
NOTICE: Final = "Notice"
CODE: Final = "code"
"""The parameter for the code, of errors and of functions that make them."""
ANYTHING: Final = "…"
"""Replaces values that vary, such as file names and numbers."""
HEAD: Final = """\
# Codes of errors and warnings

<!-- Written by scripts/code_reference.py from the source. -->

Every error and warning has a code that does not change between versions: `code` in the JSON of an error, and in
`warnings` of `report.json`. … replaces values that vary, such as file names and numbers. A code with several messages
has a row for each.
"""


Words: TypeAlias = dict[str, list[ast.expr]]
"""The expressions that may have been assigned to each name."""


Helpers: TypeAlias = dict[str, tuple[ast.FunctionDef, Words]]
"""Functions with a parameter `code`, by name, each with the assignments of its file."""


class Call(NamedTuple):
    """A call that makes an error or a notice: its code, the expressions of its texts, and what names in them can be."""

    code: str
    texts: list[ast.expr]
    words: Words
    error: bool


class Message(NamedTuple):
    """A code and the text of its message."""

    code: str
    text: str
    remedy: str
    error: bool


def page() -> str:
    """The generated page."""
    messages = sorted(set(found()))
    errors = [f"| `{t.code}` | {t.text} | {t.remedy} |" for t in messages if t.error]
    notices = [f"| `{t.code}` | {t.text} |" for t in messages if not t.error]
    return "\n".join(
        [
            HEAD,
            "## Warnings\n",
            "Warnings do not change the exit status. A run prints them and lists them in its reports.\n",
            "| code | message |\n| --- | --- |",
            *notices,
            "\n## Errors\n",
            "| code | message | remedy |\n| --- | --- | --- |",
            *errors,
            "",
        ]
    )


def found() -> Iterator[Message]:
    """Every message in the source."""
    for call in calls():
        texts = [_text(text, call.words) for text in call.texts]
        yield Message(
            call.code, texts[0] if call.error else _first(texts[0]), texts[2] if call.error else "", call.error
        )


def calls() -> Iterator[Call]:
    """Every call in the source that makes an error or a notice."""
    for part in PARTS:
        for folder in sorted({file.parent for file in (CHECKOUT / part).rglob("*.py")}):
            texts = [file.read_text(encoding="utf-8") for file in sorted(folder.glob("*.py"))]
            trees = [ast.parse(text if re.search(rf"\b({CODE}|{NOTICE})\b", text) else "") for text in texts]
            own = [_helpers(tree) for tree in trees]
            helpers = {name: helper for of_file in own for name, helper in of_file.items()}  # of base classes too
            called = re.compile(rf"\b({'|'.join(helpers)})\b") if helpers else None
            for text, tree, of_file in zip(texts, trees, own, strict=True):
                whole = ast.parse(text) if not tree.body and called and called.search(text) else tree
                yield from _found(whole.body, {}, helpers | of_file)


def _helpers(tree: ast.Module) -> Helpers:
    """Functions with a parameter `code`, each with the assignments of its file."""
    simple = [statement for statement in tree.body if isinstance(statement, ast.Assign | ast.AnnAssign)]
    words = {name: values for statement in simple for name, values in _assigned(statement).items()}
    return {
        node.name: (node, words)
        for statement in tree.body
        for node in _statements(statement)
        if isinstance(node, ast.FunctionDef) and CODE in {argument.arg for argument in node.args.args}
    }


def _found(block: list[ast.stmt], outer: Words, helpers: Helpers) -> Iterator[Call]:
    """The messages of a block of statements, each with the assignments before it."""
    words = dict(outer)
    for statement in block:
        blocks = list(_blocks(statement))
        for call in _own(statement, blocks):
            if isinstance(call, ast.Call):
                yield from _messages(call, words)
                helper = helpers.get(_name(call))
                if helper is not None:
                    yield from _helped(call, *helper, words)
        for inner in blocks:
            yield from _found(inner, words, helpers)
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            words |= _assigned(statement)
        elif not isinstance(statement, ast.FunctionDef | ast.ClassDef):
            words |= {name: words.get(name, []) + values for name, values in _assigned(statement).items()}


def _helped(call: ast.Call, helper: ast.FunctionDef, own: Words, words: Words) -> Iterator[Call]:
    """The messages of a helper for the arguments of a call."""
    names = [argument.arg for argument in helper.args.args if argument.arg not in ("self", "cls")]
    given = dict(zip(names, call.args, strict=False)) | {k.arg: k.value for k in call.keywords if k.arg}
    if CODE not in given:
        return
    known = {n: words.get(value.id, [value]) if isinstance(value, ast.Name) else [value] for n, value in given.items()}
    for inner in ast.walk(helper):
        if isinstance(inner, ast.Call):
            for code in _constants(given[CODE]):
                yield from _messages(inner, own | known, given=code)


def _blocks(statement: ast.stmt) -> Iterator[list[ast.stmt]]:
    """The blocks of statements within a statement: a function's body, the branches of an `if`."""
    for _, value in ast.iter_fields(statement):
        if isinstance(value, list) and value and isinstance(value[0], ast.stmt):
            yield value
        elif isinstance(value, list):
            yield from (part.body for part in value if isinstance(part, ast.ExceptHandler | ast.match_case))


def _statements(statement: ast.stmt) -> Iterator[ast.stmt]:
    """A statement and those in its blocks."""
    yield statement
    for block in _blocks(statement):
        for inner in block:
            yield from _statements(inner)


def _own(statement: ast.stmt, blocks: list[list[ast.stmt]]) -> Iterator[ast.AST]:
    """The nodes of a statement but those in its blocks: a walk of these at every depth took four times as long."""
    inner = {line for block in blocks for line in block}
    todo: deque[ast.AST] = deque([statement])
    while todo:
        yield (node := todo.popleft())
        todo.extend(child for child in ast.iter_child_nodes(node) if child not in inner)


def _assigned(statement: ast.stmt) -> Words:
    """The assignments to names in a statement and its branches."""
    words: Words = {}
    for node in _statements(statement):
        if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(node.value, ast.expr):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                if isinstance(target, ast.Name):
                    words.setdefault(target.id, []).append(node.value)
    return words


def _name(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")


def _messages(call: ast.Call, words: Words, given: str = "") -> Iterator[Call]:
    """The messages of a call; `given` is the code passed to the helper that contains it."""
    arguments = call.args
    code = next((keyword.value for keyword in call.keywords if keyword.arg == CODE), None)
    if _name(call) == NOTICE and arguments:
        text = arguments[1] if len(arguments) > 1 else next((k.value for k in call.keywords if k.arg == "text"), None)
        for each in _codes(arguments[0], given) if text is not None else ():
            yield Call(each, [text], words, error=False)
    elif code is not None and len(arguments) >= 3:
        for each in _codes(code, given):
            yield Call(each, arguments[:3], words, error=True)


def _codes(node: ast.expr, given: str) -> list[str]:
    """The codes that an expression can be."""
    if given:
        return [given] if isinstance(node, ast.Name) and node.id == CODE else []
    return list(_constants(node))


def _constants(node: ast.expr) -> Iterator[str]:
    """The strings that an expression can be."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from _constants(node.body)
        yield from _constants(node.orelse)


def _text(node: ast.expr | None, words: Words) -> str:
    """An expression as a table cell; values known only at run time become an ellipsis."""
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
