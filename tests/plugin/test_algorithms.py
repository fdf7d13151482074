"""The plugin's algorithms in a real QGIS, with a real worker: one start of QGIS does all the jobs of this module."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import sys
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import geopandas as gpd
import laspy
import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import Proj

from furrowmap.cli.main import command_line
from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.workflows.share.qgis_plugin import write_plugin_zip
from tests.conftest import installed

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CHECKOUT / "scripts"))
from plugin_commands import commands, options_of  # noqa: E402
from plugin_strings import TRANSLATIONS, source_strings, translations  # noqa: E402

SCANS_S = 1_453_364_282.341  # the capture's first return by its GPS time
STRINGS = source_strings()


@pytest.fixture(scope="module")
def worker() -> str:
    """The command furrowmap as it is named inside QGIS's root."""
    return installed("worker", "qgis_worker.sh")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, shared_data: Path) -> Path:
    """A capture on a straight drive by a trajectory from a file, a cloud's worth of other input, and the plugin."""
    folder = tmp_path_factory.mktemp("north field 圃場")
    shutil.copyfile(shared_data / "velodyne" / "vlp16_single_gps.pcap", folder / "recording.pcap")
    shutil.copyfile(shared_data / "isoxml" / "other" / "single_dpd.zip", folder / "tasks.zip")
    for name in ("truth/parcels_truth.csv", "treatments.csv"):
        shutil.copy(shared_data / "uav_wheat" / name, folder)
    plots = [shapely.box(16_649.5, 96_558.7 + 1.6 * k, 16_652.0, 96_560.2 + 1.6 * k) for k in range(2)]
    gpd.GeoDataFrame({"id": [1, 2]}, geometry=plots, crs="EPSG:6677").to_file(folder / "parcels.gpkg")
    plots.append(
        shapely.box(16_649.5, 96_561.9, 16_652.0, 96_563.4)
    )  # one more, which a filter of the layer leaves out
    for name in ("plots", "others"):
        table = gpd.GeoDataFrame({"id": [1, 2, 3]}, geometry=plots, crs="EPSG:6677")
        table.to_file(folder / "field.gpkg", layer=name)
    for name in ("gnss.nmea", "reference.nmea"):
        shutil.copyfile(shared_data / "tractor_loop" / name, folder / name)
    rows = "".join(f"{SCANS_S - 1 + i * 0.1:.3f},{16_650 + i * 0.1:.3f},96560,271,0,0,90\n" for i in range(31))
    (folder / "drive.csv").write_text("time_unix_s,e_m,n_m,h_m,roll_deg,pitch_deg,heading_deg\n" + rows)
    (folder / "session.toml").write_text(
        'furrowmap = 1\nname = "straight"\n[recording]\nlidar = ["recording.pcap"]\n[crs]\nmap = "EPSG:6677"\n'
        '[trajectory]\nfiles = ["drive.csv"]\n'
    )
    (folder / "no_session.toml").write_text("furrowmap = 1\n[recoding]\n")
    (folder / "nothing.pcap").write_bytes(b"nothing")
    (folder / "some.gpkg").touch()
    write_plugin_zip(folder / "plugin.zip")
    with zipfile.ZipFile(folder / "plugin.zip") as archive:
        archive.extractall(folder / "plugins")
    return folder


def script(path: Path, *lines: str) -> str:
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]))
    path.chmod(0o755)
    return str(path)


def write_wheel(folder: Path, name: str, version: str, files: dict[str, str], requires: str = "") -> str:
    """Write a wheel with these files; returns its SHA-256."""
    info = f"{name}-{version}.dist-info"
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n" + requires
    path = folder / f"{name}-{version}-py3-none-any.whl"
    folder.mkdir(exist_ok=True)
    with zipfile.ZipFile(path, "w") as wheel:
        for file, content in files.items():
            wheel.writestr(file, content)
        wheel.writestr(f"{info}/METADATA", metadata)
        wheel.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{info}/RECORD", "")
    return hashlib.sha256(path.read_bytes()).hexdigest()


def stand_in_wheels(folder: Path, version: str) -> str:
    """A small furrowmap, which answers with its version and a hello, and its one dependency: its line in the lock."""
    code = (
        "import json, sys\n"
        "if 'worker' in sys.argv:\n"
        f"    print(json.dumps({{'type': 'hello', 'protocol': 1, 'version': {version!r}, 'pid': 1}}), flush=True)\n"
        "    sys.stdin.read()\n"
        f"else:\n    print(json.dumps({{'furrowmap': {version!r}}}))\n"
    )
    files = {"furrowmap/__init__.py": "", "furrowmap/__main__.py": code}
    write_wheel(folder, "furrowmap", version, files, "Requires-Dist: needed>=1\n")
    digest = write_wheel(folder, "needed", "1.0", {"needed.py": ""})
    return f"needed==1.0 --hash=sha256:{digest}\n"


