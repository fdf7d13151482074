"""What could run a stranger's code is used nowhere in the product but in the places listed here, with their reasons."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache

import pytest

from tests.syntax import CHECKOUT, files, nodes

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
METHODS = {
    "enable_load_extension", "load_extension", "read_pickle", "to_pickle", "loadLibrary", "runJavaScript", "resolve",
}  # fmt: skip
"""`Path.resolve` raises RuntimeError for a circle of links, `resolved` of core/runtime/file_names.py does not."""
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
    ("cli/farm_commands.py", "form.format"): "forms that the module states",
    ("exporters/farm/postgis.py", "known.format"): "psycopg's SQL, which quotes",
    ("exporters/farm/postgis.py", "query.format"): "psycopg's SQL, which quotes",
    ("exporters/reports/quantity_words.py", "form.format"): "forms that the package's templates state",
    ("exporters/vectors/field_layers.py", "_TOOL_COLUMNS[name].format"): "a list of the module",
    ("plugin/dock/base_map_chooser.py", "text.format"): "a translation of the plugin",
    ("plugin/dock/dock.py", "text.format"): "a translation of the plugin",
    ("plugin/dock/session_page.py", "several.format"): "a translation of the plugin",
    ("plugin/dock/places.py", "words.format"): "a translation of the plugin",
    ("plugin/dock/tasks.py", "text.format"): "a translation of the plugin",
    ("plugin/figures.py", "form.format"): "forms that the module states",
    ("plugin/figures.py", "text.format"): "a translation of the plugin",
    ("plugin/figures.py", "words.format"): "a translation of the plugin",
    ("plugin/legends.py", "words.format"): "a translation of the plugin",
    ("plugin/options_page.py", "text.format"): "a translation of the plugin",
    ("plugin/processing/algorithm.py", "group.format"): "a translation of the plugin",
}
TEMPLATES = {"tr", "self.tr", "QCoreApplication.translate", "SQL"}
"""Functions whose results are texts of the product: translations, and psycopg's SQL, which quotes."""


def product() -> Iterator[tuple[str, Iterable[ast.AST]]]:
    """Each file of the product and its syntax."""
    return ((path.relative_to(CHECKOUT).as_posix(), nodes(path)) for path in files(*FOLDERS))


def is_own_text(node: ast.expr) -> bool:
    """Whether an expression is a text of the product: one of a stranger would read attributes when it is formatted."""
    if isinstance(node, ast.Name):
        return node.id.isupper()
    return isinstance(node, ast.Constant) or (isinstance(node, ast.Call) and ast.unparse(node.func) in TEMPLATES)


def dangers(syntax: Iterable[ast.AST]) -> Iterator[str]:
    """The names of what is dangerous in a file."""
    for node in syntax:
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
    found = {(file, danger) for file, syntax in product() for danger in dangers(syntax)}
    assert found == ALLOWED.keys()


