"""Compiled kernels are kept per user and by their sources, and the user hears when they are made."""

from __future__ import annotations

import gc
import os
import platform
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest

from furrowmap.core.runtime.imports import importing
from furrowmap.kernel_cache import source_text, sources_digest
from furrowmap.process import CACHE_VARIABLE, keep_blas_single, keep_collections_rare, keep_kernels

CODE = """
import os, sys
sys.path.insert(0, sys.argv[1])
from furrowmap.core.runtime.imports import importing
from furrowmap.process import keep_kernels
keep_kernels()
from furrowmap.warm_up import reporting_compilation
with reporting_compilation(print, None):
    import kernels_to_compile
    kernels_to_compile.double(1.0)
    kernels_to_compile.double(1)
"""
KERNEL = "from numba import njit\n@njit(cache=True)\ndef double(x):\n    return 2 * x\n"


def test_folder__is_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.delenv(CACHE_VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    keep_kernels()
    assert os.environ[CACHE_VARIABLE] == str(tmp_path / "furrowmap" / "kernels")


def test_folder_already_set__is_respected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, "mine")
    keep_kernels()
    assert os.environ[CACHE_VARIABLE] == "mine"


def test_sources__of_a_kernel_are_its_module_and_all_that_it_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = {
        "furrowmap.a_kernel": "from furrowmap.a_helper import (\n    helper,\n)\n",
        "furrowmap.a_helper": "from furrowmap import a_constant\n",
        "furrowmap.a_constant": "K = 1\n",
        "furrowmap.another": "",
    }

    def digest(folder: str, **changed: str) -> str:
        for name, text in texts.items():
            module = types.ModuleType(name)
            file = tmp_path / folder / f"{name}.py"
            file.parent.mkdir(exist_ok=True)
            file.write_text(changed.get(name.partition(".")[2], text))
            module.__file__ = str(file)
            monkeypatch.setitem(sys.modules, name, module)
        sources_digest.cache_clear()
        source_text.cache_clear()
        return sources_digest("furrowmap.a_kernel")

    first = digest("here")
    assert digest("elsewhere") == digest("here", another="x = 2\n") == first
    assert digest("here", a_constant="K = 2\n") != first


def test_sources__that_moved_have_kernels_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """numba imports the module of a kernel that it loads, by the name that it had when the kernel was compiled."""
    digests = set()
    for name in ("furrowmap.a_room.a_kernel", "furrowmap.another_room.a_kernel"):
        module = types.ModuleType(name)
        file = tmp_path / f"{name}.py"
        file.write_text("K = 1\n")
        module.__file__ = str(file)
        monkeypatch.setitem(sys.modules, name, module)
        digests.add(sources_digest(name))
    assert len(digests) == 2


def test_no_place_to_write__serves_this_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cache").write_text("a file where a folder should be")
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.delenv(CACHE_VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    keep_kernels()
    assert Path(os.environ[CACHE_VARIABLE]).parent == tmp_path
    assert Path(os.environ[CACHE_VARIABLE]).is_dir()


@pytest.mark.skipif(sys.platform == "win32", reason="there, the profile of a user is private")
@pytest.mark.parametrize("mode", [0o777, 0o775, 0o755])
def test_promise_23__no_other_user_can_write_what_is_unpickled(
    mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """numba unpickles kernels: their folder is taken from all others, whatever it was made with."""
    folder = tmp_path / "furrowmap" / "kernels"
    folder.mkdir(parents=True)
    for made in (folder, folder.parent):
        made.chmod(mode)
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    keep_kernels()
    assert os.environ[CACHE_VARIABLE] == str(folder)
    assert {made.stat().st_mode & 0o777 for made in (folder, folder.parent)} == {0o700}


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("planted", ["furrowmap", "furrowmap/kernels"])
def test_promise_23__kernels_that_another_user_has_planted_are_not_unpickled(
    planted: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a cache folder that users share, as XDG_CACHE_HOME=/tmp makes it."""
    (tmp_path / "furrowmap" / "kernels").mkdir(parents=True)
    os.chown(tmp_path / planted, 65534, 65534)
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    keep_kernels()
    found = Path(os.environ[CACHE_VARIABLE])
    assert found.parent == tmp_path
    assert found.stat().st_mode & 0o777 == 0o700


def test_compilation__is_reported_once_and_only_when_it_happens(tmp_path: Path) -> None:
    (tmp_path / "kernels_to_compile.py").write_text(KERNEL)
    environment = {name: value for name, value in os.environ.items() if name != CACHE_VARIABLE}

    def run() -> str:
        return subprocess.run(
            [sys.executable, "-c", CODE, tmp_path],
            env=environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    assert re.fullmatch(r"Compiling kernels for this machine, once: up to \d+ s\. furrowmap warm-up .*\n", run())
    assert run() == ""


@pytest.mark.parametrize(("stated", "kept"), [(None, "1"), ("4", "4")])
def test_blas__has_one_thread_unless_the_user_says_otherwise(
    stated: str | None, kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", stated or "")
    if stated is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    keep_blas_single()
    assert os.environ["OPENBLAS_NUM_THREADS"] == kept


def test_command__says_so_before_numpy_is_there(tmp_path: Path) -> None:
    code = (
        "import os, sys; from furrowmap import process\n"
        "single = process.keep_blas_single\n"
        "process.keep_blas_single = lambda: (print('numpy' in sys.modules), single())\n"
        f"from furrowmap.cli.main import command_line; command_line(['run', {str(tmp_path / 'none.toml')!r}])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "False\n"


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries than glibc have no mallopt")
def test_freed_memory__is_used_again() -> None:
    code = """
import resource, sys
import numpy as np
from furrowmap.core.runtime.imports import importing
from furrowmap.process import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(200):
    held = [np.ones(300_000, np.uint8) for _ in range(10)]
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - faults)
"""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    kept, given_back = (
        int(subprocess.run([sys.executable, "-c", code, how], env=environment, capture_output=True, check=True).stdout)
        for how in ("kept", "given back")
    )
    assert kept < 0.2 * given_back


def test_garbage_collection__is_rare_and_never_more_frequent_than_the_user_wants() -> None:
    before = gc.get_threshold()
    try:
        gc.set_threshold(700, 10, 10)
        keep_collections_rare()
        assert gc.get_threshold()[0] == 5_000
        gc.set_threshold(50_000)
        keep_collections_rare()
        assert gc.get_threshold()[0] == 50_000
    finally:
        gc.set_threshold(*before)


def test_imports__leave_garbage_collection_as_it_was() -> None:
    gc.enable()
    with importing():
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0
    with pytest.raises(ImportError), importing():
        raise ImportError
    assert gc.isenabled()
    gc.unfreeze()
