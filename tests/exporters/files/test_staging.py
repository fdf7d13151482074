"""A folder of products is the old one or the new one, whatever interrupts the work."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.exporters.files import atomic
from furrowmap.exporters.files import staging as staging_module
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.lease import leases
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.plugin.products import product

NAMES = ("cloud.copc.laz", "field.gpkg", "report.json")


def write(folder: Path, content: str, names: tuple[str, ...] = NAMES) -> None:
    with staged_folder(folder) as staging:
        for name in names:
            text = json.dumps({"products": names, "content": content}) if name == "report.json" else content
            (staging / name).write_text(text)


def contents(folder: Path) -> set[str]:
    return {json.loads(text)["content"] if text.startswith("{") else text for text in texts(folder).values()}


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def test_products_take_their_places_together_and_foreign_files_stay(tmp_path: Path) -> None:
    folder = tmp_path / "ü 圃場 'x'"
    write(folder, "old")
    (folder / "notes.txt").write_text("old")
    write(folder, "new")
    assert texts(folder).keys() == {*NAMES, "notes.txt"}
    assert (folder / "notes.txt").read_text() == "old"
    (folder / "notes.txt").unlink()
    assert contents(folder) == {"new"}


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="reads the names of open files")
def test_all_products_are_on_the_disk_once_before_they_are_declared_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: list[str] = []
    to_disk = os.fsync

    def noted(descriptor: int) -> None:
        flushed.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        to_disk(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    with staged_folder(tmp_path / "out") as staging:
        (staging / "dsm.tif").write_text("height")
        (staging / "frames").mkdir()
        for name in ("report.json", "frames/1.jpg"):
            with atomic_output(staging / name) as unfinished:
                unfinished.write_text("whole")
        lease = staging.parent.name
    assert sorted(flushed[:5]) == ["1.jpg", "dsm.tif", "frames", "products", "report.json"]
    assert flushed[5:] == ["complete.json.part", lease, "out"]


def test_a_product_without_successor_goes(tmp_path: Path) -> None:
    write(tmp_path / "out", "old", (*NAMES, "dsm.tif"))
    write(tmp_path / "out", "new")
    assert texts(tmp_path / "out").keys() == set(NAMES)


def test_products_in_folders_below__stay_or_go_by_the_list_of_the_report(tmp_path: Path) -> None:
    def put(written: tuple[str, ...], listed: tuple[str, ...]) -> None:
        with staged_folder(tmp_path) as staging:
            for name in written:
                (staging / name).parent.mkdir(parents=True, exist_ok=True)
                (staging / name).write_text("new")
            (staging / "report.json").write_text(json.dumps({"products": listed}))

    first = ("points/date=1/a.parquet", "points/date=2/b.parquet", "points/date=2/c.parquet")
    put(first, first)
    (tmp_path / "points/date=2/b.parquet").write_text("kept")
    (tmp_path / "notes.txt").write_text("mine")
    put(("points/date=3/d.parquet",), ("points/date=3/d.parquet", "points/date=2/b.parquet", "../x", "/etc/hosts"))
    left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert left == {
        "points", "points/date=2", "points/date=3", "points/date=2/b.parquet", "points/date=3/d.parquet",
        "report.json", "notes.txt",
    }  # fmt: skip
    assert (tmp_path / "points/date=2/b.parquet").read_text() == "kept"


def test_a_link_in_the_way_to_a_product_is_not_followed(tmp_path: Path) -> None:
    folder, other = tmp_path / "out", tmp_path / "other"
    (other / "date=1").mkdir(parents=True)
    folder.mkdir()
    (folder / "points").symlink_to(other)
    with pytest.raises(InputError, match="is no folder"), staged_folder(folder) as staging:
        (staging / "points" / "date=1").mkdir(parents=True)
        (staging / "points" / "date=1" / "a.parquet").write_text("new")
    assert not list((other / "date=1").iterdir())


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_an_interruption_leaves_the_old_products_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    write(tmp_path / "out", "old")
    with pytest.raises(error), staged_folder(tmp_path / "out") as staging:
        (staging / "cloud.copc.laz").write_text("half")
        raise error
    assert contents(tmp_path / "out") == {"old"}
    assert not leases(tmp_path / "out")


def test_an_interruption_takes_a_new_folder_with_it(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), staged_folder(tmp_path / "out"):
        raise KeyboardInterrupt
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(os.name == "nt", reason="kills a process")
@pytest.mark.parametrize("delay_s", [0.0, 0.002, 0.004, 0.008, 0.015, 0.03])
def test_a_killed_run_leaves_old_or_new_after_recovery(tmp_path: Path, delay_s: float) -> None:
    write(tmp_path, "old")
    program = (
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\n"
        "from tests.exporters.files.test_staging import write\n"
        "print('go', flush=True)\n"
        "while True: write(Path(sys.argv[1]), 'new')\n"
    )
    root = Path(__file__).parents[3]
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path), str(root)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(delay_s)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    recover(tmp_path)
    assert contents(tmp_path) in ({"old"}, {"new"})
    assert texts(tmp_path).keys() == set(NAMES)


@pytest.mark.skipif(os.name == "nt", reason="kills a process")
@pytest.mark.parametrize("account", ["report.json", "surfaces.json", "provenance.json"])
def test_promise_20__a_kill_between_two_renamings_is_made_up_for(tmp_path: Path, account: str) -> None:
    names = ["dsm.tif", account]
    (tmp_path / account).write_text(json.dumps({"products": [*names, "low_spots.gpkg"]}))
    (tmp_path / "low_spots.gpkg").write_text("old")
    program = (
        "import json, os, sys; from pathlib import Path\n"
        "from furrowmap.exporters.files.staging import staged_folder\n"
        "rename = Path.replace\n"
        "def killed(path, target):\n"
        "    if path.name == sys.argv[-1]: os.kill(os.getpid(), 9)\n"
        "    return rename(path, target)\n"
        "Path.replace = killed\n"
        "with staged_folder(Path(sys.argv[1])) as staging:\n"
        "    for name in sys.argv[2:]: (staging / name).write_text(json.dumps({'products': sys.argv[2:]}))\n"
    )
    assert subprocess.run([sys.executable, "-c", program, str(tmp_path), *names], check=False).returncode == -9
    assert texts(tmp_path)[account] != json.dumps({"products": names}), "the kill came too late"
    for name in names:  # QGIS sees the new products, although not all are in their places
        assert json.loads(product(tmp_path, name).read_text()) == {"products": names}
    assert not product(tmp_path, "low_spots.gpkg").exists()
    recover(tmp_path)
    assert texts(tmp_path).keys() == set(names)


def test_a_folder_that_is_a_file_is_an_error_in_three_lines(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError) as caught:
        write(tmp_path / "out", "new")
    assert len(str(caught.value).splitlines()) == 3


def test_promise_19__a_folder_with_the_name_of_a_product_leaves_all_as_it_was(tmp_path: Path) -> None:
    write(tmp_path, "old")
    (tmp_path / "dsm.tif").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write(tmp_path, "new", (*NAMES, "dsm.tif"))
    assert contents(tmp_path) == {"old"}
    assert not leases(tmp_path)


def test_promise_19__a_file_with_the_name_of_a_folder_of_products_leaves_all_as_it_was(tmp_path: Path) -> None:
    write(tmp_path, "old")
    (tmp_path / "tiles").write_text("a file")
    with pytest.raises(InputError, match="tiles is no folder") as caught, staged_folder(tmp_path) as products:
        (products / "tiles").mkdir()
        (products / "tiles" / "1.tif").write_text("new")
    assert caught.value.lines[1] == "The products in the folder of that name cannot be written."
    assert (tmp_path / "tiles").read_text() == "a file"
    assert contents(tmp_path) == {"old", "a file"}
    assert not leases(tmp_path)


def test_recovery__of_a_folder_that_is_not_there_is_none(tmp_path: Path) -> None:
    recover(tmp_path / "gone")
    assert not (tmp_path / "gone").exists()


class HeldFiles:
    """Files that another program has open as Windows sees it: neither they nor others in their place are renamed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.held: set[Path] = set()
        self.refused = 0
        for name in ("rename", "replace"):
            monkeypatch.setattr(Path, name, self._renaming(getattr(Path, name)))

    def _renaming(self, rename: Callable[[Path, Path], Path]) -> Callable[[Path, Path], Path]:
        def renamed(path: Path, target: Path) -> Path:
            if {path, target} & self.held:
                self.refused += 1
                raise PermissionError(13, "The process cannot access the file", str(path), 32, str(target))
            return rename(path, target)

        return renamed