READS = {
    "rasterio.open", "rasterio.io.MemoryFile", "rasterio.MemoryFile", "laspy.open", "laspy.read",
    "laspy.CopcReader.open", "laspy.LasReader", "csv.reader", "csv.DictReader", "open", "io.open", "io.FileIO",
    "os.open", "os.fdopen", "os.read", "mmap.mmap", "numpy.load", "numpy.loadtxt", "numpy.genfromtxt",
    "numpy.fromfile", "numpy.memmap", "numpy.DataSource", "numpy.lib.format.open_memmap", "PIL.Image.open",
    "Image.open", "PIL.TiffImagePlugin.TiffImageFile", "zipfile.ZipFile", "zipfile.Path", "tarfile.open",
    "gzip.open", "gzip.GzipFile", "bz2.open", "bz2.BZ2File", "lzma.open", "lzma.LZMAFile", "zstd.open",
    "zstd.ZstdFile", "sqlite3.connect", "cv2.imread", "cv2.VideoCapture", "cv2.FileStorage", "tomllib.load",
    "json.load", "configparser.ConfigParser", "fileinput.input", "linecache.getlines", "codecs.open",
    "wave.open", "plistlib.load", "shutil.copyfile", "shutil.copy", "shutil.copy2", "shutil.copytree",
    "shutil.copyfileobj", "shutil.unpack_archive", "pandas.read_csv", "pandas.read_excel",
    "pandas.read_parquet", "geopandas.read_file", "fiona.open", "h5py.File", "netCDF4.Dataset",
    "python_calamine.CalamineWorkbook.from_path", "python_calamine.load_workbook", "openpyxl.load_workbook",
    "read_dataframe", "Source", "open_plain", "read_plain_text", "read_plain_bytes", "read_own",
    "read_small",
}  # fmt: skip
"""Open a file to be read, under whatever name they are imported, as do the methods below."""
READING_METHODS = {
    "open", "open_text", "open_binary", "read_text", "read_bytes", "read_info", "read_bounds", "list_layers",
    "read_dataframe", "read_arrow", "from_path", "fromfile", "extractall",
}  # fmt: skip
DOORS = {
    "core/readers/antex.py": "calibrations of antennas",
    "core/readers/csv_file.py": "logs in CSV", "core/readers/csv_text.py": "rows of a CSV",
    "core/readers/text_table.py": "tables: text, spreadsheets, archives of a layer",
    "core/readers/vector_file.py": "polygons and points of vector files",
    "core/readers/ogr_layers.py": "layers by GDAL",
    "core/readers/sqlite_file.py": "GeoPackages, before GDAL opens them",
    "core/readers/agopengps.py": "field folders of AgOpenGPS",
    "core/readers/isoxml/content.py": "task data", "core/readers/surveyed_points.py": "points with heights",
    "core/readers/chosen_survey.py": "whether a file may hold them",
    "core/readers/geotiff.py": "GeoTIFFs", "core/readers/raster_neighbours.py": "files beside a GeoTIFF",
    "core/readers/raster_heights.py": "heights of a GeoTIFF, by a scratch file",
    "core/readers/las/cloud.py": "clouds", "core/readers/las/decoding.py": "LAZ, in a process that may die of it",
    "core/readers/las/e57.py": "clouds in E57", "core/readers/las/file.py": "clouds as recordings",
    "core/readers/las/pcd_ply.py": "clouds in PCD and PLY",
    "core/readers/source.py": "recordings", "core/readers/reader.py": "recordings, by their content",
    "core/readers/ouster/osf.py": "OSF", "core/readers/ouster/metadata.py": "metadata beside captures",
    "core/readers/spinning/scanner_model.py": "angles of lasers beside captures",
    "core/readers/rosbag/bags.py": "bags", "core/readers/rosbag/bag_storage.py": "bags",
    "core/readers/exif.py": "images", "core/readers/image_pixels.py": "images",
    "core/readers/exposure_marks.py": "marks beside images",
    "core/readers/video.py": "videos", "core/session/session_file.py": "sessions",
    "core/session/machine_file.py": "machines",
    "core/simulator/scenario.py": "scenarios", "core/geodesy/projection.py": "parameters of GSI",
    "core/runtime/plain_reads.py": "regular files", "core/runtime/npz.py": "what a machine has learned",
    "app/workflows/live/background_map.py": "maps for the background",
    "app/workflows/session/known_machines.py": "machines",
}  # fmt: skip
"""The ways in for files of users; GDAL, laspy and csv are called here."""
NO_INPUTS = {
    "app/kernel_cache.py": "sources of the package",
    "app/warm_up.py": "a list of the package", "app/workflows/batch/batch.py": "products, copied into a store",
    "app/workflows/calibrate/calibrate.py": "the session, to change it",
    "app/workflows/live/feeds.py": "what a recorder is writing",
    "app/workflows/live/server.py": "a script of the package",
    "app/workflows/record/gnss_source.py": "a serial port", "app/workflows/record/receivers.py": "a receiver",
    "app/workflows/record/record.py": "sockets", "app/workflows/record/recorded_session.py": "its own recording",
    "app/workflows/run/run.py": "products of the run before", "app/workflows/season/season.py": "its own products",
    "app/workflows/season/season_sources.py": "results", "app/workflows/share/qgis_plugin.py": "files of the package",
    "app/workflows/share/share.py": "results", "cli/main.py": "the null device",
    "cli/worker_process.py": "standard input",
    "core/geodesy/crs_choice.py": "tables of the package",
    "core/live/difference.py": "a live session's products",
    "core/runtime/arrays.py": "memory", "core/runtime/memory.py": "the system's figures",
    "core/runtime/file_names.py": "files of a folder, for others here",
    "core/runtime/languages/texts.py": "texts of the package",
    "core/session/examination.py": "a list of the package; readers",
    "exporters/cloud/writer.py": "clouds of its own", "exporters/exchange/textured_mesh.py": "memory",
    "exporters/exchange/vectors.py": "a file that it wrote", "exporters/farm/farm_geopackage.py": "farm maps",
    "exporters/farm/project.py": "a template of the package", "exporters/farm/farm_results.py": "results",
    "exporters/files/atomic.py": "folders, to flush them", "exporters/files/batch_state.py": "the state of a batch",
    "exporters/files/file_records.py": "digests of files", "exporters/files/lease.py": "leases of its own",
    "exporters/files/owner.py": "the system's figures", "exporters/files/plain_files.py": "what it writes",
    "exporters/files/result_folder.py": "results", "exporters/files/staging.py": "its own notes",
    "exporters/rasters/web_images.py": "memory", "exporters/rasters/relief.py": "the cloud of a result",
    "exporters/reports/html_pages.py": "templates of the package",
    "exporters/reports/printed_pages.py": "a page that it printed", "exporters/share/page.py": "files of the package",
    "exporters/share/field_project.py": "layers of a result", "exporters/vectors/geopackage.py": "layers of results",
    "exporters/vectors/labels.py": "a list of the package",
}  # fmt: skip
"""Files that open what no user gives as an input."""