def own_version() -> str:
    lines = (CHECKOUT / "metadata.txt").read_text(encoding="utf-8").splitlines()
    return next(line.removeprefix("version=") for line in lines if line.startswith("version="))


def run(algorithm: str, **parameters: Any) -> dict[str, Any]:
    """The job to run an algorithm."""
    given = {name: str(value) if isinstance(value, Path) else value for name, value in parameters.items()}
    return {"do": "run", "algorithm": algorithm, "parameters": given}


def check(algorithm: str, **parameters: Any) -> dict[str, Any]:
    """The job to check the parameters of an algorithm."""
    return {**run(algorithm, **parameters), "do": "check"}


def jobs_in(folder: Path, worker: str) -> dict[str, dict[str, Any]]:
    """The jobs by name, in their order."""
    return {
        "describe": {"do": "describe"},
        "nobody": {"do": "find"},
        "run without a worker": run("run", SESSION=folder / "session.toml", OUTPUT=folder / "never"),
        "choose": {"do": "settings", "interpreter": worker},
        **algorithm_jobs(folder),
        **worker_jobs(folder),
        "enums": {"do": "enums", "folder": str(folder / "plugins")},
        **{language: {"do": "translate", "locale": language, "strings": STRINGS} for language in TRANSLATIONS},
        "english": {"do": "translate", "locale": "en_US", "strings": STRINGS},
    }


