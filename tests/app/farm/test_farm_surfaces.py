"""The surfaces of a farm's sessions: which ones belong to a mosaic, in which order, and what is refused."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from furrowmap.core.runtime.errors import InputError, RefusedError, UsageError
from furrowmap.workflows.farm.farm import add_to_farm_map
from furrowmap.workflows.farm.mosaic import find_surfaces, mosaic
from tests.exporters.farm.result_folders import write_result


def test_surfaces__are_those_of_the_sessions_in_their_order(tmp_path: Path) -> None:
    later = write_result(tmp_path / "later", name="Later", recording="b" * 64, day=9)
    earlier, bare = write_result(tmp_path / "earlier"), write_result(tmp_path / "bare", name="Bare", day=5)
    for folder in (later, earlier):
        (folder / "dsm.tif").touch()
    add_to_farm_map(str(tmp_path / "farm.gpkg"), [later, earlier, bare])
    for sources in ([str(tmp_path / "farm.gpkg")], [str(later), str(bare), str(earlier)]):
        paths, notices = find_surfaces(sources, "dsm")
        assert paths == [earlier / "dsm.tif", later / "dsm.tif"]
        assert [notice.code for notice in notices] == ["surfaces-missing"]
    with pytest.raises(InputError) as refused:
        find_surfaces([str(tmp_path / "farm.gpkg")], "dtm")
    assert refused.value.code == "no-surfaces"
    with pytest.raises(UsageError):
        find_surfaces([str(tmp_path / "farm.gpkg")], "../../etc/passwd")


def test_surfaces__of_another_folder_are_those_of_the_result_that_was_added(tmp_path: Path) -> None:
    """A map that came from somebody else names any folder; that of a user's own results is known by its content."""
    mine, other = write_result(tmp_path / "results" / "mine"), tmp_path / "results" / "other"
    (tmp_path / "maps").mkdir()
    (mine / "dsm.tif").touch()
    farm_map = tmp_path / "maps" / "farm.gpkg"
    assert not add_to_farm_map(str(farm_map), [mine]).notices
    assert find_surfaces([farm_map], "dsm") == ([mine / "dsm.tif"], ())
    write_result(other, name="Other", recording="b" * 64)
    (other / "dsm.tif").touch()
    below = write_result(tmp_path / "maps" / "below", name="Below", recording="c" * 64)
    add_to_farm_map(str(farm_map), [below])
    (below / "dsm.tif").symlink_to(other / "dsm.tif")
    for named in (other, "//host/share/result", "\\\\host\\share", "//?/C:/results", tmp_path / "results"):
        with closing(sqlite3.connect(farm_map)) as database, database:
            for (trigger,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
                database.execute(f'DROP TRIGGER "{trigger}"')  # of the spatial index, which needs functions of GDAL
            database.execute("UPDATE sessions SET folder = ? WHERE name != 'Below'", (str(named),))
        with pytest.raises(InputError) as refused:
            find_surfaces([farm_map], "dsm")
        assert refused.value.code == "no-surfaces"
        assert str(named) in refused.value.what
    (below / "dsm.tif").unlink()
    (below / "dsm.tif").touch()
    paths, notices = find_surfaces([farm_map], "dsm")
    assert paths == [below / "dsm.tif"]
    assert [notice.code for notice in notices] == ["folders-foreign"]
    write_result(below, name="Below", recording="c" * 64, area_m2=5.0)
    (notice,) = (n for n in add_to_farm_map(str(farm_map), [below]).notices if n.code == "folders-foreign")
    assert str(tmp_path / "results") in notice.text


def test_output__has_a_known_suffix_and_replaces_nothing_unasked(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        mosaic([], tmp_path / "farm.png", overwrite=True)
    (tmp_path / "farm.tif").write_text("mine")
    with pytest.raises(RefusedError) as refused:
        mosaic([], tmp_path / "farm.tif")
    assert refused.value.code == "output-exists"
    assert (tmp_path / "farm.tif").read_text() == "mine"