def imported_names(syntax: Iterable[ast.AST]) -> dict[str, str]:
    """The full name of each name that a file imports, such as `numpy` of `np`."""
    found: dict[str, str] = {}
    for node in syntax:
        if isinstance(node, ast.Import):
            found |= {alias.asname: alias.name for alias in node.names if alias.asname}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            own = node.module.startswith("furrowmap")
            found |= {
                alias.asname or alias.name: alias.name if own else f"{node.module}.{alias.name}" for alias in node.names
            }
    return found


OWN_NAMES = {"backports.zstd": "zstd", "compression.zstd": "zstd"}


def reads(syntax: Iterable[ast.AST]) -> Iterator[str]:
    """The calls in a file that open another to read it."""
    whole = list(syntax)
    full = imported_names(whole)
    for node in whole:
        if not isinstance(node, ast.Call):
            continue
        first, dot, rest = ast.unparse(node.func).partition(".")
        name = full.get(first, first)
        called = f"{OWN_NAMES.get(name, name)}{dot}{rest}"
        modes = [argument.value for argument in node.args if isinstance(argument, ast.Constant)]
        if any(isinstance(mode, str) and len(mode) < 4 and set(mode) & set("wxa") for mode in modes):
            continue
        if called in READS:
            yield called
        elif isinstance(node.func, ast.Attribute) and node.func.attr in READING_METHODS:
            yield f".{node.func.attr}"


@cache
def reads_of_product() -> dict[str, set[str]]:
    """The calls of each file of the product that open another to read it."""
    return {file: set(reads(syntax)) for file, syntax in product()}


def test_files_of_users__are_opened_in_the_doors_alone() -> None:
    """One way in for each kind of input: a command that opened files by itself would lack what its siblings can."""
    found = set()
    for file, calls in reads_of_product().items():
        streams = {"Source", "read_small"} if file.startswith("core/readers/") else set()
        if not file.startswith("plugin/") and calls - streams:
            found.add(file)
    assert not DOORS.keys() & NO_INPUTS.keys()
    assert found == DOORS.keys() | NO_INPUTS.keys()


def test_gdal_laspy_and_csv__are_called_in_the_doors_or_on_own_products() -> None:
    libraries = {
        "rasterio.open", "csv.reader", "csv.DictReader", "numpy.loadtxt", "numpy.load", "numpy.fromfile",
        "PIL.Image.open", "Image.open", "tomllib.load", "json.load", "cv2.VideoCapture",
        "cv2.imread", "zipfile.ZipFile", ".read_info", ".list_layers", ".from_path",
    }  # fmt: skip
    found = {file for file, calls in reads_of_product().items() if libraries & calls}
    assert found <= DOORS.keys()
    clouds = {file for file, calls in reads_of_product().items() if any(call.startswith("laspy.") for call in calls)}
    assert clouds == {"exporters/cloud/writer.py", "exporters/rasters/relief.py"}


@pytest.mark.parametrize(
    ("text", "call"),
    [
        ("with path.open('rb') as file: pass", ".open"),
        ("rasterio.open(path)", "rasterio.open"),
        ("path.read_text('utf-8')", ".read_text"),
        ("open(path)", "open"),
        ("Source(path)", "Source"),
        ("pyogrio.read_info(path)", ".read_info"),
        ("import numpy as n; n.fromfile(path)", "numpy.fromfile"),
        ("from numpy import load; load(path)", "numpy.load"),
        ("from zipfile import ZipFile as Z; Z(path)", "zipfile.ZipFile"),
        ("from PIL import Image; Image.open(path)", "PIL.Image.open"),
        ("from rasterio.io import MemoryFile; MemoryFile(data)", "rasterio.io.MemoryFile"),
        ("from backports import zstd; zstd.open(path)", "zstd.open"),
        ("import json; json.load(file)", "json.load"),
        ("import shutil; shutil.copyfile(path, other)", "shutil.copyfile"),
        ("archive.extractall(folder)", ".extractall"),
    ],
)
def test_reads__finds_what_it_is_for(text: str, call: str) -> None:
    assert set(reads(ast.walk(ast.parse(text)))) == {call}


def test_reads__leaves_out_what_is_written() -> None:
    assert not set(reads(ast.walk(ast.parse("path.open('wb'); rasterio.open(path, 'w'); zipfile.ZipFile(path, 'x')"))))


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
        ("session.parent.resolve()", ".resolve"),
    ],
)
def test_rules__find_what_they_are_for(text: str, danger: str) -> None:
    assert danger in set(dangers(ast.walk(ast.parse(text))))


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
