"""The reference pages against what furrowmap does: a sentence is looked up in its page, and tried."""

from __future__ import annotations

import json
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pandas as pd
import pytest
import rasterio

import furrowmap
from furrowmap.cli import worker_process as worker
from furrowmap.core.runtime import errors
from furrowmap.core.runtime.errors import FurrowmapError, InputError
from furrowmap.core.runtime.settings import threads, using_threads
from furrowmap.core.session.session_file import FURTHER, parse_session
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.inertial import IMU_CLASSES, IMU_MODELS, InertialNoise, inertial_noise
from furrowmap.core.values.session import Session

REFERENCE = Path(__file__).resolve().parents[2] / "docs" / "reference"
LEAST = 'furrowmap = 1\n[recording]\nlidar = ["a.pcap"]\ngnss = ["a.nmea"]\n[crs]\nmap = "EPSG:6677"\n'
TOOL = "[implement]\nwidth_m = 1.7\nxy_m = [0, 0]\n"


@cache
def page(name: str) -> str:
    return (REFERENCE / f"{name}.md").read_text(encoding="utf-8")


def stated(name: str, *sentences: str) -> None:
    """A page has these words, wherever its lines break."""
    flat = " ".join(page(name).split())
    assert [words for words in sentences if words not in flat] == []


def rows(name: str, heading: str) -> list[tuple[str, ...]]:
    """The cells of the table below a heading or a head row."""
    below = page(name)[page(name).index(heading) + len(heading) :]
    table = re.search(r"(?:^\|.*\n)+", below, re.MULTILINE)
    assert table is not None
    lines = [line for line in table[0].splitlines() if not re.match(r"\| -+", line)]
    return [tuple(cell.strip() for cell in line.strip("|").split(" | ")) for line in lines]


def refusal(text: str) -> str:
    with pytest.raises(InputError) as error:
        parse_session(text)
    return error.value.what


@pytest.mark.parametrize(
    ("key", "default", "words"),
    [
        ("crs.heights", "ellipsoidal", 'default "ellipsoidal"'),
        ("crs.coordinates", "as-recorded", 'default "as-recorded"'),
        ("lidar.model", None, "# default: from the packets"),
        ("recording.date", None, "only for logs without a date"),
        ("implement.working_depth_m", None, "working_depth_m = 0.12 # optional"),
        ("implement.states_use", "replace", '"replace" # the states detected in the scans; or "check" them'),
        ("implement.states_minus_gnss_s", 0.0, "clock of the states minus that of the positions"),
        ("implement.lift_m", None, "optional: lift height"),
        ("implement.region_m", None, "Default: a box around `xy_m` and `width_m`"),
        ("recording.lidar_minus_gnss_s", 0.0, "LiDAR clock minus GNSS clock"),
        ("run.standing", True, "keep scans taken while standing still"),
        ("run.fixes", None, "Default: fixed and float if there is any fixed position, else all."),
        ("antenna", None, "Without `[antenna]`, the antenna is at the vehicle origin"),
        ("trajectory", None, "optional: replaces GNSS and scan matching"),
        ("lidar.xyz_m", None, "Without `xyz_m` or `rpy_deg` of `[lidar]`, these are zero"),
    ],
)
def test_session_page__defaults(key: str, default: object, words: str) -> None:
    stated("session", words)
    value: Any = parse_session(LEAST + TOOL)
    for part in key.split("."):
        value = getattr(value, part)
    assert value == default


@pytest.mark.parametrize(
    ("inside", "outside", "words"),
    [
        ("[antenna]\nxyz_m = [15, -15, 15]", "[antenna]\nxyz_m = [0, 0, 15.1]", "more than 15 m is an error"),
        ("[lidar]\nxyz_m = [0, 0, -15]", "[lidar]\nxyz_m = [-15.1, 0, 0]", "more than 15 m is an error"),
        (TOOL + "lift_m = 0.1", TOOL + "lift_m = 0.09", "0.1 to 1.2 m"),
        (TOOL + "lift_m = 1.2", TOOL + "lift_m = 1.21", "0.1 to 1.2 m"),
        (TOOL + 'states_use = "check"', TOOL + 'states_use = "use"', '"replace"'),
        ('[trajectory]\nfiles = ["a"]\ntime = "gps"', '[trajectory]\nfiles = ["a"]\ntime = "tai"', 'or "gps"'),
        ("[run]\nthreads = 1", "[run]\nthreads = 0", "threads = 2"),
        ("[run]\nstanding = false", "[run]\nsitting = false", "Unknown keys are errors"),
        (TOOL + "region_m = [-15, 0, -1, 1]", TOOL + "region_m = [-15.1, 0, -1, 1]", "x min, max, y min, max"),
    ],
)
def test_session_page__limits(inside: str, outside: str, words: str) -> None:
    stated("session", words)
    parse_session(f"{LEAST}{inside}\n")
    assert refusal(f"{LEAST}{outside}\n")


