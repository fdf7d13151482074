"""A farm's base in a real PostGIS: one transaction, types and indexes, rights, and no password in any word."""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import psycopg
import pytest
import shapely
from pyproj import CRS

from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError, UsageError
from furrowmap.exporters.farm import postgis
from furrowmap.workflows.farm.farm import add_to_farm_map, farm_map_sessions, remove_from_farm_map
from tests.conftest import installed
from tests.exporters.farm.processes import adders, ended
from tests.exporters.farm.processes import ask as order
from tests.exporters.farm.result_folders import write_result
from tests.exporters.farm.server import PASSWORD, Server, running_server

if TYPE_CHECKING:
    from conftest import QgisRoot

CHECKOUT = Path(__file__).resolve().parents[3]
HOSTILE = "'; DROP TABLE furrowmap.sessions; --\t\\N圃場"
KILLS = int(os.environ.get("KILLS", "2"))
DETAILS = ("events", "tool_path", "misses", "unworked", "boundary", "overlaps", "passes", "coverage", "zones")
MEMORY = ("fields", "visits", "seasons", "machines")
TIMELESS = ("misses", "unworked", "boundary", "zones", "fields", "seasons")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    """A PostGIS from Debian's packages. Where there is none to be had, CI fails and everybody else skips."""
    programs = Path(installed("PostGIS", "tools_of_tests.py", "postgis"))
    with running_server(programs) as running:
        yield running


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("results")
    return {
        "a": write_result(root / "a"),
        "a2": write_result(root / "a2", area_m2=80.0),
        "hostile": write_result(root / "hostile", name=HOSTILE, recording="c" * 64, day=400, worked=False),
    }


@pytest.fixture(scope="module")
def two(server: Server, results: dict[str, Path]) -> str:
    """The address of a base of two sessions, not to be changed."""
    address = server.new_database("two")
    add_to_farm_map(address, [results["a"], results["hostile"]])
    return address


@pytest.fixture
def new_database(server: Server, request: pytest.FixtureRequest) -> str:
    return server.new_database(f"{abs(hash(request.node.name)):x}")


def ask(address: str, query: str) -> list[tuple]:
    with psycopg.connect(address) as connection:
        return connection.execute(query).fetchall()


def test_layers__hold_what_the_run_found(two: str, results: dict[str, Path]) -> None:
    assert [session.name for session in farm_map_sessions(two)[2]] == ["North field", HOSTILE]
    for name in DETAILS:
        expected = gpd.read_file(results["a"] / "field.gpkg", layer=name)
        rows = ask(two, f"SELECT ST_AsEWKB(geom), ST_SRID(geom), ST_IsValid(geom) FROM furrowmap.{name} ORDER BY fid")
        assert shapely.from_wkb([row[0] for row in rows]).tolist() == expected.geometry.tolist()
        assert {row[1:] for row in rows} <= {(6677, True)}
        assert len(rows) == len(expected)
    area = ask(two, "SELECT area_m2, ST_Area(geom) FROM furrowmap.coverage")[0]
    assert area[0] == pytest.approx(area[1])


def test_heights_and_times__come_through(two: str, results: dict[str, Path]) -> None:
    expected = gpd.read_file(results["a"] / "field.gpkg", layer="events")
    rows = ask(two, "SELECT ST_Z(geom), time, pass, sigma_s FROM furrowmap.events ORDER BY fid")
    assert [row[0] for row in rows] == expected.geometry.z.tolist()
    assert [row[1] for row in rows] == [moment.to_pydatetime() for moment in expected["time"]]
    assert [row[2] for row in rows] == [None if p != p else int(p) for p in expected["pass"]]
    assert [row[3] for row in rows] == [None if s != s else s for s in expected["sigma_s"]]
    assert ask(two, "SELECT date::text FROM furrowmap.sessions ORDER BY date")[0] == ("2026-06-12",)


def test_tables__have_types_indexes_and_comments(two: str) -> None:
    kinds = dict(ask(two, "SELECT f_table_name, type || coord_dimension || srid FROM geometry_columns ORDER BY 1"))
    assert kinds["passes"] == "MULTIPOLYGON26677"
    assert kinds["events"] == "POINT36677"
    indexes = {row[0] for row in ask(two, "SELECT indexdef FROM pg_indexes WHERE schemaname = 'furrowmap'")}
    for name in ("sessions", *DETAILS):
        assert any(f"furrowmap.{name} USING gist (geom)" in index.replace('"', "") for index in indexes)
    assert ask(two, "SELECT obj_description('furrowmap.passes'::regclass)")[0][0].startswith(
        "passes: The ground worked"
    )


