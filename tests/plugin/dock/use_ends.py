"""Runs inside the desktop QGIS (scripts/qgis_desktop.sh): every task of the dock with every cause of its end.

Arguments: folder with scripted_worker.py, folder with a result of a drive and its session, a session with every key,
folder for what it writes. What was seen is printed at the end as one line of JSON.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

WORKER, DRIVE, KEYS, OUT = (Path(word) for word in arguments)  # noqa: F821 - given by qgis_desktop.sh
sys.path.insert(0, str(WORKER.parent))

from desktop import click, current_page, drop, idle, page, plugin, tell, widget  # noqa: E402
from qgis.core import QgsApplication, QgsProject, QgsSettings  # noqa: E402

LIBC = ctypes.CDLL(None)
READ_ONLY, REMOUNT, BIND = 1, 32, 4096
SEEN: dict[str, Any] = {"ends": {}}
SESSION = DRIVE / "session.toml"
RESULT = DRIVE / "session_result"
CAUSES = ("own cancel", "task manager", "deaf and cancelled", "killed", "mute", "failed", "done")
WAYS = {"own cancel": "wait", "task manager": "wait", "deaf and cancelled": "deaf"}
os.environ["FURROWMAP_MACHINES"] = str(OUT / "machines")


def mounted(folder: Path) -> None:
    """Make a folder read-only, for root as well."""
    assert LIBC.mount(bytes(folder), bytes(folder), b"none", BIND, None) == 0
    assert LIBC.mount(b"none", bytes(folder), b"none", BIND | REMOUNT | READ_ONLY, None) == 0


def told(**more: Any) -> None:
    """Tell the worker how its commands end."""
    (WORKER.parent / "begun").unlink(missing_ok=True)
    (WORKER.parent / "ways.json").write_text(json.dumps(more))


def begun() -> bool:
    return (WORKER.parent / "begun").exists()


def fresh(name: str) -> Path:
    """A folder with a recording, which no session names yet."""
    folder = OUT / "fresh" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "gnss.nmea").write_text("$GPGGA\n")
    return folder


def answers(folder: Path) -> dict[str, Any]:
    """What the commands make and answer where they are done."""
    made = {"folder": str(RESULT), "products": ["report.json"], "figures": {}}
    return {
        "answers": {
            "init": {"session": str(folder / "session.toml"), "found": [], "missing": []},
            "run": made,
            "machine": {},
            "calibrate": {},
            "export": {"target": str(OUT / "x")},
            "share": {"start": str(OUT / "x")},
            "farm": {"sessions": 0},
        },
        "makes": {"init": {str(folder / "session.toml"): str(SESSION)}},
    }


def in_form() -> Iterator[Any]:
    plugin().dock.open_session(SESSION)
    yield page("session")


def on_result() -> Iterator[Any]:
    if current_page() != "result":
        plugin().dock.open_folder(RESULT)
        yield page("result")
        yield idle


def beginnings(folder: Path) -> dict[str, tuple[str, Callable[[], Iterator[Any]], Callable[[], Any]]]:
    """Of each task: the worker's command, how to get where it begins, and what begins it."""
    dock = plugin().dock

    def nowhere() -> Iterator[Any]:
        dock.show_start()
        yield

    not_simple = OUT / "inline" / "session.toml"
    not_simple.parent.mkdir(exist_ok=True)
    not_simple.write_text("furrowmap = 1\nantenna = { xyz_m = [1.0, 0.0, 1.0] }\n")

    def as_it_is() -> Iterator[Any]:
        dock.open_session(not_simple)
        yield

    return {
        "init": ("init", nowhere, lambda: drop(dock, [folder / "gnss.nmea"])),
        "run": ("run", in_form, lambda: dock.run_session(SESSION)),
        "run as it is": ("run", as_it_is, lambda: click("furrowmapStartRemedy")),
        "machine": ("machine", in_form, lambda: dock.save_machine(SESSION, "T 1")),
        "calibrate": ("calibrate", in_form, lambda: dock.calibrate(SESSION, "")),
        "export": ("export", on_result, lambda: dock.export("geojson", str(OUT / "x"))),
        "share": ("share", on_result, lambda: dock.share(str(OUT / "x"), qfield=True)),
        "farm": ("farm", on_result, lambda: dock.add_to_farm([RESULT], str(OUT / "farm.gpkg"))),
    }


