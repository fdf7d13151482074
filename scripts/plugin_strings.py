"""Brings the files of plugin/i18n up to date with the plugin's sources: ``python scripts/plugin_strings.py``.

New strings get an unfinished entry, strings that no longer exist are removed, translations are kept. A string's context
is the one that its file's ``tr`` or its ``QT_TRANSLATE_NOOP`` names, else its class, as in Qt's own ``tr``.
"""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape

from furrowmap.plugin.processing.description import ALGORITHMS, TOOLBOX_GROUPS

PLUGIN = Path(__file__).resolve().parents[1] / "plugin"
LEGENDS = json.loads((PLUGIN / "legends.json").read_text(encoding="utf-8"))
UNFINISHED = '<translation type="unfinished"/>'
TRANSLATIONS = {path.stem.partition("_")[2]: path for path in sorted((PLUGIN / "i18n").glob("furrowmap_*.ts"))}
"""The file of each language; a new one begins as an empty file."""
STAGES = (
    "reading positions",
    "reading scans",
    "looking at scans",
    "matching scans",
    "looking at control points",
    "placing points",
    "finding features",
    "matching images",
    "adjusting images",
    "reading images",
    "looking for the board",
    "hashing inputs",
    "writing cloud",
    "making surfaces",
    "writing layers",
    "writing the preview",
    "work",
    "reading clouds",
    "measuring density",
    "looking for noise",
    "cleaning clouds",
    "filling gaps",
    "exporting",
    "reading results",
    "writing the page",
    "writing the project",
    "writing the farm map",
    "writing the mosaic",
    "waiting for another process",
)
"""Stages of a run in their order, then those of other commands. The plugin shows others in English."""
Strings = dict[tuple[str, str], str]


def source_strings() -> list[tuple[str, str]]:
    """(context, string) of every string in the plugin that is to be translated, sorted.

    Raises:
        ValueError: if the string is not a literal, or has no context.
    """
    found = {("Algorithms", text) for text in description_strings()} | {("Legends", text) for text in legend_strings()}
    found |= {("Classes", label) for _, _, label in LEGENDS["classes"]}
    found |= {("Stages", text) for text in STAGES}
    for path in sorted(PLUGIN.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        own = _own_context(tree)
        for call, class_name in _calls(tree):
            context = own or class_name
            name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
            literals = [_literal(argument) for argument in call.args]
            if name == "tr":
                if not context or len(literals) != 1 or literals[0] is None:
                    raise ValueError(f"{path.name}:{call.lineno}: no literal string, or tr names no context")
                found.add((context, literals[0]))
            elif name in ("translate", "QT_TRANSLATE_NOOP") and len(literals) > 1 and literals[0] and literals[1]:
                found.add((literals[0], literals[1]))
    return sorted(found)


def description_strings() -> set[str]:
    """The texts of the algorithms' descriptions, with the help that comes from the command line."""
    texts = {title for title, _ in TOOLBOX_GROUPS.values()}
    for algorithm in ALGORITHMS:
        texts |= {algorithm.title, algorithm.summary, algorithm.layer_group}
        texts |= {text for parameter in algorithm.parameters for text in (parameter.label, parameter.help)}
        texts |= {output.label for output in algorithm.outputs if output.label.lower() != output.name.lower()}
    return texts - {""}


def legend_strings() -> set[str]:
    """The names of layers and labels of legends."""
    return {
        *LEGENDS["colours"],
        *(text for part in ("bands", "without_work", "layers") for text in LEGENDS[part].values()),
    }


def _calls(node: ast.AST, class_name: str = "") -> Iterator[tuple[ast.Call, str]]:
    """Every call, and the class in which it stands: the context of Qt's own `tr`."""
    for below in ast.iter_child_nodes(node):
        if isinstance(below, ast.Call):
            yield below, class_name
        yield from _calls(below, below.name if isinstance(below, ast.ClassDef) else class_name)


def _own_context(tree: ast.Module) -> str | None:
    """The context of the file's own ``tr = partial(QCoreApplication.translate, CONTEXT)``."""
    for line in (node for node in tree.body if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)):
        if getattr(line.targets[0], "id", "") == "tr":
            return _literal(line.value.args[1])
    return None


def _literal(node: ast.expr) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def translations(language: str) -> Strings:
    """(context, string) → translation, of those that are finished."""
    path = TRANSLATIONS[language]
    if not path.stat().st_size:
        return {}
    return {
        (context.findtext("name", ""), message.findtext("source", "")): message.findtext("translation", "")
        for context in ET.parse(path).getroot().iter("context")
        for message in context.iter("message")
        if message.find("translation[@type]") is None
    }


def page(language: str, strings: list[tuple[str, str]], known: Strings) -> str:
    """The .ts file."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<!DOCTYPE TS>", f'<TS version="2.1" language="{language}">']
    for context in sorted({context for context, _ in strings}):
        lines += ["<context>", f"  <name>{context}</name>"]
        for source in (text for name, text in strings if name == context):
            translation = known.get((context, source))
            done = f"<translation>{escape(translation)}</translation>" if translation else UNFINISHED
            lines += [f"  <message><source>{escape(source)}</source>{done}</message>"]
        lines += ["</context>"]
    return "\n".join([*lines, "</TS>", ""])


if __name__ == "__main__":
    strings = source_strings()
    all_done = True
    for language, path in TRANSLATIONS.items():
        known = translations(language)
        path.write_text(page(language, strings, known), encoding="utf-8")
        unfinished = [string for string in strings if string not in known]
        print(f"{path}: {len(strings)} strings, {len(unfinished)} are not translated")
        all_done = all_done and not unfinished
    sys.exit(not all_done)
