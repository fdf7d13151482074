"""What could run a stranger's code is used nowhere in the product but in the places listed here, with their reasons."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator

import pytest

from tests.conftest import CHECKOUT

FOLDERS = ("app", "cli", "core", "exporters", "plugin")
MODULES = {
    "pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve", "dbm", "jsonpickle", "yaml",
    "ruamel", "lxml", "xml.dom", "xml.sax", "xmlrpc", "ftplib", "telnetlib", "webbrowser", "dotenv", "runpy", "code",
    "imp", "torch",
}  # fmt: skip
"""Imported nowhere: they unpickle, run what files say, expand entities, or connect."""
CALLS = {
    "eval", "exec", "compile", "__import__", "open_code", "input",
    "os.system", "os.popen", "os.execv", "os.execve", "os.execvp", "os.spawnv", "os.startfile", "pty.spawn",
    "subprocess.getoutput", "subprocess.getstatusoutput", "tempfile.mktemp", "np.load", "numpy.load", "np.fromregex",
    "sqlite3.enable_load_extension", "asyncio.create_subprocess_shell", "QgsExpression", "QDesktopServices.openUrl",
    "ET.parse", "ET.fromstring", "ET.XML", "ET.iterparse", "ctypes.CDLL", "import_module", "importlib.import_module",
}  # fmt: skip
METHODS = {"enable_load_extension", "load_extension", "read_pickle", "to_pickle", "loadLibrary", "runJavaScript"}
KEYWORDS = {"shell": True, "allow_pickle": True, "trust_remote_code": True, "weights_only": False}
ALLOWED = {
    ("app/__init__.py", "import_module"): "modules of its own list",
    ("app/process.py", "ctypes.CDLL"): "the C library that the process has loaded",
    ("app/warm_up.py", "eval"): "types that app/kernels.toml lists, a file of the package",
    ("app/warm_up.py", "import_module"): "modules that app/kernels.toml lists",
    ("cli/main.py", "import_module"): "modules of its own list",
    ("core/runtime/arrays.py", "ctypes.CDLL"): "the C library that the process has loaded",
    ("exporters/farm/project.py", "ET.fromstring"): "a style of the package",
    ("exporters/files/qgis_project.py", "ET.fromstring"): "a style of the package",
    ("exporters/share/page.py", "ET.fromstring"): "a style of the package",
    ("exporters/share/symbols.py", "ET.fromstring"): "a style of the package",
    ("exporters/vectors/qgis_styles.py", "ET.fromstring"): "a style of the package",
    ("plugin/dock/dock.py", "QDesktopServices.openUrl"): "a file of this machine that the user asked for, by its path",
    ("cli/farm.py", "form.format"): "forms that the module states",
    ("exporters/farm/postgis.py", "known.format"): "psycopg's SQL, which quotes",
    ("exporters/farm/postgis.py", "query.format"): "psycopg's SQL, which quotes",
    ("exporters/reports/pages.py", "form.format"): "forms that the package's templates state",
    ("exporters/vectors/field_layers.py", "_TOOL_COLUMNS[name].format"): "a list of the module",
    ("plugin/dock/base_map_chooser.py", "text.format"): "a translation of the plugin",
    ("plugin/dock/dock.py", "text.format"): "a translation of the plugin",
    ("plugin/dock/session_page.py", "several.format"): "a translation of the plugin",
    ("plugin/dock/session_page.py", "text.format"): "a translation of the plugin",
    ("plugin/figures.py", "form.format"): "forms that the module states",
    ("plugin/figures.py", "text.format"): "a translation of the plugin",
    ("plugin/figures.py", "words.format"): "a translation of the plugin",
    ("plugin/legends.py", "words.format"): "a translation of the plugin",
    ("plugin/options_page.py", "text.format"): "a translation of the plugin",
}
TEMPLATES = {"tr", "self.tr", "QCoreApplication.translate", "SQL"}
"""Functions whose results are texts of the product: translations, and psycopg's SQL, which quotes."""


def product() -> Iterator[tuple[str, ast.Module]]:
    """Each file of the product and its syntax."""
    for folder in FOLDERS:
        for path in sorted((CHECKOUT / folder).rglob("*.py")):
            yield path.relative_to(CHECKOUT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))


def is_own_text(node: ast.expr) -> bool:
    """Whether an expression is a text of the product: one of a stranger would read attributes when it is formatted."""
    if isinstance(node, ast.Name):
        return node.id.isupper()
    return isinstance(node, ast.Constant) or (isinstance(node, ast.Call) and ast.unparse(node.func) in TEMPLATES)


def dangers(tree: ast.AST) -> Iterator[str]:
    """The names of what is dangerous in a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [f"{node.module}", *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            names = []
        for name in names:
            yield from (f"import {one}" for one in MODULES if name == one or name.startswith(f"{one}."))
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called in CALLS:
                yield called
            if isinstance(node.func, ast.Attribute):
                if node.func.attr in METHODS:
                    yield f".{node.func.attr}"
                if node.func.attr in ("format", "format_map") and not is_own_text(node.func.value):
                    yield f"{ast.unparse(node.func.value)}.{node.func.attr}"
            for keyword in node.keywords:
                if keyword.arg in KEYWORDS and not (
                    isinstance(keyword.value, ast.Constant) and keyword.value.value is not KEYWORDS[keyword.arg]
                ):
                    yield f"{keyword.arg}={ast.unparse(keyword.value)}"


def test_promise_23__what_could_run_foreign_code_is_only_where_it_is_listed() -> None:
    found = {(file, danger) for file, tree in product() for danger in dangers(tree)}
    assert found == ALLOWED.keys()


@pytest.mark.parametrize(
    ("text", "danger"),
    [
        ("import pickle as p", "import pickle"),
        ("from xml.dom import minidom", "import xml.dom"),
        ("np.load(path, allow_pickle=True)", "allow_pickle=True"),
        ("subprocess.run(words, shell=is_windows)", "shell=is_windows"),
        ("exec(text)", "exec"),
        ("os.system(f'ls {name}')", "os.system"),
        ("database.enable_load_extension(True)", ".enable_load_extension"),
        ("session.name.format(value)", "session.name.format"),
    ],
)
def test_rules__find_what_they_are_for(text: str, danger: str) -> None:
    assert danger in set(dangers(ast.parse(text)))


def test_ruff__looks_for_more_of_it_in_all_of_the_product() -> None:
    """Its rules S (bandit's) are on, and in no folder of the product off."""
    rules = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ruff"]["lint"]
    assert "S" in rules["select"]
    assert [code for code in rules["ignore"] if code.startswith("S") and code[1:].isdigit()] == ["S101"]
    of_product = {place: codes for place, codes in rules["per-file-ignores"].items() if place.startswith(FOLDERS)}
    left_out = {place: [code for code in codes if code.startswith("S")] for place, codes in of_product.items()}
    assert {place: codes for place, codes in left_out.items() if codes} == {
        "core/simulator/**": ["S311"],  # random numbers that are no secrets
    }