def algorithm_jobs(folder: Path) -> dict[str, dict[str, Any]]:
    """Every algorithm once; one of them with environment variables as QGIS's launchers set them."""
    poison = folder / "poison"
    poison.mkdir()
    (poison / "numpy.py").write_text("raise SystemExit('numpy of somebody else')\n")
    poisons = {"PYTHONHOME": "/nowhere", "PYTHONPATH": str(poison), "PYTHONSTARTUP": str(poison / "numpy.py")}
    poisons |= dict.fromkeys(("GDAL_DATA", "PROJ_LIB", "PROJ_DATA", "GDAL_DRIVER_PATH"), "/nowhere")
    report, base = folder / "result" / "report.json", folder / "farm.gpkg"
    cloud = folder / "result" / "cloud.copc.laz"
    return {
        "check: no file": check("surface", CLOUDS=[str(folder / "no.laz")], OUTPUT=str(folder / "o")),
        "check: classes": check("surface", CLOUDS=[str(folder / "recording.pcap")], CLASSES="soil", OUTPUT="o"),
        "check: two farm maps": check(
            "farm_list", FARM_MAP=str(folder / "some.gpkg"), DATABASE="postgresql://me@here/farm"
        ),
        "check: well": check("run", SESSION=str(folder / "session.toml"), OUTPUT=str(folder / "result")),
        "inspect": run("inspect", FILES=[str(folder / "recording.pcap"), str(folder / "nothing.pcap")]),
        "init": run("init", RECORDINGS=[str(folder / "recording.pcap")], OUTPUT=folder / "begun.toml"),
        "run": run("run", SESSION=folder / "session.toml", OUTPUT=folder / "result", OPEN=True),
        "preview": run("run", SESSION=folder / "session.toml", OUTPUT=folder / "look", PREVIEW=True, OPEN=True),
        "surface": run(
            "surface", CLOUDS=[str(cloud)], CELL=0.5, OUTPUT=folder / "surfaces", GROUND="none", DST_CRS="EPSG:6677"
        ),
        "cloud": run("cloud", CLOUDS=[str(cloud)], OUTPUT=folder / "clean.copc.laz", VOXEL=0.5, CLASSES="64,65"),
        "poison": {"do": "settings", "environment": poisons},
        "export": run("export", RESULTS=[str(report)], FORMAT="geojson", LAYERS=["trajectory"], TARGET=folder / "web"),
        "share": run("share", RESULT=report, QFIELD=True, OUTPUT=folder / "phone"),
        "cure": {"do": "settings", "forget": list(poisons)},
        "farm_add": run("farm_add", RESULTS=[str(report)], FARM_MAP=base),
        "farm_list": run("farm_list", FARM_MAP=base),
        "farm_fields": run("farm_fields", FARM_MAP=base),
        "farm_history": run("farm_history", FARM_MAP=base, FIELD="north", OUTPUT=folder / "history.html"),
        "farm_traffic": run("farm_traffic", FARM_MAP=base, OUTPUT=folder / "traffic.tif"),
        "farm_mosaic": run("farm_mosaic", FARM_MAP=base, OUTPUT="TEMPORARY_OUTPUT"),
        "farm_remove": run("farm_remove", FARM_MAP=base, SESSION="straight"),
        "season": run("season", RESULTS=[str(report)], OUTPUT=folder / "season"),
        "fields": run("fields", TASKDATA=folder / "tasks.zip", OUTPUT=folder / "fields.gpkg"),
        "plots": run(
            "plots",
            CORNER="139.9,36.5 [EPSG:4326]",
            AZIMUTH=90,
            ROWS=2,
            COLUMNS=3,
            LENGTH=10,
            WIDTH=2,
            CRS="EPSG:6677",
            OUTPUT=folder / "plots.gpkg",
        ),
        "parcels": {
            **run("parcels", CLOUDS=["the cloud"], PARCELS="plots", NET_INSET="0.3,0.1", OUTPUT=folder / "crops"),
            "layers": {
                "the cloud": ["copc", str(cloud)],
                "plots": ["ogr", f"{folder / 'field.gpkg'}|layername=plots|subset=id < 3"],
            },
        },
        "features": run("features", CLOUDS=[str(cloud)], OUTPUT=folder / "features"),
        "canopy": run("canopy", CLOUDS=[str(cloud)], CELL=1, GROUND="class", OUTPUT="TEMPORARY_OUTPUT"),
        "growth": run(
            "growth",
            CLOUDS=[str(cloud), str(folder / "by_hand" / "cloud.copc.laz")],
            PARCELS=folder / "parcels.gpkg",
            DAYS="2016-01-21\n2016-01-31",
            NET_INSET="0.3,0.1",
            OUTPUT=folder / "growth",
        ),
        "response": run(
            "response",
            TABLES=[str(folder / "parcels_truth.csv")],
            TREATMENTS=folder / "treatments.csv",
            MEASURE="mean_height_crop_m",
            OUTPUT=folder / "trial",
        ),
        "crs": run("crs", SESSION=folder / "session.toml"),
        "frames": run("frames", SESSION=folder / "session.toml", DRAWING=folder / "frames.svg"),
        "gnss_solve": run(
            "gnss_solve",
            ROVER=folder / "no_rover.obs",
            BASE=folder / "no_base.obs",
            NAVIGATION=[str(folder / "no_base.nav")],
            OUTPUT=folder / "rover.pos",
        ),
        "gnss_evaluate": run(
            "gnss_evaluate",
            TEST=[str(folder / "gnss.nmea"), str(folder / "reference.nmea")],
            REFERENCE=folder / "reference.nmea",
            NAMES="CLAS\nRTK",
            OUTPUT=folder / "evaluation",
        ),
        "check": run(
            "check", PRODUCT=cloud, POINTS=folder / "points.csv", VERTICAL=1.0, TABLE=folder / "errors.csv", SIGMA=0.01
        ),
        "calibrate": run("calibrate", SESSION=folder / "no_session.toml"),
        "machine_save": run("machine_save", SESSION=folder / "session.toml", NAME=str(folder / "tractor.toml")),
        "machine_list": run("machine_list"),
        "tie": run("tie", RESULTS=[str(report)], OUTPUT=folder / "tied"),
        "calibrate_mount": run(
            "calibrate_mount",
            FRAMES=folder / "drive.csv",
            BOARD="9x6",
            SQUARE=0.03,
            BOARD_RPY="180,0,90",
            OUTPUT=folder / "mount.csv",
        ),
        "colour": run("colour", CLOUD=cloud, SESSION=folder / "session.toml", OUTPUT=folder / "coloured.copc.laz"),
        "cancel": {**run("simulate", OUTPUT=folder / "cancelled"), "cancel_after_s": 0.3},
    }