@pytest.mark.parametrize(
    ("missing", "other"),
    [
        ("furrowmap = 1\n", None),
        ('map = "EPSG:6677"\n', None),
        ('lidar = ["a.pcap"]\n', TOOL + 'states = ["s.csv"]\n'),
        ('gnss = ["a.nmea"]\n', '[trajectory]\nfiles = ["t.csv"]\n'),
    ],
)
def test_session_page__required_keys(missing: str, other: str | None) -> None:
    stated(
        "session",
        "Required are `furrowmap`, `[crs] map`, `[recording] lidar` (or `[implement] states`, or `[imu] files`, or "
        "`[attitude]`), and `[recording] gnss` (or `[trajectory]`).",
    )
    assert refusal(LEAST.replace(missing, ""))
    if other is not None:
        parse_session(LEAST.replace(missing, "") + other)


def test_session_page__threads_of_the_option_the_session_and_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    stated("session", "`--threads` overrides it; it overrides FURROWMAP_THREADS")
    monkeypatch.setenv("FURROWMAP_THREADS", "3")
    found = []
    for option, session in ((None, None), (None, 2), (1, 2)):
        with using_threads(option), using_threads(session, by_default=True):
            found.append(threads())
    assert found == [3, 2, 1]


def test_session_page__figures_and_models_of_imus() -> None:
    lines = [line.strip().strip("|") for line in page("session").splitlines() if line.startswith("    | ")]
    head, _, *figures, models = ([cell.strip(" `") for cell in line.split(" | ")] for line in lines)
    for column, kind in enumerate(head[1:], 1):
        told = {row[0]: float(row[column]) for row in figures}
        assert inertial_noise(kind) == InertialNoise.of_data_sheet(**told)
        for model in models[column].split(", "):
            assert inertial_noise(model) == inertial_noise(kind)
    assert sorted(", ".join(models[1:]).split(", ")) == sorted(IMU_MODELS)
    assert head[1:] == list(IMU_CLASSES)


def test_session_page__fixes_are_the_words_of_gga() -> None:
    stated("session", "GGA fix quality: `fixed`, `float`, `dgps`, `single` and others.")
    assert {"fixed": 4, "float": 5, "dgps": 2, "single": 1}.items() <= {fix.label: int(fix) for fix in Fix}.items()


def test_session_page__example_names_every_table() -> None:
    example = re.search(r"```toml\n(.*?)```", page("session"), re.DOTALL)
    assert example is not None
    assert set(tomllib.loads(example[1])) == set(Session.__struct_encode_fields__) - set(FURTHER.values())


def talked(start: dict[str, Any]) -> list[dict[str, Any]]:
    """What a worker answers to a start message, with standard input left open."""
    command = [sys.executable, "-m", "furrowmap", "worker"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(start).encode() + b"\n")
        process.stdin.flush()
        return [json.loads(line) for line in process.stdout]