def every_end() -> Iterator[Any]:
    import furrowmap.worker as protocol

    protocol.CANCEL_S = 0.3
    protocol.END_MS = 200
    dock = plugin().dock
    for number, cause in enumerate(CAUSES):
        folder = fresh(str(number))
        for name, (command, get_there, begin) in beginnings(folder).items():
            told(**{command: WAYS.get(cause, cause)}, **answers(folder))
            yield from get_there()
            begin()
            yield begun
            if "cancel" in cause:
                click("furrowmapCancel")
                assert current_page() != "run", (name, cause)
            elif cause == "task manager":
                QgsApplication.taskManager().cancelAll()
            yield idle
            yield lambda: current_page() != "run"
            SEEN["ends"][f"{name}: {cause}"] = [current_page(), dock._task is None, dock.batch.busy]
    yield from previews()
    yield from batches()


def previews() -> Iterator[Any]:
    dock = plugin().dock
    for cause in CAUSES:
        told(run=WAYS.get(cause, cause), answers={"run": {"folder": "", "products": [], "figures": {}}})
        yield from in_form()
        dock.preview_session(SESSION)
        yield begun
        if "cancel" in cause:
            dock.previewer.cancel()
        elif cause == "task manager":
            QgsApplication.taskManager().cancelAll()
        yield idle
        yield lambda: not dock.previewer.busy
        SEEN["ends"][f"preview: {cause}"] = [current_page(), dock._task is None, dock.batch.busy]


def batches() -> Iterator[Any]:
    """Two drives, of which the first ends in each way, while its session is made and while it runs."""
    dock = plugin().dock
    SEEN["drives"] = {}
    for number, cause in enumerate(CAUSES):
        for command in ("init", "run"):
            folders = [fresh(f"{number} {command} {k}") for k in range(2)]
            way = WAYS.get(cause, cause)
            told(**{"init": "done", "run": "done", command: way}, **answers(folders[0]))
            if command == "run" or cause == "done":
                for folder in folders:
                    shutil.copyfile(SESSION, folder / "session.toml")
            drop(dock, folders)
            yield begun
            if "cancel" in cause:
                click("furrowmapBatchCancel")
            elif cause == "task manager":
                QgsApplication.taskManager().cancelAll()
            yield idle
            yield lambda: not dock.batch.busy
            name = f"batch, {command}: {cause}"
            SEEN["ends"][name] = [current_page(), dock._task is None, dock.batch.busy]
            SEEN["drives"][name] = [[drive.state, drive.text] for drive in dock.batch.drives]


def beside_a_batch() -> Iterator[Any]:
    """While drives run no second worker starts, results are refused on dock and window, and ended drives open."""
    dock = plugin().dock
    folders = [fresh(f"beside {k}") for k in range(2)]
    for folder in folders:
        shutil.copyfile(SESSION, folder / "session.toml")
    shutil.copytree(RESULT, folders[0] / "session_result")
    os.utime(folders[0] / "session_result" / "report.json", (4e9, 4e9))
    told(run="wait")
    drop(dock, folders)
    yield begun
    asked = (WORKER.parent / "asked.jsonl").read_text()
    rows = widget("furrowmapBatch")
    SEEN["beside"] = {"rows": [rows.item(k).text() for k in range(2)]}
    rows.itemActivated.emit(rows.item(0))
    yield page("result")
    yield idle_steps
    SEEN["beside"]["opened"] = [current_page(), str(dock._folder.parent.name)]
    dock.export("geojson", str(OUT / "x"))
    dock.share(str(OUT / "x"), qfield=True)
    dock.add_to_farm([RESULT], str(OUT / "farm.gpkg"))
    dock.run_session(SESSION)
    dock.preview_session(SESSION)
    dock.calibrate(SESSION, "")
    SEEN["beside"]["page"] = current_page()
    for target in (dock, iface.mainWindow()):  # noqa: F821
        drop(target, [RESULT])
        yield
    SEEN["beside"]["after drops"] = [current_page(), dock._folder.parent.name]
    SEEN["beside"]["no other worker"] = (WORKER.parent / "asked.jsonl").read_text() == asked
    click("furrowmapDo_back")
    SEEN["beside"]["back"] = current_page()
    click("furrowmapBatchCancel")
    yield idle


