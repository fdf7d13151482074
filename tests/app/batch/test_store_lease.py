"""Leases in a store: writers of one result, at the same moment, after one that died, and one that was given up."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.exporters.files.batch_state import SessionOutcome
from furrowmap.exporters.files.lease import PREFIX
from furrowmap.workflows.batch import batch
from furrowmap.workflows.batch import object_stores as places
from furrowmap.workflows.batch.object_stores import MARKER, Store

pytest.importorskip("fsspec")


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in (("STORE_BEAT_S", 0.01), ("MAX_STORE_SILENCE_S", 0.3), ("_LOOK_AGAIN_S", 0.02)):
        monkeypatch.setattr(places, name, seconds)
    monkeypatch.setattr(batch, "_LOOK_S", 0.02)


def result(folder: Path, writer: str) -> Path:
    """Products that each name their writer."""
    folder = folder / writer
    folder.mkdir()
    for k in range(5):
        (folder / f"{k}.txt").write_text(writer, encoding="utf-8")
    return folder


def writers(url: str) -> set[str]:
    """Who wrote the files of a result."""
    store = Store(url)
    return {(store.read(name) or b"").decode() for name in store.files() if name.endswith(".txt")}


def test_writers_at_the_same_moment__never_mix_their_products(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url, put = "memory://leases/north", Store.put
    at_once, most = 0, 0

    def slow(store: Store, folder: Path) -> None:
        nonlocal at_once, most
        at_once += 1
        most = max(most, at_once)
        put(store, folder)
        time.sleep(0.05)
        at_once -= 1

    monkeypatch.setattr(Store, "put", slow)
    folders = [result(tmp_path, f"host {k}") for k in range(4)]
    outcomes = [SessionOutcome(f"key {k}", ()) for k in range(4)]
    threads = [
        threading.Thread(target=batch._put, args=(folder, url, outcome))
        for folder, outcome in zip(folders, outcomes, strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    (writer,) = writers(url)
    assert f"key {writer.split()[1]}".encode() in (Store(url).read(MARKER) or b"")
    assert sorted(Store(url).files()) == [*(f"{k}.txt" for k in range(5)), MARKER]


def test_lease_of_a_writer_that_died__is_taken_over(tmp_path: Path) -> None:
    url = "memory://leases/dead"
    Store(url).write(f"{PREFIX}{'0' * 16}", b"writes 000000007 south")
    batch._put(result(tmp_path, "north"), url, SessionOutcome("key", ()))
    assert writers(url) == {"north"}
    assert MARKER in Store(url).files()


def test_writer_whose_lease_was_removed__writes_no_marker() -> None:
    store = Store("memory://leases/lost")
    with store.held() as expect_held:
        expect_held()
        (lease,) = store.files()
        system, root = store._opened()
        system.rm_file(f"{root}/{lease}")
        with pytest.raises(RefusedError) as lost:
            expect_held()
    assert lost.value.code == "output-lost"


def test_writer_beside_one_that_writes__is_refused_with_the_host() -> None:
    store = Store("memory://leases/busy")
    with store.held(), pytest.raises(RefusedError, match="another run") as busy, store.held():
        pass
    assert busy.value.code == "output-busy"