def worker_jobs(folder: Path) -> dict[str, dict[str, Any]]:
    """The options page, and workers that fail."""
    hello = '{"type": "hello", "protocol": %d, "version": "9.9", "pid": 1}'
    crashing = script(
        folder / "crashing", f"echo '{hello % 1}'", "read order", "echo 'last words' >&2", "kill -SEGV $$"
    )
    versions = """case "$1" in --version) echo '{"furrowmap": "9.9"}'; exit;; esac"""
    foreign = script(folder / "foreign", versions, f"echo '{hello % 99}'", "cat >/dev/null")
    broken = script(folder / "broken", "echo 'ImportError: no numpy' >&2", "exit 1")
    locked = stand_in_wheels(folder / "wheels", own_version())
    (folder / "plugins" / "furrowmap" / "locked_packages.txt").write_text(locked)
    stand_in_wheels(folder / "tampered", own_version())
    write_wheel(folder / "tampered", "needed", "1.0", {"needed.py": "raise SystemExit"})
    stand_in_wheels(folder / "incomplete", own_version())
    (folder / "incomplete" / "needed-1.0-py3-none-any.whl").unlink()
    (folder / "no wheels").mkdir()
    return {
        "options": {
            "do": "options",
            "press": [
                {"button": "furrowmapCheck"},
                {"chosen": str(folder / "nothing.pcap"), "button": "furrowmapCheck"},
                {"chosen": foreign, "button": "furrowmapCheck"},
                {"chosen": "", "wheels": str(folder / "no wheels"), "button": "create"},
                {"wheels": str(folder / "incomplete"), "button": "create"},
                {"wheels": str(folder / "tampered"), "button": "create"},
                {"package": str(folder / "no wheels"), "button": "create"},
            ],
        },
        "nothing created": {"do": "find"},
        "create": {"do": "options", "press": [{"wheels": str(folder / "wheels"), "button": "create"}]},
        "created": {"do": "find"},
        "remove": {"do": "options", "press": [{"button": "remove"}]},
        "removed": {"do": "find"},
        "choose crashing": {"do": "settings", "interpreter": crashing},
        "crashing": run("inspect", FILES=[str(folder / "recording.pcap")]),
        "choose foreign": {"do": "settings", "interpreter": foreign},
        "foreign": run("inspect", FILES=[str(folder / "recording.pcap")]),
        "choose broken": {"do": "settings", "interpreter": broken},
        "broken": run("inspect", FILES=[str(folder / "recording.pcap")]),
    }


@pytest.fixture(scope="module")
def answers(qgis: QgisRoot, worker: str, folder: Path, by_hand: Path) -> dict[str, Any]:
    """QGIS's answer to each job."""
    returns = laspy.read(by_hand / "cloud.copc.laz").xyz[::1000]
    rows = "".join(f"P{number},{e:.3f},{n:.3f},{h:.3f}\n" for number, (e, n, h) in enumerate(returns))
    (folder / "points.csv").write_text("name,e_m,n_m,h_m\n" + rows)
    jobs = jobs_in(folder, worker)
    (folder / "jobs.json").write_text(json.dumps(list(jobs.values())), encoding="utf-8")
    kept = "XDG_CACHE_HOME=/opt/furrowmap/cache"  # of the root, so that kernels are compiled once
    script = CHECKOUT / "tests" / "plugin" / "in_qgis.py"
    out = qgis.run("env", kept, "python3", script, folder / "plugins", folder / "jobs.json", timeout_s=1200)
    answers = dict(zip(jobs, json.loads(out.splitlines()[-1]), strict=True))
    print("seconds on the clock and of the processor:")  # for people (pytest -s)
    print("\n".join(f"{each['spent_s'][0]:6.2f} {each['spent_s'][1]:6.2f} {name}" for name, each in answers.items()))
    answers["logged"] = {"answer": {name: each["logged"] for name, each in answers.items() if each["logged"]}}
    return {name: answer["answer"] for name, answer in answers.items()}


@pytest.fixture(scope="module")
def by_hand(folder: Path) -> Path:
    """What the command line makes of the same session."""
    assert command_line(["run", str(folder / "session.toml"), "-o", str(folder / "by_hand"), "--quiet"]) == 0
    return folder / "by_hand"


def test_log__has_nothing_but_the_errors_that_were_provoked(answers: dict[str, Any]) -> None:
    refused = {"calibrate", "calibrate_mount", "colour", "farm_history", "machine_save"}
    assert set(answers["logged"]) == refused | {"gnss_solve", "growth", "tie", "crashing", "foreign", "broken"}
    assert [text for texts in answers["logged"].values() for text in texts if not text.startswith("furrowmap: ")] == []


def test_algorithms__are_there_for_every_command(answers: dict[str, Any]) -> None:
    found = {a["command"]: name for name, a in answers["describe"].items()}
    assert set(found) == {words for words, _ in commands()}
    assert all(name == words.replace(" ", "_") for words, name in found.items())


def test_algorithms__have_every_option_and_choice_of_their_command(answers: dict[str, Any]) -> None:
    algorithms = {a["command"]: a for a in answers["describe"].values()}
    for words, command in commands():
        algorithm, options = algorithms[words], options_of(command)
        assert set(algorithm["options"].values()) == set(options), words
        for name, option in algorithm["options"].items():
            if "choices" in options[option]:
                assert algorithm["choices"][name] == options[option]["choices"]


