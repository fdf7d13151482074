"""A farm's base in a GeoPackage: whole or as it was, whatever happens; what is in it is what the runs found."""

from __future__ import annotations

import io
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

import geopandas as gpd
import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyproj import CRS

from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError
from furrowmap.exporters.farm import farm_geopackage as geopackage
from furrowmap.workflows.farm.farm import add_to_farm_map, farm_map_sessions, remove_from_farm_map
from tests.exporters.farm.processes import adders, ask, ended
from tests.exporters.farm.result_folders import coverage, write_result

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[3]
UTM = CRS.from_epsg(6691)
DETAILS = ("events", "tool_path", "misses", "unworked", "boundary", "overlaps", "passes", "coverage", "zones")
MEMORY = ("fields", "visits", "seasons", "machines")
TIMELESS = ("misses", "unworked", "boundary", "zones", "fields", "seasons")
KILLS = int(os.environ.get("KILLS", "3"))
HOSTILE = '\'; DROP TABLE "sessions"; --圃場'


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Results of three sessions on different days; `b2` is `b` run again, `renamed` is `a` under another name."""
    root = tmp_path_factory.mktemp("results")
    return {
        "a": write_result(root / "a"),
        "b": write_result(root / "b", name="South field", recording="b" * 64, day=30),
        "b2": write_result(root / "b2", name="South field", recording="b" * 64, day=30, area_m2=80.0),
        "c": write_result(
            root / "c", name='\'; DROP TABLE "sessions"; --圃場', recording="c" * 64, day=400, worked=False
        ),
        "renamed": write_result(root / "renamed", name="North field again"),
        "geoid": write_result(root / "geoid", recording="d" * 64, heights="jpgeo2024"),
    }


@pytest.fixture(scope="module")
def helpers() -> Iterator[list[subprocess.Popen[str]]]:
    """Two programs that start processes which add results."""
    with adders(2) as both:
        yield both


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return tmp_path / "farm.gpkg"


@pytest.fixture(scope="module")
def two(results: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A base of two sessions; not to be changed."""
    path = tmp_path_factory.mktemp("two") / "farm.gpkg"
    add_to_farm_map(str(path), [results["a"], results["b"]])
    return path


