"""What a package index and QGIS's plugin site refuse, before they do: `make release-check`.

Builds sdist, wheel and plugin in a folder for temporary files, and lists what is to be mended, and what only an owner
of the project has: addresses, the name on the index, a key. Ends with 1 where there is anything of either.
"""

from __future__ import annotations

import configparser
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from email.parser import BytesParser
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.request import Request, urlopen

from packaging.metadata import Metadata
from packaging.utils import parse_wheel_filename

sys.path.insert(0, str(Path(__file__).parent))
from project_facts import CHECKOUT, MAIL, ON_INDEX, PROJECT, URLS, outdated

PLACEHOLDER = re.compile(r"[/@.](?:example\.(?:org|com|net)|localhost)\b")
FILLED = ("pyproject.toml", "plugin/metadata.txt", "metadata.txt", "CITATION.cff", "SECURITY.md", "recipe/recipe.yaml")
"""Files that state addresses of the project: the one place, and those that project_facts.py fills."""
PAGE = {f"furrowmap/exporters/share/bundle/{name}" for name in ("map.js", "cloud.js", "licences.txt")}
REQUIRED_KEYS = ("name", "description", "version", "qgisMinimumVersion", "author", "email", "about", "tracker")
REQUIRED_KEYS += ("repository", "homepage")
MAX_ZIP = 25_000_000
BANDIT = (
    "B102,B103,B105,B106,B107,B108,B202,B301,B302,B303,B304,B305,B306,B307,B310,B312,B313,B314,B315,B316,B317,B318,"
    "B319,B320,B321,B323,B324,B501,B502,B503,B505,B506,B507,B508,B509,B602,B604,B605,B609,B610,B611,B701,B702"
)
"""Tests that block a version on QGIS's plugin site."""


def run(*command: str | Path, cwd: Path = CHECKOUT) -> subprocess.CompletedProcess[str]:
    """The outcome of a Python module run as a program."""
    return subprocess.run([sys.executable, "-m", *command], cwd=cwd, capture_output=True, text=True, check=False)


def of_an_owner() -> Iterator[str]:
    """What nobody but an owner of the project can decide."""
    for name, url in URLS.items():
        if PLACEHOLDER.search(url):
            yield f"{name} in [project.urls] is a placeholder: {url}"
    if PLACEHOLDER.search(MAIL):
        yield f"the mail address in [project] authors is a placeholder: {MAIL}"
    if not ON_INDEX:
        yield "no package index has the name furrowmap; once it is registered, set on-index in [tool.furrowmap]"
    key = subprocess.run(["git", "config", "user.signingkey"], cwd=CHECKOUT, capture_output=True, check=False)
    if not key.stdout.strip():
        yield "no key signs the tag of the release (git config user.signingkey)"


def facts() -> Iterator[str]:
    """Addresses, versions and texts that differ from pyproject.toml."""
    yield from (f"{path.relative_to(CHECKOUT)} differs from pyproject.toml: run make pages" for path in outdated())
    changes = (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    if not re.search(rf"^## \[{re.escape(PROJECT['version'])}\] - \d{{4}}-\d\d-\d\d$", changes, re.MULTILINE):
        yield f"CHANGELOG.md has no section of {PROJECT['version']} with its date"
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, capture_output=True, text=True, check=True).stdout
    for name in listed.split("\0"):
        path = CHECKOUT / name
        if name in FILLED or name.startswith(("tests/", "scripts/", "web/")) or not path.is_file():
            continue
        if PLACEHOLDER.search(path.read_bytes().decode("utf-8", "replace")):
            yield f"{name} has an address of its own"


def addresses() -> Iterator[str]:
    """Addresses that do not answer: QGIS's plugin site asks them, too."""
    for url in {url for url in URLS.values() if not PLACEHOLDER.search(url)}:
        try:
            with urlopen(Request(url, method="HEAD"), timeout=10):
                pass
        except OSError as error:
            yield f"{url} does not answer: {error}"


def package(folder: Path) -> Iterator[str]:
    """Build sdist and wheel into a folder; what an index, or a user of them, would miss."""
    build = "import sys; from setuptools.build_meta import build_sdist, build_wheel; "
    for what in ("sdist", "wheel"):
        code = f"{build}build_{what}(sys.argv[1])"
        done = subprocess.run([sys.executable, "-c", code, folder], cwd=CHECKOUT, capture_output=True, check=False)
        if done.returncode:
            yield f"the {what} cannot be built: {done.stderr.decode().strip().splitlines()[-1]}"
            return
    files = sorted(path for path in folder.iterdir() if path.name.startswith("furrowmap-"))
    twine = run("twine", "check", "--strict", *files)
    if twine.returncode:
        yield f"twine: {' '.join((twine.stdout + twine.stderr).split())}"
    from trove_classifiers import classifiers

    yield from (f"the index has no classifier {each}" for each in PROJECT["classifiers"] if each not in classifiers)
    (wheel,) = folder.glob("*.whl")
    yield from in_wheel(wheel)