def test_algorithms__explain_themselves_without_a_network(answers: dict[str, Any]) -> None:
    for name, a in answers["describe"].items():
        silent = [parameter for parameter, (_, title, words) in a["parameters"].items() if not (title and words)]
        assert silent == [], name
        assert a["title"]
        assert a["group"][1]
        assert len(a["help"]) > 100
        assert "http" not in a["help"]
        (picture,) = re.findall(r'<img src="file://([^"]+)"', a["help"])
        assert picture.endswith(f"/{a['group'][0]}.svg")
        assert (CHECKOUT / "plugin" / "processing" / "pictures" / Path(picture).name).is_file()
        assert re.search(rf"<code>furrowmap {a['command']}[ <]", a["help"])
        for _, title, _ in a["parameters"].values():
            assert title.replace("&", "&amp;") in a["help"], (name, title)


def test_check__finds_what_is_wrong_before_anything_starts(answers: dict[str, Any], folder: Path) -> None:
    assert answers["check: no file"] == [False, f"Point clouds: {folder / 'no.laz'} does not exist."]
    assert answers["check: classes"][0] is False
    assert "soil" in answers["check: classes"][1]
    assert answers["check: two farm maps"] == [False, "Give either 'Farm map (GeoPackage)' or 'Farm map (PostGIS)'."]
    assert answers["check: well"] == [True, ""]


def test_run__without_a_worker_says_where_to_get_one(answers: dict[str, Any], folder: Path) -> None:
    assert answers["nobody"]["program"] is None
    assert "Settings › Options › furrowmap" in answers["run without a worker"]["cannot"]
    assert not (folder / "never").exists()


def test_run__gives_what_the_command_line_gives(answers: dict[str, Any], folder: Path, by_hand: Path) -> None:
    assert answers["run"]["error"] is None
    same_products(folder / "result", by_hand)
    report = json.loads((folder / "result" / "report.json").read_text(encoding="utf-8"))
    assert answers["run"]["outputs"]["POINTS"] == report["figures"]["points"]
    assert answers["run"]["outputs"]["FOLDER"] == str(folder / "result")
    assert {"trajectory", "cloud"} <= set(answers["run"]["layers"])


def test_run__as_a_preview_opens_the_trajectory(answers: dict[str, Any], folder: Path) -> None:
    """Where the session does not say how the scanner is mounted, there is no surface."""
    assert answers["preview"]["error"] is None
    assert answers["preview"]["layers"] == ["preview_track"]
    assert answers["preview"]["outputs"]["REPORT"] == ""
    assert not (folder / "look" / "report.json").exists()


def same_products(folder: Path, other: Path) -> None:
    clouds = [laspy.read(path / "cloud.copc.laz") for path in (folder, other)]
    assert len(clouds[0].points) > 10_000
    assert np.array_equal(clouds[0].points.array, clouds[1].points.array)
    layers = [pyogrio.list_layers(path / "field.gpkg").tolist() for path in (folder, other)]
    assert layers[0] == layers[1]
    for name in (name for name, geometry in layers[0] if geometry):
        tables = [pyogrio.read_dataframe(path / "field.gpkg", layer=name) for path in (folder, other)]
        assert tables[0].equals(tables[1]), name


def test_worker__works_where_qgis_has_variables_of_its_own(answers: dict[str, Any], folder: Path) -> None:
    """PYTHONHOME, PYTHONPATH, GDAL_DATA and PROJ_LIB, as QGIS's launchers set them, break other Pythons and GDALs."""
    assert answers["export"]["error"] is None
    assert pyogrio.read_info(folder / "web" / "trajectory.geojson")["features"] == 5


def test_share__writes_a_project(answers: dict[str, Any], folder: Path) -> None:
    assert answers["share"]["error"] is None
    assert Path(answers["share"]["outputs"]["START"]) == folder / "phone" / "field.qgs"
    assert "<id>furrowmap_trajectory</id>" in (folder / "phone" / "field.qgs").read_text(encoding="utf-8")


def test_inspect__has_the_findings_of_the_others_where_one_file_is_refused(answers: dict[str, Any]) -> None:
    good, bad = json.loads(answers["inspect"]["outputs"]["FINDINGS"])["files"]
    assert good["facts"]["model"] == "VLP-16"
    assert bad["error"]["what"]