def idle_steps() -> bool:
    return plugin().dock._steps is None


def read_only() -> Iterator[Any]:
    """Recordings on a locked card, and a session whose folder is read-only."""
    dock = plugin().dock
    card = OUT / "card"
    kept = OUT / "kept"
    for folder in (card, kept):
        folder.mkdir()
    (card / "drive").mkdir()
    (card / "drive" / "gnss.nmea").write_text("$GPGGA\n")
    (card / "known").mkdir()
    shutil.copyfile(SESSION, card / "known" / "session.toml")
    mounted(card)
    try:
        told(init="failed")
        drop(dock, [card / "drive"])
        yield
        SEEN["card"] = [
            current_page(),
            widget("furrowmapStartError").text(),
            widget("furrowmapStartRemedy").isVisible(),
        ]
        shot(f"{OUT}/card.png")  # noqa: F821
        dock.copy_recordings([card / "drive"], kept)
        yield lambda: (WORKER.parent / "begun").exists()
        yield idle
        SEEN["copied"] = sorted(str(path.relative_to(kept)) for path in kept.rglob("*"))
        asked = [json.loads(line) for line in (WORKER.parent / "asked.jsonl").read_text().splitlines()]
        SEEN["asked"] = asked[-1]
        told(run="failed")
        drop(dock, [card / "known" / "session.toml"])
        yield page("session")
        dock.run_session(card / "known" / "session.toml")
        yield
        yield
        fault = widget("furrowmapOutputFault")
        SEEN["read-only result"] = [current_page(), fault.text(), not fault.visibleRegion().isEmpty()]
        shot(f"{OUT}/output.png")  # noqa: F821
        widget("furrowmapOutput").setFilePath(str(OUT / "results"))
        click("furrowmapRun")
        yield begun
        yield idle
        asked = [json.loads(line) for line in (WORKER.parent / "asked.jsonl").read_text().splitlines()]
        SEEN["other folder"] = [word for word in asked[-1] if "--output" in word]
        widget("furrowmapAntenna0").setValue(1.5)
        click("furrowmapSave")
        yield
        SEEN["read-only session"] = [widget("furrowmapErrorText").text(), widget("furrowmapCopy").isVisible()]
    finally:
        assert LIBC.umount2(bytes(card), 0) == 0


def exact() -> Iterator[Any]:
    """Sessions with every key are saved as they are; a change is written in its line alone."""
    dock = plugin().dock
    SEEN["exact"] = {}
    for path in sorted(KEYS.glob("*.toml")):
        before = path.read_bytes()
        dock.open_session(path)
        yield
        assert current_page() == "session", (path, widget("furrowmapStartError").text())
        click("furrowmapSave")
        yield
        after = path.read_bytes()
        SEEN["exact"][path.name] = [after == before, widget("furrowmapFindings").text() if after != before else ""]
        if after != before:
            path.with_suffix(".saved").write_bytes(after)
            path.write_bytes(before)
            continue
        widget("furrowmapLidar1").setValue(1.25)
        click("furrowmapSave")
        yield
        lines = [path.read_bytes().split(b"\n"), before.split(b"\n")]
        changed = [pair for pair in zip(*lines, strict=True) if pair[0] != pair[1]]
        SEEN["exact"][path.name] += [[line.decode().strip() for line in pair] for pair in changed]


def not_simple() -> Iterator[Any]:
    """A session that the form cannot edit waits for the user."""
    asked = (WORKER.parent / "asked.jsonl").read_text()
    drop(plugin().dock, [OUT / "inline" / "session.toml"])
    yield
    shot(f"{OUT}/not_simple.png")  # noqa: F821
    words = widget("furrowmapStartError").text()
    SEEN["not simple"] = [current_page(), words, (WORKER.parent / "asked.jsonl").read_text() == asked]


def story() -> Iterator[Any]:
    QgsSettings().setValue("furrowmap/interpreter", str(WORKER))
    plugin().dock.show_start()
    yield
    for part in (exact, every_end, beside_a_batch, not_simple, read_only):
        yield from part()
        sys.stderr.write(f"{part.__name__} is told\n")
        QgsProject.instance().clear()
        yield


OUT.mkdir(parents=True, exist_ok=True)
tell(story(), SEEN, iface, leave)  # noqa: F821
