"""Every task of the dock with every cause of its end leaves a page to go on from; sessions are saved exactly."""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import furrowmap
from furrowmap.core.values.session import EXAMPLES
from furrowmap.workflows.share.qgis_plugin import write_plugin_zip
from tests.test_end_to_end import session_folder

if TYPE_CHECKING:
    from conftest import QgisRoot

HERE = Path(__file__).parent
TASKS = ("init", "run", "run as it is", "machine", "calibrate", "export", "share", "farm", "preview")
CAUSES = ("own cancel", "task manager", "deaf and cancelled", "killed", "mute", "failed", "done")
PAGES = {
    **dict.fromkeys(("init", "run as it is"), "start"),
    **dict.fromkeys(("run", "machine", "calibrate", "preview"), "session"),
    **dict.fromkeys(("export", "share", "farm"), "result"),
}
"""Where each task leads when it was cancelled or failed."""


def with_every_key(leave: tuple[str, ...] = ()) -> str:
    """A session with every key, each with a comment and with more digits than the form shows."""
    tables: dict[str, list[str]] = {}
    for name, example in EXAMPLES.items():
        table, _, key = name.rpartition(".")
        value = example if example.startswith('"') else re.sub(r"(?<=\.)(\d+)(?=[\],\s]|$)", r"\g<1>0371", example)
        if table not in leave:
            tables.setdefault(table, []).append(f"{key} = {value}   # of {name}")
    first = tables.pop("")
    return "\n".join(["furrowmap = 1", *first, *(f"\n[{t}]\n" + "\n".join(rows) for t, rows in tables.items())]) + "\n"


@pytest.fixture(scope="module")
def seen(
    qgis: QgisRoot,
    shared_data: Path,
    run_once: Callable[[str, Callable[[Path], Path]], furrowmap.Result],
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Any]:
    """What use_ends.py has seen."""
    result = run_once("tractor_loop", partial(session_folder, shared_data, "tractor_loop", truth=False))
    work = tmp_path_factory.mktemp("ends")
    drive = work / "drive"
    session_folder(shared_data, "tractor_loop", drive, truth=False)
    shutil.copytree(result.path, drive / "session_result")
    keys = work / "keys"
    keys.mkdir()
    (keys / "tractor.toml").write_text(with_every_key())
    (keys / "flight.toml").write_text(with_every_key(("implement",)), newline="\r\n")
    worker = worker_in(work / "worker")
    plugins = unpacked_plugin(work / "plugins")
    command = ("scripts/qgis_desktop.sh", plugins, HERE / "use_ends.py", worker, drive, keys, work / "out")
    told = qgis.run(*command, timeout_s=400)
    found: dict[str, Any] = json.loads(next(line for line in told.splitlines() if line.startswith("{")))
    return found


def worker_in(folder: Path) -> Path:
    """The scripted worker as a command, in a folder with what the stories import."""
    folder.mkdir()
    for name in ("scripted_worker.py", "desktop.py"):
        shutil.copyfile(HERE / name, folder / name)
    command = folder / "furrowmap"
    command.write_text(f'#!/bin/sh\nexec /usr/bin/python3 "{folder}/scripted_worker.py" "$@"\n')
    command.chmod(0o755)
    return command


def unpacked_plugin(folder: Path) -> Path:
    """A folder with the plugin as QGIS installs it."""
    folder.mkdir()
    write_plugin_zip(folder / "zip")
    with zipfile.ZipFile(folder / "zip") as archive:
        archive.extractall(folder)
    return folder


@pytest.mark.parametrize("cause", CAUSES)
def test_task__ended_by_anything_leaves_the_page_of_the_task_and_nothing_running(
    seen: dict[str, Any], cause: str
) -> None:
    for task in TASKS:
        page, free, batch = seen["ends"][f"{task}: {cause}"]
        assert (free, batch) == (True, False), task
        done = {"init": "session", "run": "result", "run as it is": "result"}
        assert page == (done.get(task, PAGES[task]) if cause == "done" else PAGES[task]), task


@pytest.mark.parametrize("command", ["init", "run"])
@pytest.mark.parametrize("cause", CAUSES)
def test_batch__ended_by_anything_tells_the_state_and_the_reason_of_each_drive(
    seen: dict[str, Any], command: str, cause: str
) -> None:
    name = f"batch, {command}: {cause}"
    assert seen["ends"][name] == ["drives", True, False]
    states = [state for state, _ in seen["drives"][name]]
    reasons = [text for _, text in seen["drives"][name]]
    if "cancel" in cause or cause == "task manager":
        assert states == ["cancelled"] * 2
    elif cause == "done":
        assert states == ["done"] * 2
    else:
        assert states == ["failed"] * 2
        assert all(len(text.splitlines()) == 3 for text in reasons)


def test_beside_a_batch__no_other_worker_starts_and_ended_drives_open(seen: dict[str, Any]) -> None:
    found = seen["beside"]
    assert found["rows"][0].startswith("✓ beside 0")
    assert found["rows"][1].startswith("▸ beside 1")
    assert found["opened"] == ["result", "beside 0"]
    assert found["no other worker"]
    assert found["page"] == "result"
    assert found["after drops"] == found["opened"], "refused on the dock and on the window"
    assert found["back"] == "drives"


def test_session__that_the_form_cannot_edit_waits_for_the_user(seen: dict[str, Any]) -> None:
    page, words, nothing_started = seen["not simple"]
    assert page == "start"
    assert "cannot edit line 2" in words
    assert nothing_started


def test_locked_card__is_copied_and_a_read_only_result_gets_another_folder(seen: dict[str, Any]) -> None:
    page, words, offered = seen["card"]
    assert (page, offered) == ("start", True)
    assert "read-only" in words
    assert seen["copied"] == ["drive", "drive/gnss.nmea"]
    assert seen["asked"][0] == "init"
    assert all("/kept/drive" in word for word in (seen["asked"][1], seen["asked"][-1]))
    page, words, visible = seen["read-only result"]
    assert (page, visible) == ("session", True)
    assert "read-only" in words
    assert [word.rpartition("/")[2] for word in seen["other folder"]] == ["results"]
    words, offered = seen["read-only session"]
    assert "cannot be written" in words
    assert offered


@pytest.mark.parametrize("name", ["tractor.toml", "flight.toml"])
def test_session_with_every_key__is_saved_byte_by_byte_but_for_what_is_edited(seen: dict[str, Any], name: str) -> None:
    same, _, *changed = seen["exact"][name]
    assert same
    (after, before) = changed[0]
    assert len(changed) == 1
    assert before == "xyz_m = [-0.550371, 0.00371, 2.350371]   # of lidar.xyz_m"
    assert after == before.replace("0.00371,", "1.25,")
