"""What the documentation promises and can be checked by reading it: links, examples, tables."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
from packaging.requirements import Requirement

from furrowmap.core.session.session_file import FURTHER, parse_session
from furrowmap.core.values.session import Session

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHECKOUT = Path(__file__).resolve().parents[1]
DOCS = CHECKOUT / "docs"
PAGES = sorted([*CHECKOUT.glob("*.md"), *DOCS.rglob("*.md")])
PHONE_PX = 360
PAGE_IDS = [p.relative_to(CHECKOUT).as_posix() for p in PAGES]


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def anchors(path: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=PAGE_IDS)
def test_links__lead_somewhere(page: Path) -> None:
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"https?://|mailto:", target):
            continue
        name, _, anchor = target.partition("#")
        aim = page.parent / name if name else page
        assert aim.is_file(), f"{target} is not there"
        assert not anchor or anchor in anchors(aim), f"{target} has no such heading"


def test_navigation__lists_every_page_once() -> None:
    listed = re.findall(r"^ *- ([\w/.-]+\.md)$", (CHECKOUT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md"))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the site, built without a warning."""
    folder = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, CHECKOUT / "scripts" / "layout.py"], check=True)
    build = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(
        build,
        cwd=CHECKOUT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_site__describes_the_python_api(site: Path) -> None:
    assert "semantic versioning" in (site / "reference" / "api.html").read_text(encoding="utf-8")


def test_site__begins_with_the_picture_of_a_map(site: Path) -> None:
    page = (site / "index.html").read_text(encoding="utf-8")
    picture = re.search(r'<img alt="Map of a drive[^"]*" src="([^"]+)"', page)
    assert picture is not None
    assert (site / picture[1]).is_file()
    assert page.index(picture[0]) < page.index("<table>")


def test_site__opens_from_the_disk(site: Path) -> None:
    """Links lead to files: no web server makes an index.html of a folder."""
    for page in (site / "index.html", site / "how-to" / "install.html"):
        links = set(re.findall(r'href="([^"#:?]+)[^":]*"', page.read_text(encoding="utf-8")))
        assert len(links) > 50
        assert [link for link in links if not (page.parent / link).is_file()] == []


def test_site__is_no_wider_than_a_phone(site: Path, browser: Browser) -> None:
    """Wide tables, code and pictures scroll by themselves, or become smaller."""
    phone = browser.new_context(viewport={"width": PHONE_PX, "height": 740}, is_mobile=True, has_touch=True)
    phone.set_offline(True)  # a page read from a file asks for a script of the net, and waits for it
    shown = phone.new_page()
    widths = {}
    for page in sorted(site.rglob("*.html")):
        shown.goto(page.as_uri())
        widths[page.name] = shown.evaluate("document.documentElement.scrollWidth")
    phone.close()
    assert len(widths) > 90
    assert {name: width for name, width in widths.items() if width > PHONE_PX} == {}


@pytest.mark.parametrize("page", sorted((DOCS / "how-to").glob("*.md")), ids=lambda page: page.stem)
def test_how_to__begins_with_what_one_has_and_gets(page: Path) -> None:
    title, have_and_get, _ = page.read_text(encoding="utf-8").split("\n\n", 2)
    assert title.startswith("# ")
    lines = [" ".join(line.split()) for line in re.split(r"^- ", have_and_get, flags=re.MULTILINE)[1:]]
    assert len(lines) == 2
    assert lines[0].startswith("**You have** ")
    assert lines[1].startswith("**You get** ")
    assert [line for line in lines if len(line.split()) > 32 or not line.endswith(".")] == []


@pytest.mark.parametrize("page", PAGES, ids=PAGE_IDS)
def test_examples__are_valid_toml_and_python(page: Path) -> None:
    for text in blocks(page, "toml"):
        assert tomllib.loads(text)
    for text in blocks(page, "python"):
        assert ast.parse(text).body


def test_session_reference__is_a_valid_session_that_names_every_key() -> None:
    (example,) = blocks(DOCS / "reference" / "session.md", "toml")
    assert parse_session(example).crs.map == "EPSG:6677"
    written = tomllib.loads(example)
    tables = msgspec.json.schema(Session)["$defs"]
    keys = {key: value for key, value in tables["Session"]["properties"].items() if key not in FURTHER.values()}
    assert set(written) == set(keys)
    for key, value in keys.items():
        for table in re.findall(r"#/\$defs/(\w+)", str(value)):
            assert set(written[key]) == set(tables[table]["properties"]), f"[{key}]"


def test_dependencies__are_all_described() -> None:
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    page = (DOCS / "development" / "dependencies.md").read_text(encoding="utf-8").lower()
    extras = project["project"]["optional-dependencies"].values()
    named = [*project["project"]["dependencies"], *(text for extra in extras for text in extra), "fiona"]
    groups = [text for group in project["dependency-groups"].values() for text in group if isinstance(text, str)]
    names = {Requirement(text).name.lower() for text in (*named, *groups)}
    assert {name for name in names if f"**{name}**" not in page} == set()


def test_index__leads_to_every_page() -> None:
    docs = CHECKOUT / "docs"
    pages = {
        path.relative_to(docs).as_posix() for part in ("how-to", "explanation") for path in (docs / part).glob("*.md")
    }
    linked = set(re.findall(r"\]\(([\w/.-]+\.md)\)", (docs / "index.md").read_text(encoding="utf-8")))
    assert pages <= linked


README = CHECKOUT / "README.md"


def test_readme__is_short_and_begins_with_a_picture_and_two_commands() -> None:
    text = README.read_text(encoding="utf-8")
    assert len([word for word in text.split() if re.search(r"\w", word)]) <= 350
    assert "![" in "\n".join(text.splitlines()[:8])
    commands = [line.partition("#")[0].strip() for block in blocks(README, "sh") for line in block.splitlines()]
    assert commands[:2] == ["make demo", "make test"]
    makefile = (CHECKOUT / "Makefile").read_text(encoding="utf-8")
    assert all(re.search(rf"^{command.split()[1]}:", makefile, re.MULTILINE) for command in commands[:2])
    assert commands[2:4] == ["python3 -m venv env", ". env/bin/activate"]
    assert "/env/" in (CHECKOUT / ".gitignore").read_text(encoding="utf-8").split()


def test_readme__figures_are_those_of_the_page_that_it_names() -> None:
    text = README.read_text(encoding="utf-8")
    table = re.search(r"^\| .+?\]\((.+?\.md)\)\) \| error \|\n\| --- \| --- \|\n((?:\| .+ \|\n)+)", text, re.MULTILINE)
    assert table is not None
    rows = re.findall(r"^\| (.+?), (.+?) \| (.+?) \|$", table[2], re.MULTILINE)
    assert len(rows) == 3
    page = (CHECKOUT / table[1]).read_text(encoding="utf-8").lower()
    of_page = dict(re.findall(r"^\| (.+?) \| (.+ \| .+?) \|$", page, re.MULTILINE))
    for what, how, error in rows:
        figures = re.findall(r"[\d.]+|nine", f"{how} {error}")
        assert [figure for figure in figures if figure not in of_page[what.lower()]] == []
        assert len(figures) >= 2


def test_page_of_figures__is_short_and_has_one_table() -> None:
    text = (DOCS / "how-good-is-it.md").read_text(encoding="utf-8")
    assert len([word for word in text.split() if re.search(r"\w", word)]) <= 400
    assert text.count("| --- | --- | --- |\n") == text.count("| --- |\n") == 1
    rows = re.findall(r"^\| (.+?) \| (.+?) \| (.+?) \|$", text, re.MULTILINE)[2:]
    assert len(rows) >= 15
    assert all(re.search(r"\d|found", figure) for _, _, figure in rows)


def test_decisions__take_no_more_than_eight_thousand_words() -> None:
    words = sum(len(page.read_text(encoding="utf-8").split()) for page in (DOCS / "decisions").glob("*.md"))
    assert words <= 8_000
