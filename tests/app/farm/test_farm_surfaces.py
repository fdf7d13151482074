"""The surfaces of a farm's sessions: which ones belong to a mosaic, in which order, and what is refused."""

from __future__ import annotations

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


def test_output__has_a_known_suffix_and_replaces_nothing_unasked(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        mosaic([], tmp_path / "farm.png", overwrite=True)
    (tmp_path / "farm.tif").write_text("mine")
    with pytest.raises(RefusedError) as refused:
        mosaic([], tmp_path / "farm.tif")
    assert refused.value.code == "output-exists"
    assert (tmp_path / "farm.tif").read_text() == "mine"
