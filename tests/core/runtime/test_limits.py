"""What is refused of foreign files, and what a user may allow; with bombs of every kind that is unpacked."""

from __future__ import annotations

import gzip
import io
import lzma
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from furrowmap.cli.main import attempt
from furrowmap.core.implement.saved import load_implement
from furrowmap.core.readers.isoxml.content import open_task_sets
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime import memory
from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError, UsageError
from furrowmap.core.runtime.memory import expect_disk, expect_memory, free_memory_bytes
from furrowmap.core.runtime.npz import read_npz
from furrowmap.core.runtime.settings import ALLOW_VARIABLE, allowing, allows
from tests.fuzz.positions import nmea

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


CONTENT = nmea() * 10_000


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bombs of a few megabytes, so that the tests are quick; the rule is the same."""
    monkeypatch.setattr(memory, "FREE_BYTES", 1 << 20)
    monkeypatch.setattr(memory, "MAX_GROWTH", 10)


def test_allowances__by_what_surrounds_or_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ALLOW_VARIABLE, raising=False)
    assert not allows("large")
    with allowing("large"), allowing("damaged"):
        assert allows("large")
        assert allows("damaged")
    assert not allows("damaged")
    monkeypatch.setenv(ALLOW_VARIABLE, "damaged, large")
    assert allows("large")
    monkeypatch.setenv(ALLOW_VARIABLE, "everything")
    with pytest.raises(UsageError, match="'everything'"):
        allows("large")


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress, zstd.compress], ids=["gz", "xz", "zst"])
def test_promise_10__a_stream_that_grows_without_end_is_refused(pack, tmp_path: Path, small: None) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "recording.nmea.packed"
    path.write_bytes(pack(CONTENT))
    with Source(path) as source, pytest.raises(RefusedError, match=r"(?s)unpack to .*--allow-large") as error:
        source.read()
    assert (error.value.exit_status, error.value.code) == (4, "too-large")
    with allowing("large"), Source(path) as source:
        assert len(source.read()) == len(CONTENT)
    status, refused = attempt(["inspect", str(path), "--json", "-q"])
    assert status == 4
    assert refused is not None
    assert refused.code == "too-large"


def test_promise_10__a_zip_or_npz_that_grows_without_end_is_refused(tmp_path: Path, small: None) -> None:
    for name, member in (("taskdata.zip", "TASKDATA.XML"), ("implement.npz", "form.npy")):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(member, bytes(30 << 20))
    for read, name in (
        (open_task_sets, "taskdata.zip"),
        (read_npz, "implement.npz"),
        (load_implement, "implement.npz"),
    ):
        with pytest.raises(RefusedError, match=r"(?s)unpack to 31\.5 MB.*--allow-large"):
            read(tmp_path / name)


def test_promise_10__an_array_that_claims_more_than_its_data_takes_no_memory(tmp_path: Path) -> None:
    data = io.BytesIO()
    np.lib.format.write_array_header_1_0(data, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "implement.npz", "w") as archive:
        archive.writestr("form.npy", data.getvalue() + bytes(80))
    with pytest.raises(ValueError, match=r"form\.npy"):
        read_npz(tmp_path / "implement.npz")
    with pytest.raises(InputError):
        load_implement(tmp_path / "implement.npz")


def test_npz__is_read_as_numpy_writes_it(tmp_path: Path) -> None:
    arrays = {"a": np.arange(24.0).reshape(2, 3, 4), "b": np.asfortranarray(np.eye(3, dtype="<i2")), "c": np.int64(5)}
    np.savez_compressed(tmp_path / "some.npz", **arrays)
    found = read_npz(tmp_path / "some.npz")
    assert all(np.array_equal(found[name], value) for name, value in arrays.items())
    np.savez(tmp_path / "objects.npz", a=np.array([{}], object))
    with pytest.raises(ValueError, match=r"a\.npy"):
        read_npz(tmp_path / "objects.npz")


def test_promise_10__no_file_takes_more_than_half_of_what_is_free(tmp_path: Path) -> None:
    free = free_memory_bytes()
    assert free > memory.FREE_BYTES
    for expect in (lambda: expect_memory("x", 2 * free), lambda: expect_disk("x", tmp_path, 1 << 60)):
        with pytest.raises(RefusedError) as error:
            expect()
        assert isinstance(error.value, FurrowmapError)
        with allowing("large"):
            expect()
