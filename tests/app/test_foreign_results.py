"""Results of anybody: whatever their layers and surfaces are, no command opens other files for them."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import pytest

import furrowmap
from furrowmap.core.geodesy.projection import read_parameters
from furrowmap.core.readers.ogr_layers import list_layers
from furrowmap.core.runtime.errors import FurrowmapError, InputError
from furrowmap.core.runtime.npz import read_npz
from furrowmap.core.session.machine_file import load_machine
from furrowmap.core.session.session_file import load_session
from furrowmap.workflows.live.background_map import open_background
from tests.core.readers.driver_signatures import signatures
from tests.core.readers.watched_files import bait_beside
from tests.exporters.farm.result_folders import write_result

FORMATS = ("gpkg", "csv", "isoxml", "stac", "tum", "glb")
ONE_PROCESS = furrowmap.SeasonSettings(workers=1)
"""Others would import everything anew for each result; they run the same code."""
COMMANDS: dict[str, Callable[[Path, Path], object]] = {
    "open_result": lambda result, _: furrowmap.open_result(result).layers["passes"],
    "dsm": lambda result, _: furrowmap.open_result(result).dsm,
    "share": lambda result, out: furrowmap.share(result, out / "page"),
    "share --qfield": lambda result, out: furrowmap.share(result, out / "project", qfield=True),
    "farm add": lambda result, out: furrowmap.add_to_farm_map(out / "farm.gpkg", [result]),
    "farm mosaic": lambda result, out: furrowmap.mosaic([result], out / "mosaic.tif"),
    "season": lambda result, out: furrowmap.season([result], out / "season", ONE_PROCESS),
    "tie": lambda result, out: furrowmap.tie([result, result], out / "tie"),
    **{
        f"export {to}": lambda result, out, to=to: furrowmap.export([result], to, out / f"out.{to}")  # type: ignore[misc]
        for to in FORMATS
    },
}
DRIVERS = ("OGR_VRT", "OGR_VRT of an address", "VRT", "WMS")
OF_RASTERS = ("VRT", "WMS")
PRODUCTS = {"field.gpkg": DRIVERS, "dsm.tif": DRIVERS, "change.tif": OF_RASTERS, "orthophoto.tif": OF_RASTERS}
"""Drivers of both kinds for a product of each kind."""


@pytest.mark.parametrize("product", PRODUCTS)
def test_promise_23__a_product_of_another_driver_opens_nothing_else(product: str, tmp_path: Path) -> None:
    result = write_result(tmp_path / "result")
    taken = []
    with bait_beside(tmp_path) as bait:
        texts = signatures(str(bait.file), bait.url)
        for driver in PRODUCTS[product]:
            (result / product).write_text(("{" if product == "field.gpkg" else "") + texts[driver])
            for command, run in COMMANDS.items():
                out = tmp_path / f"{driver}_{command}".replace(" ", "_")
                out.mkdir()
                with suppress(FurrowmapError):
                    run(result, out)
                if bait.taken():
                    taken.append((driver, command))
    assert taken == []


WAIT_FOR_EVER = ("report.json", "session.toml", "field.gpkg", "field.gpkg-wal", "dsm.tif")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
@pytest.mark.parametrize("product", WAIT_FOR_EVER)
def test_promise_23__a_product_that_is_a_pipe_is_refused_at_once(product: str, tmp_path: Path) -> None:
    result = write_result(tmp_path / "result")
    (result / product).unlink(missing_ok=True)
    os.mkfifo(result / product)
    for command, run in COMMANDS.items():
        (tmp_path / command).mkdir()
        with pytest.raises(InputError, match="it is no file"):
            run(result, tmp_path / command)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes there")
def test_promise_23__other_files_that_are_pipes_are_refused_at_once(tmp_path: Path) -> None:
    """Opening one of them to be read would not end."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for read in (
        lambda: load_session(pipe),
        lambda: furrowmap.farm_map_sessions(pipe),
        lambda: list_layers(pipe),
        lambda: open_background(pipe),
        lambda: read_parameters(pipe),
        lambda: load_machine(pipe),
        lambda: read_npz(pipe),
    ):
        with pytest.raises((FurrowmapError, OSError), match="pipe"):
            read()


def test_promise_23__a_result_whose_layers_are_stored_queries_is_refused_at_once(tmp_path: Path) -> None:
    result = write_result(tmp_path / "result")
    endless = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c WHERE x < 0"
    with closing(sqlite3.connect(result / "field.gpkg")) as database:
        database.execute("ALTER TABLE passes RENAME TO kept")
        database.execute(f"CREATE VIEW passes AS SELECT * FROM kept WHERE fid IN ({endless})")
        database.commit()
    for command, run in COMMANDS.items():
        (tmp_path / command).mkdir()
        with pytest.raises(InputError, match="does not end soon"):
            run(result, tmp_path / command)


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE VIEW endless AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c",
        "CREATE TRIGGER slow AFTER DELETE ON sessions BEGIN SELECT count(*) FROM sessions a, sessions b; END",
    ],
)
def test_promise_23__a_farm_map_that_computes_is_refused(statement: str, tmp_path: Path) -> None:
    farm_map = tmp_path / "farm.gpkg"
    furrowmap.add_to_farm_map(farm_map, [write_result(tmp_path / "result")])
    assert len(furrowmap.farm_map_sessions(farm_map)[2]) == 1
    with closing(sqlite3.connect(farm_map)) as database:
        database.execute(statement)
        database.commit()
    with pytest.raises(InputError, match="does more than to hold rows") as refused:
        furrowmap.farm_map_sessions(farm_map)
    assert refused.value.code == "not-a-base"