def in_wheel(path: Path) -> Iterator[str]:
    """What is wrong with a wheel."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        (about,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = archive.read(about)
    if parse_wheel_filename(path.name)[2] or not {*names} >= PAGE:
        yield "the wheel has no page of furrowmap share, or not the licences of its scripts: run make web"
    if len([name for name in names if name.endswith("LICENSE") and ".dist-info/" in name]) != 2:
        yield "the wheel has not both licences"
    try:
        Metadata.from_email(metadata, validate=True)
    except ExceptionGroup as group:
        yield from (f"metadata: {error}" for error in group.exceptions)
    for link in relative_links(str(BytesParser().parsebytes(metadata).get_payload())):
        yield f"README.md leads nowhere from an index: {link}"


def relative_links(text: str) -> list[str]:
    """Targets of links and pictures of a Markdown text that only a checkout has."""
    return re.findall(r"\]\((?!https?:|mailto:|#)([^)]*)\)", text)


def plugin(folder: Path) -> Iterator[str]:
    """Write the plugin's zip into a folder; what QGIS's site would refuse or block."""
    from furrowmap.workflows.share.qgis_plugin import write_plugin_zip

    write_plugin_zip(folder / "furrowmap.zip")
    yield from in_zip(folder / "furrowmap.zip")
    with zipfile.ZipFile(folder / "furrowmap.zip") as archive:
        archive.extractall(folder)
    yield from metadata_of(folder / "furrowmap")
    for check in (bandit, secrets, flake8):
        yield from check(folder / "furrowmap")


def in_zip(path: Path) -> Iterator[str]:
    """What is wrong with the names and the size of the zip."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if path.stat().st_size > MAX_ZIP:
        yield f"the plugin's zip has {path.stat().st_size:,} bytes; {MAX_ZIP:,} are allowed"
    for name in names:
        if re.search(r"\.\.|^/|\\|:|\.pyc$|__pycache__|\.git|__MACOSX", name) or not name.startswith("furrowmap/"):
            yield f"the plugin's zip has a name that is refused: {name}"
        if not re.search(r"\.(py|json|ts|svg|txt|html|css|qml|qpt|png|ui)$|/LICENSE$", name):
            yield f"the plugin's zip has a file of a kind that is looked at: {name}"
    for name in ("__init__.py", "metadata.txt", "LICENSE"):
        if f"furrowmap/{name}" not in names:
            yield f"the plugin's zip has no {name}"


def metadata_of(folder: Path) -> Iterator[str]:
    """What is wrong with the metadata of a plugin."""
    parser = configparser.ConfigParser(interpolation=None)
    parser.read(folder / "metadata.txt", encoding="utf-8")
    general = parser["general"]
    for key in (*REQUIRED_KEYS, "changelog", "tags", "icon", "qgisMaximumVersion"):
        if not general.get(key):
            yield f"metadata.txt has no {key}"
    if "/" in general.get("author", ""):
        yield "metadata.txt: the author has a slash"
    if "plugin" in general.get("name", "").lower():
        yield "metadata.txt: 'plugin' in the name"
    if not (general.get("description", "").isascii() and len(general.get("description", "")) <= 200):
        yield "metadata.txt: the description is not a short English one"
    for word in ("tractor", "flight", "Python package"):
        if word not in general.get("about", ""):
            yield f"metadata.txt: about does not say {word!r}"
    if general.get("icon") and not (folder / general["icon"]).is_file():
        yield f"metadata.txt: there is no icon {general['icon']}"


def bandit(folder: Path) -> Iterator[str]:
    """What Bandit finds that is critical on the site."""
    done = run("bandit", "--quiet", "--recursive", "--format", "json", "--tests", BANDIT, folder)
    answer = json.loads(done.stdout)
    yield from (f"bandit: {error}" for error in answer["errors"])
    for found in answer["results"]:
        yield f"bandit: {Path(found['filename']).name}:{found['line_number']} {found['test_id']}"


def secrets(folder: Path) -> Iterator[str]:
    """What detect-secrets takes for a secret."""
    answer = json.loads(run("detect_secrets", "scan", "--all-files", ".", cwd=folder).stdout)
    for name, found in answer["results"].items():
        yield from (f"detect-secrets: {name}:{each['line_number']} {each['type']}" for each in found)


def flake8(folder: Path) -> Iterator[str]:
    """What flake8 finds that counts; the site only shows the rest."""
    done = run("flake8", "--isolated", "--select", "E9,F821,F823,F831", ".", cwd=folder)
    yield from (f"flake8: {line}" for line in (done.stdout + done.stderr).splitlines())


def main() -> int:
    """Print what is found."""
    with TemporaryDirectory() as scratch:
        folders = [Path(scratch, name) for name in ("package", "plugin")]
        for folder in folders:
            folder.mkdir()
        found = [*facts(), *addresses(), *package(folders[0]), *plugin(folders[1])]
        shown = run(
            "flake8", "--isolated", "--quiet", "--statistics", "--count", ".", cwd=folders[1] / "furrowmap"
        ).stdout
    owners = list(of_an_owner())
    for title, lines in (("To be mended:", found), ("Only an owner of the project can:", owners)):
        if lines:
            print(title, *(f"- {line}" for line in lines), sep="\n")
    kinds = [line for line in shown.splitlines() if re.match(r"\d+ +[A-Z]\d", line)]
    print("The plugin site will show, without effect (flake8):", *(f"  {line}" for line in kinds), sep="\n")
    return 1 if found or owners else 0


if __name__ == "__main__":
    sys.exit(main())
