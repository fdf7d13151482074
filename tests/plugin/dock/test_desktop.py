"""The plugin in the real desktop, used by its widgets: from recordings dropped on it to the map and the page."""

from __future__ import annotations

import datetime as dt
import json
import shutil
import subprocess
import sys
import tomllib
import warnings
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import geopandas as gpd
import pytest
from shapely import Point

from furrowmap.cli.share_commands import FORMAT_CHOICES
from furrowmap.core.values.margins import with_margin
from furrowmap.workflows.share.qgis_plugin import write_plugin_zip
from tests.conftest import installed
from tests.exporters.test_work_colours import contrast

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[3]
HERE = Path(__file__).parent
PROVOKED = ("another recording", "recoding", "upside down", "holds no recording")
LAYERS = {"trajectory", "passes", "coverage", "overlaps", "events", "zones", "tool_path", "dsm", "change", "cloud"}


@pytest.fixture(scope="module")
def worker(qgis: QgisRoot) -> str:
    """The worker's command as it is named in the tests' QGIS; where it cannot be made, as for `qgis`."""
    return installed("worker", "qgis_worker.sh")


@pytest.fixture(scope="module")
def plugins(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plugins")
    write_plugin_zip(folder / "zip")
    with zipfile.ZipFile(folder / "zip") as archive:
        archive.extractall(folder)
    return folder


def recordings(shared_data: Path, folder: Path, *names: str) -> Path:
    folder.mkdir()
    for name in names:
        shutil.copyfile(shared_data / "tractor_loop" / name, folder / name)
    return folder


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What somebody else's run left: here only the trajectory."""
    folder = tmp_path_factory.mktemp("results") / "north field 圃場"
    folder.mkdir()
    places = [Point(4000.0, 5000.0, 10.0), Point(4001.0, 5000.0, 10.0)]
    table = gpd.GeoDataFrame({"scan": [0, 1]}, geometry=places, crs="EPSG:6677")
    table.to_file(folder / "field.gpkg", layer="trajectory")
    return folder


@pytest.fixture(scope="module")
def drive(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drive") / "loop, 圃場 1"
    return recordings(shared_data, folder, "recording.pcap.gz", "gnss.nmea", "boundary.geojson")


@pytest.fixture(scope="module")
def flight(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute of a flight's positions and IMU, its images and parcels; its scans would take a minute."""
    folder = tmp_path_factory.mktemp("flight") / "trial"
    (folder / "images").mkdir(parents=True)
    for name, lines in (("gnss.nmea", 1400), ("imu.csv", 7001)):
        text = (shared_data / "uav_wheat" / name).read_text(encoding="utf-8")
        (folder / name).write_text("".join(text.splitlines(keepends=True)[:lines]), encoding="utf-8")
    for name in ("images.csv", "images/0000.jpg", "parcels.geojson"):
        shutil.copyfile(shared_data / "uav_wheat" / name, folder / name)
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("out")


def crashed_without_python(told: str) -> bool:
    """Whether a process died in a thread that runs no Python: faulthandler then names no thread as the current one."""
    return "Fatal Python error: " in told and "Current thread" not in told


@pytest.fixture(scope="module")
def seen(
    qgis: QgisRoot,
    worker: str,
    plugins: Path,
    drive: Path,
    results: Path,
    flight: Path,
    out: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Any]:
    """What use_dock.py has seen: QGIS is started once for all tests.

    Its times are for people (`pytest -s`): other work on the machine stretches them. Where QGIS crashes in a thread of
    its own, which runs no Python, that is told, and the story is told once more from its beginning.
    """
    copies = tmp_path_factory.mktemp("fresh")
    fresh = {folder: copies / folder.name for folder in (drive, results, flight, out)}
    for folder, kept in fresh.items():
        shutil.copytree(folder, kept)
    command = "scripts/qgis_desktop.sh", plugins, HERE / "use_dock.py", drive, results, flight, worker, out
    try:
        answer = qgis.run(*command, timeout_s=580)
    except AssertionError as error:
        if not crashed_without_python(str(error)):
            raise
        warnings.warn(f"QGIS crashed in a thread of its own, and was started again:\n{error}", stacklevel=1)
        for folder, kept in fresh.items():
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
        answer = qgis.run(*command, timeout_s=580)
    found: dict[str, Any] = json.loads(next(line for line in answer.splitlines() if line.startswith("{")))
    print(f"window busy at most {found['busy_s']:.2f} s of processor time, cancelled after {found['cancel_s']:.2f} s")
    return found


def test_reloads__five_leave_nothing_and_add_nothing(seen: dict[str, Any]) -> None:
    nothing = {"widgets": [], "menus": [], "provider": False, "tasks": 0}
    assert seen["unloaded"] == [nothing] * 5
    assert seen["loaded"] == [seen["loaded"][0]] * 5
    assert seen["loaded"][0]["provider"]
    assert seen["loaded"][0]["menus"] == ["furrowmap"]
    assert seen["loaded"][0]["widgets"].count("furrowmapDock") == 1


def test_without_worker__results_open_and_the_set_up_is_offered(seen: dict[str, Any], results: Path) -> None:
    assert seen["setup_offered"]
    assert not seen["setup_offered_with_worker"]
    assert seen["without_worker"] == {results.name: ["trajectory"]}
    assert seen["crs"] == "EPSG:6677"
    assert seen["refused_without_worker"]


def test_run__over_another_recording_says_so_in_full_and_replaces_or_keeps_both(seen: dict[str, Any]) -> None:
    assert "report.json of another recording" in seen["refusal"]
    assert seen["refusal"].count("<br>") == 1
    assert "--overwrite" not in seen["refusal"]
    assert seen["choice"] == [True, True]
    assert seen["kept_both"] == ["session_result", "session_result-2"]


def test_run__one_bar_for_all_stages(seen: dict[str, Any]) -> None:
    percent = [value for value in seen["percent"] if value >= 0]
    assert percent == sorted(percent)
    assert percent[-1] > 80
    assert len(percent) > len(seen["stages"])


def test_drop__recordings_become_a_form_with_what_was_found_out(seen: dict[str, Any]) -> None:
    assert seen["page_at_once"]
    assert seen["proposed_crs"] == "EPSG:6677"
    assert "Velodyne packets" in seen["findings"]
    assert "overlap by 59.8 s" in seen["findings"]
    assert "GNSS antenna" in seen["findings"]


def test_drop__of_a_folder_without_recordings_says_in_full_what_it_has(seen: dict[str, Any]) -> None:
    visible, words = seen["refused_drop"]
    assert visible
    assert "pictures holds no recording (a.jpg).</b><br>" in words
    assert "receiver's log" in words


def test_flight__has_a_form_for_its_sensors_without_an_implement(seen: dict[str, Any]) -> None:
    form = seen["flight"]
    assert form["vehicle"] == "Drone or helicopter"
    assert form["shown"] == ["furrowmapImuGroup", "furrowmapCameraGroup", "furrowmapParcelsGroup"]
    assert "a flight" in form["findings"]
    assert "Implement" not in form["findings"]


def test_flight__remedy_of_a_failed_preview_is_entered_by_its_button(seen: dict[str, Any]) -> None:
    words, button = seen["flight"]["failed"]
    assert "upside down" in words
    assert button == "Enter it: roll, pitch, yaw of the IMU = 180, 0, 0"
    words, offered = seen["flight"]["remedied"]
    assert words.startswith("Preview on the map: 61 m in 35 s")
    assert not offered


def test_flight__session_has_what_was_entered(seen: dict[str, Any]) -> None:
    assert "fx, fy, cx and cy" in seen["flight"]["fault"]
    session = tomllib.loads(seen["flight"]["saved"])
    assert session["antenna"]["xyz_m"] == [0.0, 0.0, 0.0]
    assert session["imu"]["xyz_m"] == [-0.039, 0.0, 0.0]
    assert session["imu"]["rpy_deg"] == [180.0, 0.0, 0.0]
    camera = session["camera"]
    assert (camera["table"], camera["width"], camera["height"]) == ("images.csv", 800, 600)  # the size is the image's
    assert (camera["fx"], camera["fy"], camera["cx"], camera["cy"]) == (661.4, 661.9, 402.7, 296.1)
    assert camera["rpy_deg"] == [180.0, 0.0, -90.0]  # as proposed: it looks down
    assert session["parcels"] == {"file": "parcels.geojson", "net_inset_m": [1.0, 0.0]}
    assert "implement" not in session


def test_preview__is_on_the_map_before_anything_is_filled_in(seen: dict[str, Any]) -> None:
    """In a group of its own, which goes when the run's products come; its files are none of the drive's."""
    assert seen["first_look"]["groups"] == {"Preview: loop, 圃場 1": ["preview_track"]}
    assert seen["first_look"]["words"].startswith("Preview on the map: 61 m in 60 s; 100%")
    assert seen["first_look"]["files"] == ["boundary.geojson", "gnss.nmea", "recording.pcap.gz", "session.toml"]


def test_preview__has_a_surface_as_soon_as_the_scanner_is_placed(seen: dict[str, Any]) -> None:
    assert seen["preview"] == {"Preview: North field": ["preview_track", "preview_dsm"]}
    assert seen["dropped_preview"] == seen["preview"]


def test_form__shows_what_is_missing_and_does_not_run(seen: dict[str, Any]) -> None:
    assert seen["still_in_form"]
    assert "width of the implement" in seen["fault"]


def test_form__asks_before_a_run_whose_places_are_not_filled_in(seen: dict[str, Any]) -> None:
    assert seen["asked"]["may_go_on"]
    assert "no accuracy is stated" in seen["asked"]["words"]
    assert seen["asked"]["marked"] == ["GNSS antenna: not filled in", "Scanner: not filled in"]


def test_tools__another_one_is_added_and_removed(seen: dict[str, Any]) -> None:
    first, second = tomllib.loads(seen["two_tools"])["implement"]
    assert (first["kind"], first["name"], first["width_m"]) == ("rotary tiller", "rotary tiller", 1.7)
    assert (second["name"], second["width_m"], second["xy_m"]) == ("tool 2", 1.5, [-2.4, 0.0])
    assert seen["tools"] == ["rotary tiller", "tool 2"]
    assert [tool["width_m"] for tool in tomllib.loads(seen["one_tool"])["implement"]] == [1.7]
    assert seen["first_tool"] == [1.7, False]


def test_machines__are_saved_from_the_form_chosen_from_the_list_and_dropped(seen: dict[str, Any]) -> None:
    assert seen["machines"] == ["Tractor 1.toml"]
    assert seen["machine_shown"] == "Tractor 1"
    assert seen["chosen"] == [1.847, -0.052, 1.624]
    session, learned = seen["learned"]
    assert tomllib.loads(session)["implement"]["learned"] == "Tractor 1.npz"
    assert learned == "learned", "the file is copied beside the session"
    assert seen["machines_after_drop"] == ["Tractor 1.toml", "passed on.toml"]


def test_machine__that_is_saved_already_is_replaced_only_by_its_button(seen: dict[str, Any]) -> None:
    words, offered = seen["machine_known"]
    assert "exists already" in words
    assert "type another name" in words
    assert "--overwrite" not in words
    assert offered
    assert seen["machine_replaced"]
    assert "No machine Tractor 9 is saved" in seen["unknown_machine"]


def test_drop__of_a_folder_with_one_recording_says_what_is_missing_and_takes_it(seen: dict[str, Any]) -> None:
    assert seen["alone"]["session"].endswith("alone/session.toml")
    assert seen["alone"]["recordings"] == "(missing: drop the recording here)\ngnss.nmea"
    assert "A recording is missing" in seen["alone"]["fault"]
    assert seen["completed"] == "recording.pcap.gz\ngnss.nmea"
    assert seen["kept"] == [0.8, 40.6, 179.3]


def test_drop__of_many_drives_runs_one_after_another_with_the_state_of_each(seen: dict[str, Any]) -> None:
    assert seen["waiting"] == "· positions\n    waiting"
    broken, incomplete, positions = seen["drives"]
    assert broken.startswith("✗ broken\n    failed: ")
    assert incomplete == "? incomplete\n    not run: recordings or places are missing"
    assert positions == "✓ positions\n    done"
    assert seen["incomplete"] == [True, "(missing: drop the recording here)\ngnss.nmea"]


def test_drives__list_is_there_after_a_restart_and_computes_nothing_again(seen: dict[str, Any]) -> None:
    assert seen["back_in_list"]
    assert seen["drives_after_restart"] == seen["drives"]
    assert seen["drives_again"] == seen["drives"]
    assert not seen["computed_again"]


def test_result__is_exported_and_added_to_a_farm_map_from_the_dock(seen: dict[str, Any]) -> None:
    assert seen["formats"] == list(FORMAT_CHOICES)
    assert seen["format_words"] == []
    assert seen["not_offered"] == ["glb"]  # without an orthophoto
    assert {"passes.geojson", "trajectory.geojson"} <= set(seen["exported"])
    remembered, layers = seen["farm"]
    assert remembered
    assert {"passes", "sessions"} <= set(layers)


def test_history__lists_the_fields_of_the_farm_map(seen: dict[str, Any]) -> None:
    assert seen["fields"] == ["positions"]  # the one session that was added to it
    assert seen["field"] == "positions"


def test_cancel__leaves_nothing(seen: dict[str, Any]) -> None:
    assert seen["workers_at_work"] == 1
    assert seen["workers_after_cancel"] == []
    assert seen["left_by_cancel"] == []


def test_run__ends_on_the_map_with_every_layer_styled(seen: dict[str, Any]) -> None:
    assert list(seen["groups"]) == ["North field"]
    assert set(seen["groups"]["North field"]) >= LAYERS
    assert seen["invalid"] == []
    assert seen["styles"]["change"] == "singlebandpseudocolor"
    assert seen["styles"]["cloud"] == "classified"
    assert seen["styles"]["trajectory"] == "categorizedSymbol"
    assert set(seen["map_tips"]) >= {"trajectory", "passes", "coverage", "events"}
    assert seen["terrain"] == "raster"
    assert seen["legend"] == "Height change (m)"
    assert seen["workers_after_run"] == []


def test_themes__show_the_layers_of_one_question_each(seen: dict[str, Any]) -> None:
    themes = seen["themes"]
    assert list(themes) == ["work", "passes", "surface", "quality"]
    assert {"coverage", "overlaps", "misses", "boundary"} <= set(themes["work"])
    assert not {"passes", "events", "change", "zones", "trajectory"} & set(themes["work"])
    assert {"passes", "events"} <= set(themes["passes"])
    assert "change" in themes["surface"]
    assert not {"passes", "coverage"} & set(themes["surface"])
    assert all("dsm" in shown for shown in themes.values())


def test_run__shows_its_stages_and_figures(seen: dict[str, Any], drive: Path) -> None:
    stages = [text[2:] for text in seen["stages"]]
    assert stages[:4] == ["hashing inputs", "reading scans", "matching scans", "placing points"]
    assert {"writing cloud", "making surfaces", "writing layers"} <= set(stages)
    assert all(text.startswith("✓") for text in seen["stages"][:-1])
    report = json.loads((drive / "session_result" / "report.json").read_text(encoding="utf-8"))
    assert report["session"]["name"] == "North field"
    assert report["session"]["lidar"]["rpy_deg"] == [0.8, 40.6, 179.3]
    assert report["session"]["field"]["boundary"] == "boundary.geojson"
    worked_m2, sigma_m2 = (report["figures"][f"worked_area{name}_m2"] for name in ("", "_sigma"))
    assert f"{with_margin(worked_m2, sigma_m2, ' m²')} (95 %)" in seen["figures"]
    start, end = seen["span"]
    assert report["figures"]["start"].startswith(start.removesuffix("Z"))
    assert report["figures"]["end"].startswith(end.removesuffix("Z"))


def test_dialogs__none_is_left_open_and_nothing_failed_in_the_log(seen: dict[str, Any]) -> None:
    assert seen["dialogs"] == []
    assert not seen["modal"]
    assert [line for line in seen["logged"] if not any(provoked in line for provoked in PROVOKED)] == []


def test_locator__finds_a_pass_by_its_number(seen: dict[str, Any]) -> None:
    assert seen["located"] == ["Pass 2"]
    assert seen["zoomed"]


def test_pages__overview_and_a_page_for_each_pass(qgis: QgisRoot, seen: dict[str, Any], out: Path) -> None:
    assert seen["zoomed"]
    (words, overview), (pass_words, atlas) = (
        (qgis.run("pdftotext", out / name, "-"), qgis.run("pdfinfo", out / name)) for name in ("page.pdf", "atlas.pdf")
    )
    assert "Pages:           1" in overview
    assert "Pages:           3" in atlas
    assert "Worked" in words
    assert "last pass" in words
    assert "pass 3" in pass_words


def test_map__replays_and_has_the_base_map_below_everything(seen: dict[str, Any]) -> None:
    assert seen["replayed"] >= 59
    assert all(valid and count == 1 for valid, count in seen["base_maps"].values())
    assert seen["lowest"] == "Own base map"
    assert seen["without_base_map"] == "North field"


def test_replay__shows_worked_ground_and_change_as_they_were_made(seen: dict[str, Any], drive: Path) -> None:
    figures = json.loads((drive / "session_result" / "report.json").read_text(encoding="utf-8"))["figures"]
    assert seen["swept_m2"] == pytest.approx(figures["swept_area_m2"], rel=0.02)
    assert seen["replay_work"] == [["Vector"], False, True, True]
    assert seen["replay_surface"] == [["Group", "Raster", "Vector"], False, True, True]
    end = dt.datetime.fromisoformat(seen["replay_end"]).astimezone(ZoneInfo("Asia/Tokyo"))
    assert seen["replay_time"] == f"{end:%Y-%m-%d %H:%M:%S} (Asia/Tokyo)"


def test_replay__shows_of_a_visible_cloud_what_was_scanned_until_then(seen: dict[str, Any]) -> None:
    column, operator, until = seen["cloud_filter"][0].split()
    assert (column, operator) == ("GpsTime", "<=")
    assert float(until) == pytest.approx(seen["cloud_filter"][1], abs=0.002)
    assert seen["cloud_filter_after"] == ""


def test_own_base_map__is_a_raster_mbtiles_or_a_service_with_its_attribution(seen: dict[str, Any]) -> None:
    assert seen["own_maps"] == {
        "dsm": [True, ""],
        "field map": [True, "Village of Ami"],
        "Parcels": [True, "Land registry office"],
    }
    assert "The map of 127.0.0.1 cannot be reached" in seen["unreachable"]
    assert seen["unreached"]
    assert seen["credit without tiles"] == ""


def test_texts__are_legible_on_a_dark_theme(seen: dict[str, Any]) -> None:
    darkest, lightest, red = seen["on_dark"]
    assert lightest - darkest > 150  # of 255
    assert contrast(red, "#323232") > 4.5  # WCAG 2.2, criterion 1.4.3


def test_results__opened_again_replace_themselves_and_survive_in_a_project(seen: dict[str, Any]) -> None:
    assert seen["again_the_same"]
    assert seen["project_round_trip"]


def test_killed_qgis__leaves_no_worker(
    qgis: QgisRoot, worker: str, plugins: Path, shared_data: Path, tmp_path: Path
) -> None:
    drive = recordings(
        shared_data, tmp_path / "killed", "recording.pcap.gz", "gnss.nmea", "boundary.geojson", "session.toml"
    )
    out = qgis.run("python3", HERE / "kill_qgis.py", plugins, drive / "session.toml", worker, timeout_s=300)
    answer = json.loads(out.splitlines()[-1])
    assert answer["signal"] == 9
    assert answer["workers"] == []
    assert answer["left"] == []


def test_crash_at_the_end__counts_until_every_plugin_is_unloaded(qgis: QgisRoot, plugins: Path) -> None:
    """What QGIS does after that has no code of a plugin: QGIS 3.40 uses memory that it has freed."""
    desktop = ("scripts/qgis_desktop.sh", plugins, HERE / "crash_at_end.py")
    qgis.run(*desktop, "last")
    with pytest.raises(AssertionError, match="Segmentation fault"):
        qgis.run(*desktop, "furrowmap")


@pytest.mark.parametrize(
    ("crash", "without_python"),
    [
        (
            "ctypes.CDLL(None).pthread_create(ctypes.byref(ctypes.c_void_p()), None, ctypes.CDLL(None).abort, None)",
            True,
        ),
        ("ctypes.CDLL(None).abort()", False),
        ("threading.Thread(target=os.abort).start()", False),
        ("sys.exit(1)", False),
    ],
)
def test_crash__in_a_thread_without_python_is_told_from_others(crash: str, without_python: bool) -> None:
    code = f"import ctypes, os, sys, threading, time\n{crash}\ntime.sleep(60.0)"
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert crashed_without_python(done.stderr) == without_python
