"""Whatever has the name of a file to be written, nothing but that file changes, and nothing waits for ever."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.farm.farm_geopackage import exclusive
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.batch_state import batch_state
from furrowmap.exporters.files.plain_files import append_to, create_new, refuse_shared
from tests.app.obstacles import OBSTACLES, obstacle

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and sockets need rights there")


def append(path: Path) -> None:
    with append_to(path) as file:
        file.write(b"line\n")


def create(path: Path) -> None:
    os.close(create_new(path))


def replace(path: Path) -> None:
    with atomic_output(path) as unfinished:
        unfinished.write_text("new")


def lock(path: Path) -> None:
    with exclusive(path.with_name(path.name.removesuffix(".lock").removeprefix(".")), lambda *_: None, 0.0):
        pass


def keep_state(path: Path) -> None:
    with batch_state(path) as state:
        state.keep_names({"a": "b"})


IN_PLACE: Mapping[str, tuple[Callable[[Path], None], str]] = {
    "log": (append, "record.log"),
    "lock": (lock, ".farm.gpkg.lock"),
    "state": (keep_state, "batch.sqlite"),
}
"""What is changed in its place."""


@pytest.mark.parametrize("kind", OBSTACLES)
@pytest.mark.parametrize("writer", IN_PLACE)
def test_promise_23__writing_in_place_refuses_what_is_not_its_own(writer: str, kind: str, tmp_path: Path) -> None:
    write, name = IN_PLACE[writer]
    with obstacle(tmp_path / name, kind) as unchanged:
        with pytest.raises(InputError) as raised:
            write(tmp_path / name)
        assert raised.value.code == "output-no-file"
        assert str(tmp_path / name) in raised.value.what
        unchanged()


@pytest.mark.parametrize("companion", ["-journal", "-wal", "-shm"])
@pytest.mark.parametrize("kind", OBSTACLES)
def test_state__refuses_links_at_the_names_of_its_journals(companion: str, kind: str, tmp_path: Path) -> None:
    with obstacle(tmp_path / f"state.sqlite{companion}", kind) as unchanged:
        with pytest.raises(InputError, match=f"state.sqlite{companion}"):
            keep_state(tmp_path / "state.sqlite")
        unchanged()


@pytest.mark.parametrize("kind", OBSTACLES)
def test_create_new__nothing_may_have_the_name(kind: str, tmp_path: Path) -> None:
    with obstacle(tmp_path / "new", kind) as unchanged:
        with pytest.raises(FileExistsError):
            create(tmp_path / "new")
        unchanged()


@pytest.mark.parametrize("kind", OBSTACLES)
def test_promise_23__a_replaced_file_is_a_new_one(kind: str, tmp_path: Path) -> None:
    with obstacle(tmp_path / "a.json", kind) as unchanged:
        if "link" in kind and "to" not in kind:
            replace(tmp_path / "a.json")
            assert (tmp_path / "a.json").read_text() == "new"
            assert not (tmp_path / "a.json").is_symlink()
        else:
            with pytest.raises(InputError, match=r"a\.json"):
                replace(tmp_path / "a.json")
        unchanged()


def test_promise_23__name_of_an_unfinished_file_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    guesses = iter(["00000000", "00000001"])
    monkeypatch.setattr("secrets.token_hex", lambda _: next(guesses))
    with atomic_output(tmp_path / "a.json") as first:
        first.write_text("new")
        guessed = first.name
    guesses = iter(["00000000", "00000001"])
    with obstacle(tmp_path / guessed, "symbolic link") as unchanged:
        replace(tmp_path / "a.json")
        unchanged()
    assert (tmp_path / "a.json").read_text() == "new"


def test_append_to__appends_to_a_file_of_its_own(tmp_path: Path) -> None:
    append(tmp_path / "record.log")
    append(tmp_path / "record.log")
    assert (tmp_path / "record.log").read_bytes() == b"line\nline\n"
    refuse_shared(tmp_path / "record.log")


def test_append_to__missing_folder_is_an_error_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        append_to(tmp_path / "none" / "record.log")