def test_a_product_open_in_another_program__leaves_all_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, "old")
    files = HeldFiles(monkeypatch)
    files.held = {tmp_path / "field.gpkg"}
    with pytest.raises(RefusedError, match=r"field\.gpkg is open in another program") as error:
        write(tmp_path, "new")
    assert error.value.lines[1] == "It cannot be replaced; all files are as they were."
    assert contents(tmp_path) == {"old"}
    assert not leases(tmp_path)
    with pytest.raises(RefusedError, match=r"field\.gpkg is open"):  # before the work
        refuse_products(tmp_path, NAMES, overwrite=True)
    with (
        pytest.raises(RefusedError, match=r"field\.gpkg is open"),
        atomic_output(tmp_path / "field.gpkg") as unfinished,
    ):
        unfinished.write_text("new")
    files.held.clear()
    write(tmp_path, "new")
    assert contents(tmp_path) == {"new"}


def test_a_product_opened_at_the_last_moment__the_next_command_puts_the_new_ones_in_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, "old")
    files = HeldFiles(monkeypatch)
    flushed = staging_module.flush_folder

    def opened(folder: Path) -> None:
        files.held = {tmp_path / "field.gpkg"}
        flushed(folder)

    monkeypatch.setattr(staging_module, "flush_folder", opened)
    with pytest.raises(RefusedError, match="new products are complete"):
        write(tmp_path, "new")
    monkeypatch.setattr(staging_module, "flush_folder", flushed)
    for name in NAMES:
        assert "new" in product(tmp_path, name).read_text()
    with pytest.raises(RefusedError, match="new products are complete"):
        recover(tmp_path)
    files.held.clear()
    recover(tmp_path)
    assert contents(tmp_path) == {"new"}
    assert not leases(tmp_path)


def test_a_product_held_for_a_moment__is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = HeldFiles(monkeypatch)
    files.held = {tmp_path / "a.txt"}
    monkeypatch.setattr(atomic, "_HELD_S", 60.0)
    monkeypatch.setattr(atomic.time, "sleep", lambda _: files.held.clear())
    with atomic_output(tmp_path / "a.txt") as unfinished:
        unfinished.write_text("new")
    assert (files.refused, (tmp_path / "a.txt").read_text()) == (1, "new")