def test_init__says_what_is_missing(answers: dict[str, Any], folder: Path) -> None:
    outputs = answers["init"]["outputs"]
    assert outputs["SESSION"] == str(folder / "begun.toml")
    assert outputs["MISSING"]
    assert (folder / "begun.toml").read_text(encoding="utf-8").count("furrowmap = 1") == 1


def test_cloud__is_opened_by_its_classes(answers: dict[str, Any], folder: Path) -> None:
    assert answers["cloud"]["error"] is None
    clean, whole = (laspy.read(folder / name) for name in ("clean.copc.laz", Path("result", "cloud.copc.laz")))
    assert answers["cloud"]["outputs"]["POINTS"] == len(clean.points)
    assert 0 < len(clean.points) == len(np.unique(np.floor(clean.xyz / 0.5), axis=0)) < len(whole.points)
    assert answers["cloud"]["loaded"]["clean"] == ["Clean point cloud", True, "classified"]


def test_features__are_classes_and_layers(answers: dict[str, Any], folder: Path) -> None:
    assert answers["features"]["error"] is None
    classified = laspy.read(folder / "features" / "cloud.copc.laz")
    assert (np.asarray(classified.classification) == 2).mean() > 0.5, "a field is ground"
    assert answers["features"]["outputs"]["FEATURES"] == str(folder / "features" / "features.gpkg")


def test_images__need_an_extra_that_the_worker_does_not_have_and_a_camera(answers: dict[str, Any]) -> None:
    what, _, remedy = answers["calibrate_mount"]["error"].splitlines()
    assert what == "The package OpenCV is not installed."
    assert remedy.startswith("Install the extra")  # in the words of the dock, which has a button for it
    assert "pip" not in remedy
    assert answers["colour"]["error"].splitlines()[0].endswith("has no table [camera].")


def test_machine__of_a_session_without_places_is_refused(answers: dict[str, Any]) -> None:
    assert answers["machine_save"]["error"].splitlines()[0].endswith("states no place of a sensor or tool.")
    assert answers["machine_list"]["error"] is None
    assert isinstance(json.loads(answers["machine_list"]["outputs"]["MACHINES"]), list)


def test_tie__of_one_result_says_what_it_needs(answers: dict[str, Any]) -> None:
    assert answers["tie"]["error"].splitlines()[0] == "1 result to tie."


def test_plots__are_laid_out_from_a_place_on_the_map(answers: dict[str, Any], folder: Path) -> None:
    assert answers["plots"]["error"] is None
    assert answers["plots"]["outputs"]["PLOTS"] == 6
    west, south, east, north = gpd.read_file(folder / "plots.gpkg").total_bounds
    scale = Proj("EPSG:6677").get_factors(139.9, 36.5).meridional_scale
    # Metres on the ground; alleys of 1 m and paths of 0.5 m, with which the dialog opens.
    assert (east - west, north - south) == pytest.approx((32.0 * scale, 4.5 * scale), rel=1e-6)


def test_parcels__are_measured_and_a_trial_is_analysed(answers: dict[str, Any], folder: Path) -> None:
    """Cloud and parcels are layers of the project: the parcels one of two in a file, with a filter."""
    assert answers["parcels"]["error"] is None
    assert answers["parcels"]["outputs"]["PARCELS_MEASURED"] == 2
    assert (folder / "crops" / "parcels.csv").exists()
    assert answers["canopy"]["error"] is None
    assert answers["canopy"]["outputs"]["AREAS"] > 4
    assert "of bare soil near the parcels" in answers["growth"]["error"], "tilled soil has none"
    assert answers["response"]["error"] is None
    assert answers["response"]["outputs"]["CHART"] == str(folder / "trial" / "response.svg")


def test_surface__is_opened_in_its_style(answers: dict[str, Any], folder: Path) -> None:
    assert answers["surface"]["error"] is None
    assert answers["surface"]["outputs"]["DSM"] == str(folder / "surfaces" / "dsm.tif")
    assert answers["surface"]["loaded"]["dsm"] == ["Surfaces of cloud", True, "hillshade"]
    parameters = json.loads((folder / "surfaces" / "surfaces.json").read_text(encoding="utf-8"))["parameters"]
    assert parameters["ground"] == "none"


def test_fields__gives_layers(answers: dict[str, Any]) -> None:
    assert answers["fields"]["error"] is None
    assert answers["fields"]["outputs"]["WORKED_AREA_M2"] == pytest.approx(275.2, abs=1.0), "section by section"
    assert answers["fields"]["loaded"]
    assert all(valid for _, valid, _ in answers["fields"]["loaded"].values())