def test_new_result__replaces_the_old_one_and_removing_takes_all(new_database: str, results: dict[str, Path]) -> None:
    add_to_farm_map(new_database, [results["a"], results["hostile"]])
    change = add_to_farm_map(new_database, [results["a2"], results["hostile"]])
    assert (len(change.replaced), len(change.unchanged), change.sessions) == (1, 1, 2)
    assert ask(new_database, "SELECT count(*) FROM furrowmap.passes") == [(3,)]
    assert [s.worked_area_m2 for s in farm_map_sessions(new_database)[2]] == [80.0, 75.5]
    assert remove_from_farm_map(new_database, ["North field", HOSTILE]).sessions == 0
    for name in (*DETAILS, "sessions", "provenance", "tracks"):
        assert ask(new_database, f"SELECT count(*) FROM furrowmap.{name}") == [(0,)]


@pytest.mark.parametrize("broken", ["append", "store_styles", "store_project"])
def test_interruption__leaves_the_base_as_it_was(
    server: Server, results: dict[str, Path], monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    address = server.new_database(f"broken_{broken}")
    add_to_farm_map(address, [results["a"]])
    before = [ask(address, f"SELECT * FROM furrowmap.{name} ORDER BY fid") for name in ("sessions", *DETAILS)]
    whole: Callable[..., object] = getattr(postgis.PostgisEdit, broken)

    def stopped(*arguments: object) -> object:
        whole(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(postgis.PostgisEdit, broken, stopped)
    with pytest.raises(KeyboardInterrupt):
        add_to_farm_map(address, [results["a2"], results["hostile"]])
    monkeypatch.undo()
    assert [ask(address, f"SELECT * FROM furrowmap.{n} ORDER BY fid") for n in ("sessions", *DETAILS)] == before


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")
def test_kill__leaves_the_old_base_or_the_new_one(new_database: str, results: dict[str, Path]) -> None:
    def content() -> tuple[object, ...]:
        query = "SELECT session, count(*) FROM furrowmap.{} GROUP BY 1 ORDER BY 1"
        areas = ask(new_database, "SELECT worked_area_m2 FROM furrowmap.sessions ORDER BY session")
        return (areas, *(ask(new_database, query.format(name)) for name in ("provenance", "tracks", *DETAILS)))

    add_to_farm_map(new_database, [results["a"]])
    old = content()
    chance = random.Random(7)
    with adders(1) as (helper,):
        order(helper, new_database, results["a"])  # nothing new: Python's start is over when it ends
        assert ended(helper) == 0
        begun = time.monotonic()
        order(helper, new_database, results["a2"], results["hostile"])
        assert ended(helper) == 0
        whole_s, new = time.monotonic() - begun, content()
        for _ in range(KILLS):
            remove_from_farm_map(new_database, [HOSTILE])
            add_to_farm_map(new_database, [results["a"]])
            process = order(helper, new_database, results["a2"], results["hostile"])
            time.sleep(chance.uniform(0.2, 1.0) * whole_s)
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
            ended(helper)
            assert content() in (old, new)
            add_to_farm_map(new_database, [results["a2"], results["hostile"]])
            assert content() == new


def test_two_at_once__lose_nothing(new_database: str, results: dict[str, Path]) -> None:
    errors: list[BaseException] = []

    def add(name: str) -> None:
        try:
            add_to_farm_map(new_database, [results[name]])
        except BaseException as error:  # noqa: BLE001 (told below)
            errors.append(error)

    threads = [threading.Thread(target=add, args=(name,)) for name in ("a", "hostile", "a2")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert len(farm_map_sessions(new_database)[2]) == 2


def test_schema__of_any_name_is_quoted(new_database: str, results: dict[str, Path]) -> None:
    name = 'Farm "1"; DROP SCHEMA public; --'
    add_to_farm_map(new_database, [results["a"]], schema=name)
    assert len(farm_map_sessions(new_database, schema=name)[2]) == 1
    with pytest.raises(InputError) as refused:
        farm_map_sessions(new_database)
    assert refused.value.code == "base-missing"


def test_crs_without_a_code__is_refused(new_database: str, results: dict[str, Path]) -> None:
    own = CRS.from_proj4("+proj=tmerc +lat_0=36 +lon_0=139.8 +k=1 +x_0=0 +y_0=0 +ellps=GRS80 +units=m")
    with pytest.raises(RefusedError) as refused:
        add_to_farm_map(new_database, [write_result(results["a"].parent / "own", crs=own)])
    assert refused.value.code == "base-crs"
    assert ask(new_database, "SELECT to_regnamespace('furrowmap')") == [(None,)]


REFUSALS: dict[str, tuple[Callable[[Server], str], type[FurrowmapError]]] = {
    "base-password": (lambda server: server.url("two", password=f"{PASSWORD}!"), InputError),
    "base-unreachable": (lambda server: server.url("nowhere"), InputError),
    "base-no-postgis": (lambda server: server.new_database("plain", "template1"), InputError),
    "base-no-right": (lambda server: server.url("template_postgis"), RefusedError),
    "usage": (lambda server: f"postgresql://farmer:{PASSWORD}%zz@[::1/two", UsageError),
}


@pytest.mark.parametrize("code", REFUSALS)
def test_refusal__is_three_lines_without_the_password(
    server: Server, two: str, results: dict[str, Path], code: str
) -> None:
    address, kind = REFUSALS[code]
    with pytest.raises(kind) as refused:
        add_to_farm_map(address(server), [results["a"]])
    assert refused.value.code == code
    assert all(refused.value.lines)
    assert "s3cret" not in str(refused.value)


def test_no_server__is_told(results: dict[str, Path]) -> None:
    with pytest.raises(InputError) as refused:
        add_to_farm_map("postgresql://farmer:s3cret@127.0.0.1:1/farm", [results["a"]])
    assert refused.value.code == "base-unreachable"
    assert "s3cret" not in str(refused.value)


def test_password__is_nowhere_in_the_base(two: str) -> None:
    (project,) = ask(two, "SELECT content FROM furrowmap.qgis_projects")
    assert b"s3cret" not in bytes(project[0])
    assert "s3cret" not in farm_map_sessions(two)[0]


def test_styles__need_no_right_of_their_own(server: Server, new_database: str, results: dict[str, Path]) -> None:
    name = new_database.rsplit("/", 1)[1]
    with server.administer(name) as connection:
        connection.execute("ALTER SCHEMA public OWNER TO admin")
        connection.execute("REVOKE CREATE ON SCHEMA public FROM PUBLIC")
    change = add_to_farm_map(new_database, [results["a"]])
    assert [notice.code for notice in change.notices] == ["base-no-styles"]
    assert len(farm_map_sessions(new_database)[2]) == 1


def test_style_and_project_of_a_user__stay(new_database: str, results: dict[str, Path]) -> None:
    add_to_farm_map(new_database, [results["a"]])
    with psycopg.connect(new_database) as connection:
        connection.execute("UPDATE layer_styles SET styleqml = '<qgis/>' WHERE stylename = 'coverage'")
        connection.execute("UPDATE furrowmap.qgis_projects SET content = 'mine'")
    add_to_farm_map(new_database, [results["hostile"]])
    assert ask(new_database, "SELECT styleqml::text FROM layer_styles WHERE stylename = 'coverage'") == [("<qgis/>",)]
    assert bytes(ask(new_database, "SELECT content FROM furrowmap.qgis_projects")[0][0]) == b"mine"


def test_qgis__opens_the_project_in_the_database(two: str, server: Server, qgis: QgisRoot, tmp_path: Path) -> None:
    secret = tmp_path / "pgpass"  # as a user has it: the project itself has no password
    secret.write_text(f"127.0.0.1:{server.port}:*:farmer:{PASSWORD.replace(':', chr(92) + ':')}\n", encoding="utf-8")
    secret.chmod(0o600)
    script = Path(__file__).with_name("project_in_qgis.py")
    address = f"postgresql://farmer@127.0.0.1:{server.port}?dbname=two&schema=furrowmap&project=furrowmap"
    told = json.loads(qgis.run("env", f"PGPASSFILE={secret}", "python3", script, address).splitlines()[-1])
    assert (told["opened"], told["error"], told["crs"]) == (True, "", "EPSG:6677")
    assert set(told["relations"].values()) == {True}
    assert told["layers"].keys() == {"sessions", "tracks", "provenance", *DETAILS, *MEMORY}
    for name, layer in told["layers"].items():
        assert layer["valid"], (name, layer["error"])
        if name not in ("provenance", "machines"):
            assert (layer["crs"], layer["renderer"]) == ("EPSG:6677", layer["own_style"])
            assert (layer["time"] is not None) == layer["own_time"] == (name not in TIMELESS)
    assert told["layers"]["coverage"]["features"] == 1


def test_what_the_database_refuses__is_an_error_that_leaves_the_base_as_it_was(
    new_database: str, results: dict[str, Path]
) -> None:
    add_to_farm_map(new_database, [results["a"]])
    with psycopg.connect(new_database, autocommit=True) as connection:
        connection.execute("ALTER ROLE CURRENT_USER SET default_transaction_read_only = on")
    try:
        with pytest.raises(FurrowmapError, match="read-only transaction") as caught:
            add_to_farm_map(new_database, [results["a2"]])
        assert caught.value.code == "base-database"
        assert ask(new_database, "SELECT worked_area_m2 FROM furrowmap.sessions") == [(75.5,)]
    finally:
        with psycopg.connect(new_database, autocommit=True) as connection:
            connection.execute("SET default_transaction_read_only = off")
            connection.execute("ALTER ROLE CURRENT_USER RESET default_transaction_read_only")