def test_worker_page__messages_and_their_fields(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    """Of a preview, which warns, and of one that is refused: each kind of message has the fields of its row."""
    fields = {}
    for kind, words, _ in rows("worker", "| type | fields | sent |\n| --- | --- | --- |\n"):
        own = re.findall(r"`([a-z]+)`", words.partition(":")[0])
        fields[kind.strip("`")] = {"type", *own}
    arguments = ["run", str(simulated.session), "--preview", "-o", str(tmp_path / "out")]
    good = talked({"type": "start", "arguments": arguments})
    bad = talked({"type": "start", "arguments": ["run", str(tmp_path / "none.toml")]})
    seen = defaultdict(set)
    for message in [*good, *bad]:
        seen[message["type"]] |= set(message)
    assert set(fields) - set(seen) <= {"log"}
    assert all(fields[kind] == keys for kind, keys in seen.items())
    stated("worker", "This is protocol 1.")
    assert good[0]["type"] == bad[0]["type"] == "hello"
    assert good[0]["protocol"] == worker.PROTOCOL == 1
    assert [message["type"] for message in good[-2:]] == ["result", "done"]
    assert [message["type"] for message in bad[-2:]] == ["error", "done"]
    assert all(0.0 <= message["share"] <= 1.0 for message in good if message["type"] == "progress")


def test_commands_page__folder_of_a_preview_by_default(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    full_help = runpy.run_path(str(REFERENCE.parents[1] / "scripts" / "command_reference.py"))["full_help"]
    words = "[default: SESSION_result beside SESSION, or SESSION_preview with --preview]"
    assert words in " ".join(full_help("furrowmap run").split())
    shutil.copytree(simulated.folder, tmp_path / "drive")
    furrowmap.preview(tmp_path / "drive" / simulated.session.name)
    assert {path.name for path in (tmp_path / "drive").iterdir()} - {
        path.name for path in simulated.folder.iterdir()
    } == {f"{simulated.session.stem}_preview"}


def test_worker_page__statuses_are_those_of_the_errors() -> None:
    (words,) = (cells[1] for cells in rows("worker", "| type | fields | sent |\n") if cells[0] == "`done`")
    named = {word: int(number) for number, word in re.findall(r"(\d+) ([a-z ]+)", words)}
    assert named == {
        "success": 0,
        "failure": FurrowmapError.exit_status,
        "usage error": errors.UsageError.exit_status,
        "invalid input": InputError.exit_status,
        "refused": errors.RefusedError.exit_status,
        "cancelled": errors.Cancelled.exit_status,
    }


def test_worker_page__progress_is_at_most_ten_messages_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    stated("worker", "at the start of each stage, then at most ten times per second")
    now_s = 0.0
    monkeypatch.setattr("furrowmap.cli.worker_process.time.monotonic", lambda: now_s)
    sent: list[dict[str, Any]] = []
    show = worker._throttled(lambda kind, **content: sent.append(content))
    for k in range(2001):
        now_s = k / 1000
        show("reading", k / 2000)
    assert 15 <= len(sent) <= 21
    show("writing", 0.0)
    assert sent[-1] == {"stage": "writing", "share": 0.0}


def test_worker_page__patience_is_that_of_the_plugin() -> None:
    stated("worker", "terminate it only if it does not react within twenty seconds")
    source = (REFERENCE.parents[1] / "plugin" / "worker.py").read_text(encoding="utf-8")
    assert re.search(r"^CANCEL_S = 20\.0$", source, re.MULTILINE)


def test_products_page__cloud(result: furrowmap.Result) -> None:
    stated("products", "points: LAS 1.4, point format 6, or 7 with", "stored as whole millimetres")
    stated("products", "extra dimension, uint32: number of the scan", "own firing, adjusted standard GPS time")
    las = laspy.read(result.path / "cloud.copc.laz")
    assert (str(las.header.version), las.header.point_format.id) == ("1.4", 6)
    assert las.header.scales.tolist() == [0.001] * 3
    assert las.scan.dtype == np.uint32
    t_s = las_time_to_utc(np.asarray(las.gps_time))
    start, end = (pd.Timestamp(result.report["figures"][name]).timestamp() for name in ("start", "end"))
    assert start - 0.1 < t_s.min() <= t_s.max() < end + 0.1
    (words,) = (cells[1] for cells in rows("products", "## cloud.copc.laz") if cells[0] == "classification")
    assert set(las.classification) <= {int(number) for number in re.findall(r"\b\d+\b", words)}
    inside = las.point_source_id > 0
    (one,) = result.passes.itertuples()
    margin = np.timedelta64(1, "ms")
    times = (t_s * 1e6).astype("datetime64[us]")
    assert times[inside].min() >= one.start.tz_localize(None).to_datetime64() - margin
    assert times[inside].max() <= one.end.tz_localize(None).to_datetime64() + margin


@pytest.mark.parametrize("name", ["dsm.tif", "dsm_before.tif", "change.tif"])
def test_products_page__rasters(result: furrowmap.Result, name: str) -> None:
    stated("products", "in cells of 5 cm", "whose cell edges are multiples of 5 cm from the CRS's 0, 0")
    stated("products", "`change.tif` has the change of height and its standard error, both in m")
    head = "| band of dsm.tif and dsm_before.tif | content |\n"
    bands = [cells[0].partition(" ")[2] for cells in rows("products", head)]
    tags = re.findall(r"`([A-Z_]+(?:_1)?)`", page("products")[page("products").index("Tags: ") :].partition("##")[0])
    assert len(tags) == 8
    with rasterio.open(result.path / name) as raster, rasterio.open(result.path / "dsm.tif") as surface:
        assert list(raster.descriptions) == (["change", "standard error"] if name == "change.tif" else bands)
        assert raster.units == tuple("1" if band == "returns" else "m" for band in raster.descriptions)
        assert (raster.transform, raster.shape) == (surface.transform, surface.shape)
        assert (raster.transform.a, raster.transform.e) == (0.05, -0.05)
        for edge in (raster.transform.c, raster.transform.f):
            assert edge / 0.05 == pytest.approx(round(edge / 0.05), abs=1e-6)
        assert set(tags) <= set(raster.tags())
        assert np.isnan(raster.nodata)


def names_in(cell: str) -> set[str]:
    return set(re.findall(r"[a-z0-9_]+…?", cell))


def test_products_page__fields_of_the_trajectory(result: furrowmap.Result) -> None:
    named = {name for cells in rows("products", "## field.gpkg, layer trajectory")[1:] for name in names_in(cells[0])}
    columns = {re.sub(r"^sigma_.*", "sigma_…", name) for name in result.trajectory.columns} - {"geometry"}
    assert columns == named
    track = result.trajectory
    np.testing.assert_allclose(track["time"].astype("int64") / 1e3, track["t_s"], rtol=0, atol=5.1e-4)
    for column in ("heading_from", "position_from", "height_from", "level_from", "motion"):
        (words,) = (cells[1] for cells in rows("products", "layer trajectory\n") if cells[0] == column)
        assert set(track[column].dropna()) <= names_in(words), column


def test_products_page__fields_of_the_ground_worked(result: furrowmap.Result) -> None:
    areas = {"area_m2", "area_ellipsoid_m2", "area_sigma_m2"}
    stated("products", *(f"`{name}`" for name in areas))
    listed = rows("products", "## field.gpkg, layers of the ground worked")[1:]
    assert {cells[0] for cells in listed} == set(result.layers) - {"trajectory"}
    for name, geometry, fields in listed:
        layer = result.layer(name)
        named = set(re.findall(r"`([a-z0-9_]+)`", fields)) | (areas if "areas" in fields else set())
        assert set(layer.columns) - {"geometry"} == named, name
        kind = geometry.partition(" ")[0].strip(",:").replace("line", "linestring")
        assert {text.lower() for text in layer.geom_type} <= {kind, f"multi{kind}"}, name
        assert all(layer.has_z == ("height" in geometry)), name


def test_products_page__keys_of_the_report(result: furrowmap.Result) -> None:
    listed = rows("products", "## report.json")[1:]
    alone = [cells[0] for cells in listed if not cells[0].startswith("figures,")]
    assert {*result.report, "parcels", "check_points", "control_points"} == {
        name for cell in alone for name in cell.split(", ")
    }
    texts: defaultdict[str, str] = defaultdict(str)
    for cells in listed:
        texts[cells[0].partition(",")[0]] += cells[1]
    for part in ("figures", "coordinates", "accuracy"):
        named = set(re.findall(r"`([a-z_0-9]+)`", texts[part]))
        inner = result.report[part]["implement"] if part == "figures" else {}
        assert {name for name in named if name not in {**result.report[part], **inner}} <= {
            "field", "east_m", "north_m", "up_m", "residual_rms_m", "transitions", "walls",
            "name", "left_m", "width_m", "working_s",  # of the sections of task data
        }, part  # fmt: skip


def test_products_page__every_product_has_the_provenance(result: furrowmap.Result) -> None:
    stated("products", "in a record *text area description* of the cloud", "in the tags of rasters")
    report = result.report
    digests = [one["sha256"] for one in report["inputs"]]
    with laspy.open(result.path / "cloud.copc.laz") as reader:
        (text,) = (record.record_data for record in reader.header.vlrs if record.record_id == 3)
    item = (result.path / "item.json").read_text(encoding="utf-8")
    with rasterio.open(result.path / "dsm.tif") as raster:
        tags = raster.tags()
    assert all(digest in text.decode() and digest in item and digest in " ".join(tags.values()) for digest in digests)
    days = pd.Timestamp(report["figures"]["start"]) - pd.Timestamp("2026-01-01T00:00:00Z")
    assert float(tags["MEASURED_EPOCH"]) == pytest.approx(2026 + days / pd.Timedelta(days=365), abs=0.001)


@pytest.mark.parametrize(
    "name", ["docs/reference/session", "docs/reference/worker", "docs/reference/glossary", "CHANGELOG"]
)
def test_pages__name_in_code_what_exists(name: str) -> None:
    """Every identifier, option, key, code or file in `code` is somewhere in the source."""
    root = REFERENCE.parents[1]
    parts = ("app", "cli", "core", "exporters", "plugin", "scripts")
    source = "\n".join(path.read_text(encoding="utf-8") for part in parts for path in (root / part).rglob("*.py"))
    text = (root / f"{name}.md").read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    words = set(re.findall(r"`(-{0,2}[A-Za-z][\w-]+)(?:\(\))?`", prose))
    assert {word for word in words if word.lstrip("-") not in source} == set()