def answer_of(capsys: pytest.CaptureFixture[str], *words: str | Path) -> dict[str, Any]:
    """What the command line answers."""
    capsys.readouterr()
    assert command_line([*map(str, words), "--json", "--quiet"]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    return answer


def test_crs__gives_what_the_command_line_gives(
    answers: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answers["crs"]["error"] is None
    assert json.loads(answers["crs"]["outputs"]["FINDINGS"]) == answer_of(capsys, "crs", folder / "session.toml")


def test_gnss_evaluate__gives_what_the_command_line_gives(
    answers: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answers["gnss_evaluate"]["error"] is None
    logs = (folder / "gnss.nmea", folder / "reference.nmea")
    names = ("--name", "CLAS", "--name", "RTK")
    by_hand = answer_of(capsys, "gnss", "evaluate", *logs, "--reference", logs[1], *names)
    findings = json.loads(answers["gnss_evaluate"]["outputs"]["FINDINGS"])
    assert {key: findings[key] for key in by_hand if key not in ("output", "products")} == {
        key: value for key, value in by_hand.items() if key not in ("output", "products")
    }
    assert "<html" in Path(answers["gnss_evaluate"]["outputs"]["PAGE"]).read_text(encoding="utf-8")


def test_check__gives_what_the_command_line_gives(
    answers: dict[str, Any], folder: Path, by_hand: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answers["check"]["error"] is None
    points = ("check", by_hand / "cloud.copc.laz", folder / "points.csv", "--points-sigma=0.01")
    answer = answer_of(capsys, *points, "--require-vertical=1.0")
    assert json.loads(answers["check"]["outputs"]["FINDINGS"])["accuracy"] == answer["accuracy"]
    assert answers["check"]["outputs"]["RMSE_VERTICAL_M"] == answer["accuracy"]["rmse_vertical_m"]
    assert answers["check"]["outputs"]["MET"] is answer["verdicts"]["vertical"]["met"]
    assert (folder / "errors.csv").read_text(encoding="utf-8").count("\n") > 10


def test_frames__are_those_of_the_command_line(
    answers: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answers["frames"]["error"] is None
    by_command = answer_of(capsys, "frames", folder / "session.toml")
    found = json.loads(answers["frames"]["outputs"]["FINDINGS"])
    assert {**found, "svg": None} == by_command
    assert (folder / "frames.svg").read_text(encoding="utf-8").startswith("<")
    assert any(word in answers["gnss_solve"]["error"] for word in ("rnx2rtkp", "no_rover.obs"))


def test_algorithms__have_all_been_asked_to_work(answers: dict[str, Any]) -> None:
    asked = {name for name in answers["describe"] if name in answers or name == "simulate"}
    assert asked == set(answers["describe"])


def test_base__takes_lists_and_gives_back_sessions(answers: dict[str, Any], folder: Path) -> None:
    assert answers["farm_mosaic"]["outputs"]["SURFACES"] == 1
    assert [answers[name]["error"] for name in ("farm_add", "farm_list", "farm_mosaic", "farm_remove")] == [None] * 4
    assert answers["farm_add"]["outputs"]["ADDED"] == 1
    assert answers["farm_add"]["loaded"]
    assert [s["name"] for s in json.loads(answers["farm_list"]["outputs"]["SESSIONS"])] == ["straight"]
    assert (answers["farm_remove"]["outputs"]["REMOVED"], answers["farm_remove"]["outputs"]["SESSIONS"]) == (1, 0)


def test_base__of_a_session_without_a_field_has_none_and_no_passes(answers: dict[str, Any]) -> None:
    assert answers["farm_fields"]["error"] is None
    assert json.loads(answers["farm_fields"]["outputs"]["FIELDS"]) == []
    assert "has no field 'north'" in answers["farm_history"]["error"]
    assert answers["farm_traffic"]["error"] is None
    assert answers["farm_traffic"]["outputs"]["PASSES"] == 0


def test_season__opens_the_mosaics_of_each_date(answers: dict[str, Any], folder: Path) -> None:
    assert answers["season"]["error"] is None
    assert {path.name for path in (folder / "season" / "mosaics").glob("*/*.vrt")} == {"dsm.vrt"}
    assert "dsm" in str(answers["season"]["loaded"])
    assert not (folder / "season" / "points").exists()


def test_output__that_is_temporary_is_where_the_answer_says(answers: dict[str, Any]) -> None:
    assert answers["farm_mosaic"]["written"] == ["OUTPUT"]
    assert {"FOLDER", "OUTPUT"} <= set(answers["canopy"]["written"])
    assert answers["canopy"]["outputs"]["OUTPUT"] == answers["canopy"]["outputs"]["FOLDER"]


def test_errors__are_the_three_lines_of_the_command_line(
    answers: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line(["calibrate", str(folder / "no_session.toml")]) == 3
    assert answers["calibrate"]["error"].splitlines() == capsys.readouterr().err.splitlines()
    assert len(answers["calibrate"]["error"].splitlines()) == 3


def test_cancel__ends_the_work_and_leaves_nothing(answers: dict[str, Any], folder: Path) -> None:
    assert answers["cancel"]["error"] is None
    assert answers["cancel"]["outputs"] == {}
    assert "Cancelled" in answers["cancel"]["messages"][-1]
    assert not list(folder.glob("cancelled/*"))


def test_promise_16__a_worker_that_crashes_leaves_qgis_alive_and_is_reported_with_its_last_words(
    answers: dict[str, Any],
) -> None:
    lines = answers["crashing"]["error"].splitlines()
    assert len(lines) == 3
    assert lines[1] == "last words"


def test_worker__of_another_protocol_is_reported_with_both_versions(answers: dict[str, Any]) -> None:
    assert answers["foreign"]["error"].startswith("furrowmap 9.9 has protocol version 99; this plugin needs version 1.")


def test_worker__that_ends_before_its_hello_is_reported_with_its_last_words(answers: dict[str, Any]) -> None:
    assert answers["broken"]["error"].splitlines()[1] == "ImportError: no numpy"


def test_options__show_which_is_used_and_what_is_wrong_with_another(answers: dict[str, Any], worker: str) -> None:
    used, checked, no_program, foreign, none, incomplete, tampered, no_package, setting = answers["options"]
    assert used == f"{worker}\nChosen below."
    assert f"furrowmap {own_version()}" in checked.splitlines()
    assert "nothing.pcap" in no_program
    assert "protocol version 99" in foreign
    assert f"has no furrowmap {own_version()}." in none
    assert "has no wheel of needed==1.0 for this Python" in incomplete
    assert "The checksum of needed==1.0 differs from the plugin's list." in tampered
    assert f"has no furrowmap {own_version()}." in no_package
    assert setting == ""
    assert answers["nothing created"]["left"] == []


def test_options__create_an_environment_from_wheels_and_remove_it(answers: dict[str, Any]) -> None:
    assert answers["create"][1].endswith(f"The environment is ready: furrowmap {own_version()}.")
    assert answers["created"]["origin"] == "created"
    assert answers["created"]["program"][0].endswith("/furrowmap/environment/bin/python")
    assert answers["created"]["left"] == ["environment"]
    assert answers["removed"] == {"program": None, "origin": None, "left": []}


def test_sources__name_enums_as_qt_6_has_them(answers: dict[str, Any]) -> None:
    assert answers["enums"]["unscoped"] == []
    assert answers["enums"]["scoped"] > 20


@pytest.mark.parametrize("language", TRANSLATIONS)
def test_translation__has_every_string_of_the_plugin_in_every_language(answers: dict[str, Any], language: str) -> None:
    known = translations(language)
    assert [string for string in STRINGS if string not in known] == []
    assert [string for string in known if string not in STRINGS] == []
    for (_, source), words in known.items():
        assert sorted(placeholders(source)) == sorted(placeholders(words)), source
    assert answers[language]["translated"] == [known[string] for string in STRINGS]
    assert answers[language]["title"] == known["Algorithms", "Run a session"]
    assert answers[language]["unknown"]
    assert answers["english"]["translated"] == [source for _, source in STRINGS]


def test_translations__are_in_the_languages_of_the_product() -> None:
    assert tuple(TRANSLATIONS) == LANGUAGES[1:]


def placeholders(text: str) -> list[str]:
    return [part.split("}")[0] for part in text.split("{")[1:]]


def test_qgis_process__works_with_the_furrowmap_that_installed_the_plugin(
    qgis: QgisRoot, worker: str, folder: Path
) -> None:
    """A profile as new; the command installs the plugin and switches it on; QGIS has that furrowmap do the work."""
    run = (
        'export XDG_CACHE_HOME=/opt/furrowmap/cache; mkdir -p "$HOME/.local/share/QGIS/QGIS3/profiles/default"; '
        '"$1" qgis install --quiet >&2; '
        'qgis_process --json run furrowmap:inspect --FILES="$2"'
    )
    out = qgis.run("sh", "-ec", run, "sh", worker, folder / "recording.pcap", timeout_s=300)
    answer = json.loads(out[out.index("{") :])
    (found,) = json.loads(answer["results"]["FINDINGS"])["files"]
    assert found["facts"]["model"] == "VLP-16"
