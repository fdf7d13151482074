"""A failed write names the file and the free space, whichever library hides what the system said."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from pyogrio.errors import DataSourceError
from rasterio.errors import RasterioIOError

from furrowmap.cli.main import command_line
from furrowmap.core.runtime import write_errors
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.record_spool import RecordSpool
from furrowmap.core.runtime.settings import using
from furrowmap.core.runtime.write_errors import (
    WriteError,
    as_furrowmap_error,
    failed_write,
    free_bytes,
    scratch_directory,
    shown_path,
    temporary_elsewhere,
    writing,
    writing_scratch,
)

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
QUOTA = OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))
HIDDEN = (
    RasterioIOError("TIFFAppendToStrip:Write error at scanline 1: No space left on device"),
    DataSourceError("sqlite3_exec(COMMIT) failed: database or disk is full"),
    sqlite3.OperationalError("database or disk is full"),
    laspy.LaspyException("No space left on device (os error 28)"),
    OSError("4000 requested and 0 written: not enough free space"),
)


@pytest.mark.parametrize("error", [FULL, QUOTA, *HIDDEN], ids=lambda error: f"{type(error).__name__}-{error}"[:40])
def test_promise_19__error_names_the_file_and_the_free_space(error: Exception, tmp_path: Path) -> None:
    with pytest.raises(WriteError) as raised, writing(tmp_path / "dsm.tif", 2_000_000):
        raise error
    said = raised.value
    assert said.code == "not-written"
    assert said.what.startswith(f"{tmp_path / 'dsm.tif'} cannot be written: the disk is full (")
    assert said.what.endswith(" free, 2 MB needed).")
    assert "Free space there" in said.remedy
    assert said.exit_status == 1


@pytest.mark.parametrize("number", [errno.EROFS, errno.EFBIG, errno.EIO, errno.ENAMETOOLONG, errno.EACCES])
def test_promise_19__other_failed_writes_say_what_the_system_says(number: int, tmp_path: Path) -> None:
    with pytest.raises(WriteError) as raised, writing(tmp_path / "dsm.tif"):
        raise OSError(number, os.strerror(number), str(tmp_path / ".furrowmap-0-1.tif"))
    assert f"dsm.tif cannot be written: {os.strerror(number)} (" in raised.value.what
    assert "permissions" in raised.value.remedy


def test_writing__leaves_errors_of_other_files_as_they_are(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), writing(tmp_path / "a.tif"):
        raise ZeroDivisionError
    with pytest.raises(FileNotFoundError) as named, writing(tmp_path / "a.tif"):
        (tmp_path / "gone").read_text()
    assert named.value.filename == str(tmp_path / "gone")
    with pytest.raises(PermissionError), writing(tmp_path / "a.tif"):
        raise PermissionError(errno.EACCES, "no", "input.las")


@pytest.mark.parametrize("error", [FULL, *HIDDEN])
def test_unfinished_file__is_told_by_the_name_that_it_gets(error: Exception, tmp_path: Path) -> None:
    unfinished = writing(tmp_path / ".furrowmap-0-1.gpkg")
    with (
        pytest.raises(WriteError, match=r"fields.gpkg cannot be written"),
        writing(tmp_path / "fields.gpkg"),
        unfinished,
    ):
        raise error


def test_copy__names_what_is_written_not_what_is_read(tmp_path: Path) -> None:
    error = OSError(errno.ENOSPC, "full", "source.laz", None, str(tmp_path / "copy.laz"))
    assert str(tmp_path / "copy.laz") in as_furrowmap_error(error).what
    assert "source.laz" not in as_furrowmap_error(error).what


@pytest.mark.parametrize("kind", [RuntimeError, ValueError])
def test_cause__of_a_library_s_error_is_found(kind: type[Exception], tmp_path: Path) -> None:
    error = kind("something failed")
    assert as_furrowmap_error(error).code == "fault"
    error.__cause__ = FULL
    assert failed_write(error, tmp_path) is FULL
    assert as_furrowmap_error(error).key == "not-written.somewhere"


def _spool(folder: Path) -> None:
    with RecordSpool(np.dtype(np.int64), folder) as spool:
        spool.add(np.arange(10), np.zeros(10, np.int64))


def _directory(_: Path) -> None:
    with scratch_directory():
        pass


@pytest.mark.parametrize("use", [_spool, _directory])
def test_scratch_folder__that_is_gone_is_named(
    use: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write_errors.tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(WriteError, match="gone"):
        use(tmp_path / "gone")


def test_scratch_file__in_the_output_s_folder_names_that(tmp_path: Path) -> None:
    hidden = tmp_path / "result" / ".furrowmap-run-0" / "products"
    with using(scratch_folder=hidden), pytest.raises(WriteError) as raised, writing_scratch(3_000):
        raise FULL
    assert f"{tmp_path / 'result'} cannot be written: the disk is full (" in raised.value.what
    assert ".furrowmap" not in str(raised.value)
    with pytest.raises(PermissionError), writing_scratch():
        raise PermissionError(errno.EACCES, "no", "input.las")


def test_no_folder_for_temporary_files__is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found")

    monkeypatch.setattr(write_errors.tempfile, "gettempdir", none)
    with pytest.raises(WriteError, match="TMPDIR"):
        _directory(Path())


def test_library_s_error__counts_as_that_of_a_full_disk_where_none_is_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    error = rasterio.errors.RasterioError("CPLE_AppDefined")
    assert failed_write(error, tmp_path) is None
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=0))
    assert failed_write(error, tmp_path) is error
    assert failed_write(FurrowmapError("out-of-memory"), tmp_path) is None
    with pytest.raises(WriteError, match="the disk is full"), writing(tmp_path / "a.tif"):
        raise error


def test_paths__are_shown_without_the_hidden_folders_of_a_run(tmp_path: Path) -> None:
    run = tmp_path / "out" / ".furrowmap-run-0-1-2-3"
    assert shown_path(run / "products" / "pages" / "a.html") == tmp_path / "out" / "pages" / "a.html"
    assert shown_path(run) == tmp_path / "out"
    assert shown_path(tmp_path / "a.html") == tmp_path / "a.html"


def test_free_space__is_that_of_the_next_folder_that_exists(tmp_path: Path) -> None:
    assert free_bytes(tmp_path / "a" / "b.tif") == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.2)


def test_temporary_files__that_go_elsewhere_than_the_environment_states_are_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to(tmp_path)
    for name in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.delenv(name, raising=False)
    for folder, is_told in (("none", True), ("file", True), ("", False), ("link", False)):
        monkeypatch.setenv("TEMP", str(tmp_path / folder))
        monkeypatch.setattr(tempfile, "tempdir", None)
        assert temporary_elsewhere() is None
        with scratch_directory() as made:
            assert command_line(["explain", "fault"]) == 0
        told = capsys.readouterr().err
        assert (str(made.parent) in told and str(tmp_path / folder) in told and "TEMP" in told) is is_told
