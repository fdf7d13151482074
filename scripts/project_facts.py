"""Writes what pyproject.toml states of the project into the other files: addresses, version, summary, how to install.

`make pages` runs it. The only place of each is pyproject.toml: `[project]`, `[project.urls]` and `[tool.furrowmap]`.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT, URLS = PYPROJECT["project"], PYPROJECT["project"]["urls"]
ON_INDEX: bool = PYPROJECT["tool"]["furrowmap"]["on-index"]
MAIL: str = PROJECT["authors"][0]["email"]
CONDA = {"lazrs": "lazrs-python", "tzdata": "python-tzdata"}
"""Names at conda-forge that are others than those of the package index."""
WITH_EXTRAS = ("README.md", "docs/**/*.md", "app/notebooks/*.ipynb", "core/**/*.toml", "core/pipeline/*.py")
"""Files that say how to install an extra."""


def changelog() -> str:
    """What the changelog says first of the version."""
    text = (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    found = re.search(rf"^## \[{re.escape(PROJECT['version'])}\].*\n\n(.+(?:\n.+)*)", text, re.MULTILINE)
    said = " ".join(found[1].split()) if found else ""
    return f"{PROJECT['version']}: {said} All changes: {URLS['Repository'].rstrip('/')}/blob/HEAD/CHANGELOG.md"


def facts() -> dict[str, dict[str, str]]:
    """File → pattern of a line's beginning → what stands behind it."""
    return {
        "plugin/metadata.txt": {
            "version=": PROJECT["version"],
            "description=": PROJECT["description"],
            "author=": PROJECT["authors"][0]["name"],
            "email=": MAIL,
            "homepage=": URLS["Homepage"],
            "tracker=": URLS["Issues"],
            "repository=": URLS["Repository"],
            "changelog=": changelog(),
        },
        "CITATION.cff": {
            "version: ": PROJECT["version"],
            "abstract: ": f"{PROJECT['description']}.",
            "url: ": f'"{URLS["Homepage"]}"',
            "repository-code: ": f'"{URLS["Repository"]}"',
        },
        "recipe/recipe.yaml": {
            "  version: ": PROJECT["version"],
            "  homepage: ": URLS["Homepage"],
            "  repository: ": URLS["Repository"],
            "  summary: ": PROJECT["description"],
        },
        "mkdocs.yml": {"site_description: ": PROJECT["description"]},
    }


def conda_dependencies() -> Iterator[str]:
    """The lines of the recipe that state what furrowmap needs."""
    for text in PROJECT["dependencies"]:
        name, bound = re.fullmatch(r"([\w.-]+)(>=[\d.]+)(?:;.*)?", text).groups()
        yield f"    - {CONDA.get(name, name)} {bound}\n"


def with_facts(name: str, text: str) -> str:
    """The text of a file with the facts that it states.

    Raises:
        ValueError: if it does not state one that it should.
    """
    for start, value in facts().get(name, {}).items():
        text, found = re.subn(rf"(?m)^{re.escape(start)}.*$", lambda _, line=start + value: line, text)
        if found != 1:
            raise ValueError(f"{name} has no line {start}")
    if name == "recipe/recipe.yaml":
        text = re.sub(r"(  run:\n.*\n)(?:    - .*\n)*", lambda head: head[1] + "".join(conda_dependencies()), text)
    if name == "SECURITY.md":
        text = re.sub(r"<[^<>@\s]+@[^<>\s]+>", f"<{MAIL}>", text)
    return with_install(text)


def with_install(text: str) -> str:
    """A text with the command that installs an extra: from the checkout, until a package index has furrowmap."""
    if not ON_INDEX:
        return re.sub(r"(pip\sinstall\s\\?[\"'])furrowmap(\[[a-z0-9,]+\])", r"\1.\2", text)
    text = re.sub(r" {2}# in the checkout of furrowmap(?=\n)| in the checkout of furrowmap", "", text)
    text = text.replace("furrowmap のチェックアウト内で ", "")
    return re.sub(r"(pip\sinstall\s\\?[\"'])\.(\[[a-z0-9,]+\])", r"\1furrowmap\2", text)


def outdated() -> dict[Path, str]:
    """Files in which something else stands, and what should."""
    names = [*facts(), "SECURITY.md"]
    paths = [CHECKOUT / name for name in names] + [path for glob in WITH_EXTRAS for path in CHECKOUT.glob(glob)]
    texts = {path: path.read_text(encoding="utf-8") for path in paths}
    new = {path: with_facts(path.relative_to(CHECKOUT).as_posix(), text) for path, text in texts.items()}
    return {path: text for path, text in new.items() if text != texts[path]}


if __name__ == "__main__":
    for path, text in outdated().items():
        path.write_text(text, encoding="utf-8")
        print(f"Wrote {path.relative_to(CHECKOUT)}")
