"""What an installation gets: the wheel, the source distribution, and the scripts that make them on any system."""

from __future__ import annotations

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement

from tests.conftest import installed
from tests.test_house import CHECKOUT, PARTS, PROJECT, UNTESTED, repository_files

sys.path.insert(0, str(CHECKOUT / "scripts"))
import project_facts
import release_check
import web_bundle
from installing import CannotInstallError, apt_install, digest, locked
from layout import link

BUNDLE = ("cloud.js", "licences.txt", "map.js", "stamp")


@pytest.fixture(scope="module")
def without_npm(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of somebody who has neither npm nor an earlier build of the page, nor any other program."""
    return os.environ | {"PATH": "", "XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache"))}


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository's files, in a folder with another name than the checkout's."""
    folder = tmp_path_factory.mktemp("copied") / "some checkout"
    for path in repository_files():
        copy = folder / path.relative_to(CHECKOUT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    return folder


@pytest.fixture(scope="module")
def wheel(copied: Path, without_npm: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the repository's files, built without npm."""
    folder = tmp_path_factory.mktemp("wheel")
    (copied / "build" / "lib" / "furrowmap").mkdir(parents=True)
    (copied / "build" / "lib" / "furrowmap" / "of_an_earlier_build.py").touch()
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-build-isolation", "--no-deps"]
    subprocess.run([*build, "--wheel-dir", folder, copied], env=without_npm, check=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where that wheel is installed."""
    folder = tmp_path_factory.mktemp("site")
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-compile"]
    subprocess.run([*install, "--target", folder, wheel], check=True)
    return folder


def test_wheel__holds_every_module_and_its_data_and_nothing_else(wheel: Path) -> None:
    data = {".typed", ".toml", ".qml", ".html", ".css", ".js", ".ipynb"}
    expected = {
        f"furrowmap/{path.relative_to(CHECKOUT).as_posix()}".replace("furrowmap/app/", "furrowmap/")
        for path in repository_files()
        if (path.relative_to(CHECKOUT).parts[0] in PARTS and path.suffix in data | {".py"})
        or path.relative_to(CHECKOUT).parts[0] == "plugin"
    }
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        licences = [name for name in archive.namelist() if name.endswith("LICENSE") and ".dist-info/" in name]
    assert names == expected
    assert "furrowmap/py.typed" in names
    assert len(licences) == 2  # furrowmap's own, and the plugin's


def test_wheel__without_the_page_of_share_has_that_in_its_name(wheel: Path) -> None:
    version = PROJECT["project"]["version"]
    assert wheel.name == f"furrowmap-{version}-0_without_page_of_share-py3-none-any.whl"
    (found,) = release_check.in_wheel(wheel)
    assert "no page of furrowmap share" in found


def test_wheel__installs_and_imports_as_furrowmap(site: Path) -> None:
    packages = PROJECT["tool"]["setuptools"]["packages"]
    code = f"import importlib\nfor name in {packages}: print(importlib.import_module(name).__file__)"
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(site)},
        cwd=site,
        capture_output=True,
        text=True,
        check=True,
    )
    places = [Path(line) for line in run.stdout.splitlines()]
    assert len(places) == len(packages)
    assert [place for place in places if not place.is_relative_to(site)] == []


def test_wheel__writes_notebooks_and_the_plugins_zip(site: Path, tmp_path: Path) -> None:
    program = [sys.executable, "-c", "from furrowmap.cli.main import main; main()"]
    for command in (["notebooks", "examples"], ["qgis", "zip"], ["qgis", "install", "--plugins-folder", "plugins"]):
        subprocess.run([*program, *command], cwd=tmp_path, env={"PYTHONPATH": str(site)}, check=True)
    assert {path.name for path in (tmp_path / "examples").iterdir()} == {
        "any-cloud.ipynb",
        "christiansen-et-al.ipynb",
        "nakagawa-et-al.ipynb",
    }
    with zipfile.ZipFile(tmp_path / f"furrowmap-{PROJECT['project']['version']}.zip") as archive:
        packed = {name.removeprefix("furrowmap/"): archive.read(name) for name in archive.namelist()}
    plugin = CHECKOUT / "plugin"
    assert packed == {
        p.relative_to(plugin).as_posix(): p.read_bytes() for p in repository_files() if plugin in p.parents
    }
    assert (tmp_path / "plugins" / "furrowmap" / "metadata.txt").read_bytes() == packed["metadata.txt"]


def test_sdist__holds_the_repository_and_the_page_and_its_tests_run(
    copied: Path, without_npm: dict[str, str], tmp_path: Path
) -> None:
    """The page as it is built elsewhere: a wheel of this sdist has it, without npm."""
    page = copied / "exporters" / "share" / "bundle"
    page.mkdir()
    for name in BUNDLE:
        (page / name).write_text("built elsewhere")
    sources = [copied / path.relative_to(CHECKOUT) for path in web_bundle.SOURCES]
    (page / "stamp").write_text(digest(sources))
    build = "from setuptools.build_meta import build_sdist; import sys; build_sdist(sys.argv[1])"
    command = [sys.executable, "-c", build, tmp_path]
    subprocess.run(command, cwd=copied, env=without_npm, stdout=subprocess.DEVNULL, check=True)
    (built,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(built) as archive:
        archive.extractall(tmp_path, filter="data")
    (unpacked,) = (path for path in tmp_path.iterdir() if path.is_dir())
    held = {p.relative_to(unpacked).as_posix() for p in unpacked.rglob("*") if p.is_file()}
    about = {name for name in held if name in {"PKG-INFO", "setup.cfg"} or name.startswith("furrowmap.egg-info/")}
    about |= {f"exporters/share/bundle/{name}" for name in BUNDLE}
    assert held - about == {p.relative_to(CHECKOUT).as_posix() for p in repository_files()}
    target = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-compile"]
    subprocess.run([*install, "--target", target, unpacked], env=without_npm, check=True)
    assert sorted(path.name for path in (target / "furrowmap" / "exporters" / "share" / "bundle").iterdir()) == [
        *BUNDLE
    ]
    look = f"import furrowmap; assert furrowmap.__file__.startswith({str(target)!r})"
    environment = os.environ | {"PYTHONPATH": str(target)}
    for command in (["-c", look], ["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/core/values/test_clock.py"]):
        subprocess.run([sys.executable, *command], cwd=unpacked, env=environment, check=True)


def test_page__has_the_licence_of_each_library_in_it(page_scripts: None) -> None:
    lock = json.loads((CHECKOUT / "web" / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    text = (CHECKOUT / "exporters" / "share" / "bundle" / "licences.txt").read_text(encoding="utf-8")
    for name in ("ol", "quickselect", "rbush", "three"):
        assert f"{name} {lock[f'node_modules/{name}']['version']} (" in text
    assert "esbuild" not in text
    assert text.count("Redistribution and use") + text.count("Permission to use") + text.count("Permission is") >= 4


def test_setup__leaves_out_no_extra_that_tests_load() -> None:
    assert runpy.run_path(str(CHECKOUT / "scripts" / "setup.py"))["LEFT_OUT"] == UNTESTED


def test_locked__waits_for_others(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    with locked(tmp_path / "lock"), (tmp_path / "lock").open() as other, pytest.raises(BlockingIOError):
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with (tmp_path / "lock").open() as other:
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_locked__waits_longer_than_windows_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    windows, calls = ModuleType("msvcrt"), []

    def locking(descriptor: int, mode: str, count: int) -> None:
        calls.append((mode, count))
        if len(calls) < 3:
            raise OSError(36, "Resource deadlock avoided")

    windows.LK_LOCK, windows.locking = "lock", locking  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", windows)
    with locked(tmp_path / "lock"):
        assert calls == [("lock", 1)] * 3


def test_link__without_symbolic_links_is_a_junction_or_a_hard_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "core").mkdir()
    (tmp_path / "file.py").write_text("1")
    symlink, windows = os.symlink, ModuleType("_winapi")
    windows.CreateJunction = lambda target, path: symlink(target, path)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "_winapi", windows)

    def refused(*_: object, **__: object) -> None:
        raise OSError(1314, "A required privilege is not held by the client")

    monkeypatch.setattr(Path, "symlink_to", refused)
    for name in ("core", "file.py"):
        link(tmp_path / f"link of {name}", tmp_path / name)
        assert (tmp_path / f"link of {name}").samefile(tmp_path / name)
    (tmp_path / "file.py").unlink()  # as editors do that write another file in its place
    (tmp_path / "file.py").write_text("2")
    link(tmp_path / "link of file.py", tmp_path / "file.py")
    assert (tmp_path / "link of file.py").read_text() == "2"


def test_layout__is_that_of_an_installation() -> None:
    subprocess.run([sys.executable, CHECKOUT / "scripts" / "layout.py"], check=True)
    laid_out = CHECKOUT / "build" / "typing" / "furrowmap"
    for package in PROJECT["tool"]["setuptools"]["packages"]:
        assert (laid_out.parent / package.replace(".", "/") / "__init__.py").is_file()
    assert {path.name for path in laid_out.iterdir() if not path.exists()} == set()


def test_tools__without_debians_packages_are_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, where there is not even bash."""
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CI", "false")
    with pytest.raises(CannotInstallError, match="no apt-get"):
        apt_install("A program", "package")
    with pytest.raises(pytest.skip.Exception, match=r"no browser to test with: .*no apt-get"):
        installed("browser", "tools_of_tests.py", "chromium")
    with pytest.raises(pytest.skip.Exception, match=r"no QGIS to test with: .*bash"):
        installed("QGIS", "qgis_root.sh")
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception):
        installed("QGIS", "qgis_root.sh")


def test_facts__stand_everywhere_as_in_pyproject() -> None:
    assert list(release_check.facts()) == []
    assert {name for name in project_facts.facts() if (CHECKOUT / name).is_file()} == {*project_facts.facts()}


def test_placeholders__are_listed_for_an_owner(monkeypatch: pytest.MonkeyPatch) -> None:
    def listed() -> str:
        return "\n".join(line for line in release_check.of_an_owner() if "user.signingkey" not in line)

    for name in ("Homepage", "Repository", "Issues"):
        monkeypatch.setitem(release_check.URLS, name, "https://fields.test/")
    monkeypatch.setattr(release_check, "MAIL", "owner@fields.test")
    monkeypatch.setattr(release_check, "ON_INDEX", True)
    assert listed() == ""
    monkeypatch.setitem(release_check.URLS, "Issues", "https://example.org/issues")
    monkeypatch.setattr(release_check, "MAIL", "furrowmap@example.com")
    monkeypatch.setattr(release_check, "ON_INDEX", False)
    found = listed()
    assert "Issues in [project.urls] is a placeholder" in found
    assert all(what in found for what in ("mail address", "no package index has the name"))
    assert "Homepage" not in found


def test_facts__with_another_address_are_outdated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(project_facts.URLS, "Repository", "https://fields.test/furrowmap")
    texts = {path.name: text for path, text in project_facts.outdated().items()}
    assert "repository=https://fields.test/furrowmap\n" in texts["metadata.txt"]
    assert "https://fields.test/furrowmap/blob/HEAD/CHANGELOG.md" in texts["metadata.txt"]
    assert 'repository-code: "https://fields.test/furrowmap"\n' in texts["CITATION.cff"]


def test_recipe__of_conda_needs_what_pyproject_needs() -> None:
    _, run = (CHECKOUT / "recipe" / "recipe.yaml").read_text(encoding="utf-8").split("  run:\n")
    needed = re.findall(r"^    - (\S+) (>=\S+)$", run, re.MULTILINE)
    names = {"lazrs-python": "lazrs", "python-tzdata": "tzdata"}
    stated = [Requirement(text) for text in PROJECT["project"]["dependencies"]]
    assert [(names.get(name, name), bound) for name, bound in needed] == [(e.name, str(e.specifier)) for e in stated]


def test_install__of_an_extra_is_from_the_checkout_until_an_index_has_the_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    written = """Install it: pip install \\".[photo]\\" in the checkout of furrowmap; or not.
pip install ".[trials,photo]"  # in the checkout of furrowmap
furrowmap のチェックアウト内で `pip install '.[csf]'` を実行"""
    published = """Install it: pip install \\"furrowmap[photo]\\"; or not.
pip install "furrowmap[trials,photo]"
`pip install 'furrowmap[csf]'` を実行"""
    assert project_facts.with_install(written) == written
    assert ".[photo]" in project_facts.with_install(published)
    monkeypatch.setattr(project_facts, "ON_INDEX", True)
    assert project_facts.with_install(written) == published


def test_readme__has_links_that_lead_somewhere_from_an_index() -> None:
    assert release_check.relative_links("[a](docs/a.md) ![b](b.png) [c](https://d) [e](#f)") == ["docs/a.md", "b.png"]