def content(path: Path) -> dict[str, list[Any]]:
    """Everything that the sessions brought into a base, as whoever may only read it finds it; without row numbers."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        tables = [
            r[0] for r in database.execute("SELECT substr(name, 7) FROM furrowmap_base WHERE name LIKE 'layer %'")
        ]
        rows = {}
        for table in sorted(tables):
            names = [row[1] for row in database.execute(f'PRAGMA table_info("{table}")')]
            kept = ", ".join(f'"{name}"' for name in names if name not in ("fid", "added"))
            rows[table] = sorted(database.execute(f'SELECT {kept} FROM "{table}"').fetchall(), key=repr)
    return rows


def test_layers__hold_what_the_run_found_with_session_and_day(two: Path, results: dict[str, Path]) -> None:
    sessions = gpd.read_file(two, layer="sessions")
    assert sessions["name"].tolist() == ["North field", "South field"]
    assert sessions.crs == CRS.from_epsg(6677)
    for name in DETAILS:
        mine = gpd.read_file(two, layer=name)
        given_ = gpd.read_file(results["a"] / "field.gpkg", layer=name)
        first = mine[mine["session"] == sessions["session"][0]]
        assert len(mine) == 2 * len(given_)
        assert first.geometry.tolist() == given_.geometry.tolist()
        for column in given_.columns.drop("geometry").drop(["start", "time", "end", "t_s"], errors="ignore"):
            assert first[column].tolist() == given_[column].tolist() or first[column].isna().any(), (name, column)
    assert shapely.equals_exact(gpd.read_file(two, layer="coverage").geometry[0], coverage(), 1e-9)
    assert sessions.geometry.covers(coverage().buffer(-1e-6)).all()


def test_track__follows_the_positions_within_two_centimetres(two: Path, results: dict[str, Path]) -> None:
    track = gpd.read_file(two, layer="tracks").geometry[0]
    positions = gpd.read_file(results["a"] / "field.gpkg", layer="trajectory").geometry
    assert positions.distance(track).max() <= 0.02
    assert track.has_z
    assert len(track.geoms) == 1
    assert shapely.get_num_coordinates(track) < len(positions) / 3


def test_whole_numbers__stay_whole_and_unknown_ones_null(two: Path) -> None:
    with closing(sqlite3.connect(two)) as database:
        kinds = set(database.execute("SELECT DISTINCT typeof(pass) FROM tool_path").fetchall())
        column = {row[1]: row[2] for row in database.execute("PRAGMA table_info(tool_path)")}
    assert kinds == {("integer",), ("null",)}
    assert column["pass"] == "INTEGER"
    assert column["date"] == "DATE"


def test_day__is_that_of_the_place(results: dict[str, Path], tmp_path: Path) -> None:
    add_to_farm_map(str(tmp_path / "by_place.gpkg"), [results["a"]])
    add_to_farm_map(str(tmp_path / "utc.gpkg"), [results["a"]], zone=ZoneInfo("UTC"))
    days = [str(farm_map_sessions(str(tmp_path / name))[2][0].date) for name in ("by_place.gpkg", "utc.gpkg")]
    assert days == ["2026-06-12", "2026-06-11"]  # it begins at 15:00 UTC, midnight in Japan


def test_provenance__keeps_the_report_and_the_session_word_by_word(two: Path, results: dict[str, Path]) -> None:
    kept = pyogrio.read_dataframe(two, layer="provenance")
    assert kept["report"][0] == (results["a"] / "report.json").read_text("utf-8")
    assert kept["session_toml"][1] == (results["b"] / "session.toml").read_text("utf-8")
    assert kept["furrowmap"].tolist() == ["0.1.0", "0.1.0"]


def test_same_result_again__leaves_the_file_untouched(base: Path, results: dict[str, Path]) -> None:
    add_to_farm_map(str(base), [results["a"], results["b"]])
    before = (base.read_bytes(), base.stat().st_ino)
    change = add_to_farm_map(str(base), [results["b"], results["a"]])
    assert (base.read_bytes(), base.stat().st_ino) == before
    assert (len(change.unchanged), change.added, change.replaced, change.sessions) == (2, (), (), 2)


def test_new_result__replaces_the_sessions_old_one_and_nothing_else(base: Path, results: dict[str, Path]) -> None:
    add_to_farm_map(str(base), [results["a"], results["b"]])
    before = content(base)
    change = add_to_farm_map(str(base), [results["b2"]])
    after = content(base)
    assert (len(change.replaced), change.added, change.sessions) == (1, (), 2)
    assert {name: len(rows) for name, rows in after.items()} == {name: len(rows) for name, rows in before.items()}
    assert [s.worked_area_m2 for s in farm_map_sessions(str(base))[2]] == [75.5, 80.0]
    assert after["passes"] == before["passes"]


def test_remove__takes_out_what_belongs_to_the_session(base: Path, two: Path, results: dict[str, Path]) -> None:
    shutil.copyfile(two, base)
    change = remove_from_farm_map(str(base), ["South field"])
    alone = base.with_name("alone.gpkg")
    add_to_farm_map(str(alone), [results["a"]])
    assert change.sessions == 1
    assert content(base) == content(alone)
    remove_from_farm_map(str(base), [farm_map_sessions(str(base))[2][0].session[:6]])
    assert {name: len(rows) for name, rows in content(base).items()} == dict.fromkeys(content(alone), 0)


@pytest.mark.parametrize("word", ["West field", "0", ""])
def test_remove__of_what_is_not_there_is_refused(base: Path, two: Path, word: str) -> None:
    shutil.copyfile(two, base)
    with pytest.raises(InputError) as refused:
        remove_from_farm_map(str(base), [word])
    assert refused.value.code == "no-such-session"
    assert base.read_bytes() == two.read_bytes()


def test_other_crs__is_transformed_as_by_geopandas_and_areas_stay(base: Path, results: dict[str, Path]) -> None:
    add_to_farm_map(str(base), [results["a"]], crs=UTM)
    for name in DETAILS:
        expected = gpd.read_file(results["a"] / "field.gpkg", layer=name).to_crs(UTM)
        found = gpd.read_file(base, layer=name)
        assert found.crs == UTM
        assert shapely.equals_exact(found.geometry.to_numpy(), expected.geometry.to_numpy(), 1e-6).all()
        if "area_m2" in expected:
            np.testing.assert_array_equal(found["area_m2"], expected["area_m2"])


def test_other_crs__is_refused_when_asked(base: Path, two: Path, results: dict[str, Path], tmp_path: Path) -> None:
    shutil.copyfile(two, base)
    foreign = write_result(tmp_path / "foreign", name="West field", recording="e" * 64, crs=CRS.from_epsg(6691))
    for options in ({"same_crs": True}, {"crs": UTM}):
        with pytest.raises(RefusedError) as refused:
            add_to_farm_map(str(base), [foreign], **options)
        assert refused.value.code == "base-crs"
    assert base.read_bytes() == two.read_bytes()


def test_doubts__are_told(base: Path, results: dict[str, Path]) -> None:
    add_to_farm_map(str(base), [results["a"]])
    change = add_to_farm_map(str(base), [results["renamed"], results["geoid"]])
    assert [notice.code for notice in change.notices] == ["session-renamed", "heights-mixed"]


def test_two_results_of_one_session__are_refused(base: Path, results: dict[str, Path]) -> None:
    with pytest.raises(InputError) as refused:
        add_to_farm_map(str(base), [results["b"], results["b2"]])
    assert refused.value.code == "session-twice"
    assert list(base.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "damage", "code"),
    [
        ("report.json", None, "no-result"),
        ("report.json", b"{", "result-unreadable"),
        ("report.json", b"[]", "result-unreadable"),
        ("report.json", b'{"session": {"name": 3}, "inputs": []}', "result-unreadable"),
        ("report.json", b'{"session": {"name": "x", "crs": {"heights": "e"}}, "inputs": 5}', "result-unreadable"),
        ("field.gpkg", None, "result-unreadable"),
        ("field.gpkg", b"SQLite format 3\0 and no more", "result-unreadable"),
    ],
)
def test_bad_folder__is_told_and_the_base_stays(
    base: Path, two: Path, results: dict[str, Path], tmp_path: Path, name: str, damage: bytes | None, code: str
) -> None:
    shutil.copyfile(two, base)
    bad = tmp_path / "bad"
    shutil.copytree(results["c"], bad)
    (bad / name).unlink()
    if damage is not None:
        (bad / name).write_bytes(damage)
    with pytest.raises(InputError) as refused:
        add_to_farm_map(str(base), [results["b2"], bad])
    assert refused.value.code == code
    assert base.read_bytes() == two.read_bytes()
    assert sorted(path.name for path in base.parent.iterdir()) == ["bad", "farm.gpkg"]


def test_what_is_no_base__is_refused_and_left_as_it_is(base: Path, results: dict[str, Path]) -> None:
    field = results["a"] / "field.gpkg"
    shutil.copyfile(field, base)
    for text in (None, b"", b"not a database at all", field.read_bytes()[:5000]):
        if text is not None:
            base.write_bytes(text)
        before = base.read_bytes()
        with pytest.raises(InputError) as refused:
            add_to_farm_map(str(base), [results["b"]])
        assert refused.value.code == "not-a-base"
        assert base.read_bytes() == before
    with pytest.raises(InputError) as refused:
        farm_map_sessions(str(base.with_name("none.gpkg")))
    assert refused.value.code == "base-missing"
    with pytest.raises(InputError) as refused:
        add_to_farm_map(str(base.parent / "none" / "farm.gpkg"), [results["b"]])
    assert refused.value.code == "base-unreachable"


def test_what_a_user_put_into_the_base__stays(base: Path, two: Path, results: dict[str, Path]) -> None:
    shutil.copyfile(two, base)
    gpd.GeoDataFrame({"session": ["mine"]}, geometry=[shapely.Point(1, 2)], crs=6677).to_file(base, layer="wells")
    with closing(sqlite3.connect(base)) as database, database:
        database.execute("UPDATE layer_styles SET styleQML = '<qgis/>' WHERE f_table_name = 'coverage'")
        database.execute("UPDATE qgis_projects SET content = 'abcd'")
        database.execute("INSERT INTO qgis_projects VALUES ('mine', '{}', '00')")
    add_to_farm_map(str(base), [results["c"]])
    remove_from_farm_map(str(base), ["North field"])
    with closing(sqlite3.connect(base)) as database:
        styles = dict(database.execute("SELECT f_table_name, styleQML FROM layer_styles"))
        projects = dict(database.execute("SELECT name, content FROM qgis_projects"))
    assert gpd.read_file(base, layer="wells")["session"].tolist() == ["mine"]
    assert styles["coverage"] == "<qgis/>"
    assert len(styles) > 5
    assert not [name for name, style in styles.items() if "report.html" in style]  # there is none beside the base
    assert projects == {"furrowmap": "abcd", "mine": "00"}


def test_layer_of_somebody_elses__is_not_overwritten(base: Path, results: dict[str, Path]) -> None:
    add_to_farm_map(str(base), [results["c"]])
    gpd.GeoDataFrame({"a": [1]}, geometry=[shapely.Point(1, 2)], crs=6677).to_file(base, layer="zones")
    before = base.read_bytes()
    with pytest.raises(RefusedError) as refused:
        add_to_farm_map(str(base), [results["a"]])
    assert refused.value.code == "base-clash"
    assert base.read_bytes() == before


def test_new_columns_and_layers_of_a_later_version__find_their_place(
    base: Path, results: dict[str, Path], tmp_path: Path
) -> None:
    add_to_farm_map(str(base), [results["a"]])
    later = tmp_path / "later"
    shutil.copytree(results["b"], later)
    with closing(sqlite3.connect(later / "field.gpkg")) as database, database:
        database.execute('ALTER TABLE passes ADD COLUMN "soil ""moved""_m3" REAL')
        database.execute('UPDATE passes SET "soil ""moved""_m3" = 1.5')
    gpd.GeoDataFrame({"volume_m3": [2.0]}, geometry=[shapely.box(0, 0, 1, 1)], crs=6677).to_file(
        later / "field.gpkg", layer="low_spots"
    )
    add_to_farm_map(str(base), [later])
    passes = gpd.read_file(base, layer="passes")
    assert passes['soil "moved"_m3'].isna().tolist() == [True] * 3 + [False] * 3
    assert gpd.read_file(base, layer="low_spots")["volume_m3"].tolist() == [2.0]


def test_extent__is_that_of_what_is_left(base: Path, results: dict[str, Path], tmp_path: Path) -> None:
    add_to_farm_map(str(base), [results["a"], results["b"]])
    remove_from_farm_map(str(base), ["North field"])
    bounds = gpd.read_file(base, layer="passes").total_bounds
    with closing(sqlite3.connect(base)) as database:
        told = database.execute(
            "SELECT min_x, min_y, max_x, max_y FROM gpkg_contents WHERE table_name = 'passes'"
        ).fetchone()
    assert shapely.box(*told).contains(shapely.box(*bounds))
    np.testing.assert_allclose(told, bounds, atol=0.02)  # the spatial index has single precision


def test_project__is_the_same_for_the_same_sessions(two: Path, base: Path, results: dict[str, Path]) -> None:
    add_to_farm_map(str(base), [results["b"]])
    add_to_farm_map(str(base), [results["a"]])
    archives = []
    for path in (two, base):
        with closing(sqlite3.connect(path)) as database:
            archives.append(bytes.fromhex(database.execute("SELECT content FROM qgis_projects").fetchone()[0]))
    assert archives[0] == archives[1]
    with zipfile.ZipFile(io.BytesIO(archives[0])) as archive:
        assert archive.namelist() == ["furrowmap.qgs"]
        assert str(two.parent) not in archive.read("furrowmap.qgs").decode()  # it may move with its folder


def test_program_that_edits_the_base__is_not_overrun(base: Path, two: Path, results: dict[str, Path]) -> None:
    shutil.copyfile(two, base)
    with closing(sqlite3.connect(base, isolation_level=None)) as editor:
        editor.execute("PRAGMA journal_mode = WAL")
        editor.execute("BEGIN")
        editor.execute("UPDATE provenance SET furrowmap = 'edited'")
        with pytest.raises(RefusedError) as refused:
            add_to_farm_map(str(base), [results["c"]])
        assert refused.value.code == "base-open"
        editor.execute("COMMIT")
    add_to_farm_map(str(base), [results["c"]])
    assert pyogrio.read_dataframe(base, layer="provenance")["furrowmap"].tolist() == ["edited", "edited", "0.1.0"]


def test_other_process__is_waited_for_and_refused_in_the_end(base: Path, two: Path) -> None:
    shutil.copyfile(two, base)
    waits = []
    with (
        geopackage.exclusive(base, lambda *_: None),
        pytest.raises(RefusedError) as refused,
        geopackage.exclusive(base, lambda *told: waits.append(told), 0.2),
    ):
        pytest.fail("two have the base at once")
    assert refused.value.code == "base-busy"
    assert waits
    with geopackage.exclusive(base, lambda *_: None):
        pass
    assert [path.name for path in base.parent.iterdir()] == ["farm.gpkg"]


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")
def test_kill__leaves_the_old_base_or_the_new_one(
    base: Path, results: dict[str, Path], helpers: list[subprocess.Popen[str]]
) -> None:
    add_to_farm_map(str(base), [results["a"], results["b"]])
    old = content(base)
    new_path = base.with_name("new.gpkg")
    shutil.copyfile(base, new_path)
    add_to_farm_map(str(new_path), [results["b2"], results["c"]])
    new = content(new_path)
    new_path.unlink()
    kept = base.read_bytes()
    chance = random.Random(7)
    seen = []
    helper = helpers[0]
    ask(helper, base, results["a"])  # nothing new: Python's start is over when it ends
    assert ended(helper) == 0
    begun = time.monotonic()
    ask(helper, base, results["b2"], results["c"])
    assert ended(helper) == 0
    whole_s = time.monotonic() - begun
    for _ in range(KILLS):
        base.write_bytes(kept)
        process = ask(helper, base, results["b2"], results["c"])
        time.sleep(chance.uniform(0.0, 1.1 * whole_s))
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
        ended(helper)
        found = content(base)
        assert found in (old, new)
        seen.append(found == new)
    assert False in seen
    add_to_farm_map(str(base), [results["b2"], results["c"]])
    assert content(base) == new
    assert [path.name for path in base.parent.iterdir()] == ["farm.gpkg"]  # what killed ones left is gone


@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork")
def test_two_at_once__lose_nothing(base: Path, results: dict[str, Path], helpers: list[subprocess.Popen[str]]) -> None:
    for _ in range(2):
        base.unlink(missing_ok=True)
        for helper, names in zip(helpers, (("a", "c"), ("b", "geoid")), strict=True):
            ask(helper, base, *(results[name] for name in names))
        assert [ended(helper) for helper in helpers] == [0, 0]
        assert len(farm_map_sessions(str(base))[2]) == 4


@settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(st.sampled_from(["add", "remove"]), st.sampled_from(["a", "b", "b2", "c"])), min_size=2, max_size=6
    )
)
def test_any_sequence__ends_as_a_table_of_sessions_would(
    results: dict[str, Path], tmp_path: Path, deeds: list[tuple[str, str]]
) -> None:
    path = tmp_path / "any.gpkg"
    path.unlink(missing_ok=True)
    names = {"a": "North field", "b": "South field", "b2": "South field", "c": '\'; DROP TABLE "sessions"; --圃場'}
    expected: dict[str, str] = {}
    for deed, which in deeds:
        if deed == "add":
            add_to_farm_map(str(path), [results[which]])
            expected[names[which]] = which
        elif names[which] in expected:
            remove_from_farm_map(str(path), [names[which]])
            del expected[names[which]]
        else:
            with pytest.raises(FurrowmapError):
                remove_from_farm_map(str(path), [names[which]])
    if expected:
        again = tmp_path / "again.gpkg"
        again.unlink(missing_ok=True)
        add_to_farm_map(str(again), [results[which] for which in expected.values()])
        mine, theirs = content(path), content(again)
        assert {name: rows for name, rows in mine.items() if rows} == {name: r for name, r in theirs.items() if r}


def test_qgis__opens_the_project_in_the_base(two: Path, base: Path, results: dict[str, Path], qgis: QgisRoot) -> None:
    shutil.copyfile(two, base)
    add_to_farm_map(str(base), [results["c"]])
    script = Path(__file__).with_name("project_in_qgis.py")
    told = json.loads(qgis.run("python3", script, f"geopackage:{base}?projectName=furrowmap").splitlines()[-1])
    assert (told["opened"], told["error"], told["crs"]) == (True, "", "EPSG:6677")
    assert (told["begin"], told["end"]) == ("2026-06-11", "2027-07-17")
    assert list(told["groups"]) == [
        "Fields",
        "Sessions",
        "Work in detail",
        "Worked ground by day",
        "Boundaries and zones",
        "Tables",
        "Background",
    ]
    assert told["groups"]["Worked ground by day"] == ["coverage"]
    assert told["layers"].keys() == {"sessions", "tracks", "provenance", *DETAILS, *MEMORY}
    assert set(told["relations"].values()) == {True}
    for name, layer in told["layers"].items():
        assert layer["valid"], (name, layer["error"])
        assert layer["features"] == len(content(base)[name])
        assert set(layer["unnamed"]) <= {"fid"}, name  # all others have names for people
        if name not in ("provenance", "machines"):
            assert (layer["crs"], layer["renderer"]) == ("EPSG:6677", layer["own_style"])
            assert layer["map_tip"]
            assert (layer["time"] is not None) == layer["own_time"] == (name not in TIMELESS)
    assert told["layers"]["coverage"]["labels"]
    assert told["layers"]["fields"]["labels"]
    colours = told["layers"]["coverage"]["colours"]
    assert len(set(colours)) == len(colours) == 2  # a colour for each day
    west, south, east, north = told["extent"]
    assert shapely.box(west, south, east, north).contains(coverage())


def test_farm_map_of_another_version__is_refused_and_left_as_it_was(base: Path, results: dict[str, Path]) -> None:
    add_to_farm_map(base, [results["a"]])
    with closing(sqlite3.connect(base)) as database, database:
        database.execute("UPDATE furrowmap_base SET value = '99' WHERE name = 'schema'")
    before = base.read_bytes()
    for use in (lambda: add_to_farm_map(base, [results["b"]]), lambda: farm_map_sessions(base)):
        with pytest.raises(RefusedError, match="schema 99") as caught:
            use()
        assert caught.value.code == "base-schema"
    assert base.read_bytes() == before


def test_farm_map_in_a_database__without_psycopg_names_the_extra(
    results: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith(("furrowmap.exporters.farm.postgis", "psycopg"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "furrowmap.exporters.farm.postgis", raising=False)
    monkeypatch.setitem(sys.modules, "psycopg", None)  # as Python does where a package is not installed
    with pytest.raises(InputError, match="psycopg") as caught:
        add_to_farm_map("postgresql://farmer@127.0.0.1/farm", [results["a"]])
    assert caught.value.code == "extra-missing"
