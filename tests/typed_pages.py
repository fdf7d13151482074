"""Types the commands of a page of the documentation in a folder, and compares each output that the page shows.

- Lines of a block `sh` that begin with `furrowmap` or `cat` are typed.
- A block `toml` is merged into the session file that the last `furrowmap init` wrote.
- Blocks `python` run one after another in one interpreter.
- A block `text` that follows one of these at once is its last output: all of it, with "…" as a line for lines, and
  within a line for text, that are left out or may differ.
- `<!-- not typed: reason -->` before a block leaves it out.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import tomli_w

DOCS = Path(__file__).resolve().parents[1] / "docs"
_BLOCK = re.compile(r"(<!-- not typed: .+? -->\n)?^( *)```(\w+)\n(.*?)^\2```$", re.MULTILINE | re.DOTALL)
_REST = "…"
_PYTHON = """
import contextlib, io, json, sys
names, outputs = {}, []
for text in json.load(sys.stdin):
    with contextlib.redirect_stdout(io.StringIO()) as shown:
        exec(compile(text, "page", "exec"), names)
    outputs.append(shown.getvalue())
print(json.dumps(outputs))
"""


def type_page(page: str, folder: Path, known: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
    """The output of each command (by its name; of Python as "python") of a page, named from docs, typed in a folder.

    Commands with a `known` output are not typed.
    """
    text = (DOCS / page).read_text(encoding="utf-8")
    blocks = [(block[3], block[4]) for block in _typed_blocks(text)]
    outputs, last, session = dict[str, str](), "", Path()
    of_python = iter(_python([body for kind, body in blocks if kind == "python"], folder))
    for kind, body in blocks:
        if kind == "sh":
            for words in (shlex.split(line, comments=True) for line in body.splitlines()):
                if words[:1] in (["furrowmap"], ["cat"]):
                    line = shlex.join(words)
                    last = outputs[words[1]] = known[line] if line in known else _typed(words, folder)
                if words[:2] == ["furrowmap", "init"]:
                    session = folder / last.splitlines()[0].removeprefix("Wrote ")
        elif kind == "toml":
            merged = _merged(tomllib.loads(session.read_text(encoding="utf-8")), tomllib.loads(body))
            session.write_text(tomli_w.dumps(merged), encoding="utf-8")
        elif kind == "python":
            last = outputs["python"] = next(of_python)
        elif kind == "text":
            assert re.fullmatch(_pattern(body), _plain(last)), f"{page} shows\n{body}\nand the program printed\n{last}"
    return outputs


def _typed_blocks(text: str) -> Iterator[re.Match[str]]:
    """The blocks of a page that count; of `text` those that follow another block at once."""
    end, counts = 0, False
    for block in _BLOCK.finditer(text):
        follows = counts and not text[end : block.start()].strip()
        counts, end = not block[1] and (block[3] != "text" or follows), block.end()
        if counts:
            yield block


def _typed(words: list[str], folder: Path) -> str:
    """What a terminal shows of a command: warnings, and standard output."""
    program = str(Path(sys.executable).with_name(words[0])) if words[0] == "furrowmap" else words[0]
    done = subprocess.run([program, *words[1:]], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{shlex.join(words)}\n{done.stderr}"
    return "".join(f"{line}\n" for line in done.stderr.splitlines() if line.startswith("warning: ")) + done.stdout


def _python(blocks: list[str], folder: Path) -> list[str]:
    if not blocks:
        return []
    words = [sys.executable, "-c", _PYTHON]
    done = subprocess.run(
        words, cwd=folder, input=json.dumps(blocks), capture_output=True, text=True, check=False, encoding="utf-8"
    )
    assert done.returncode == 0, done.stderr
    outputs: list[str] = json.loads(done.stdout)
    return outputs


def _pattern(shown: str) -> str:
    lines = _plain(shown).splitlines()
    return "".join(
        r"(?:.*\n)*?" if line.strip() == _REST else ".*?".join(map(re.escape, line.split(_REST))) + r"\n"
        for line in lines
    )


def _plain(text: str) -> str:
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())


def _merged(session: dict[str, Any], edit: dict[str, Any]) -> dict[str, Any]:
    tables = {key: session[key] | value for key, value in edit.items() if isinstance(session.get(key), dict)}
    return session | edit | tables
