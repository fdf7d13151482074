"""Free and peak memory, on the platform of the tests and as far as possible on others."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.runtime.memory import (
    MemoryCounters,
    MemoryStatus,
    available_of_vm_stat,
    free_memory_bytes,
    peak_memory_bytes,
)

VM_STAT = b"""Mach Virtual Memory Statistics: (page size of 16384 bytes)
Pages free:                                3632.
Pages active:                            190466.
Pages inactive:                          188213.
Pages speculative:                         1510.
Pages throttled:                              0.
Pages wired down:                         91340.
"Translation faults":                 187563541.
Pages purgeable:                            511.
Pages stored in compressor:              421210.
"""
"""As macOS 14 prints it on a computer with Apple silicon."""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no such limit")
def test_free_memory__is_what_a_limit_of_the_process_leaves() -> None:
    import resource

    had = resource.getrlimit(resource.RLIMIT_AS)
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limit = held + (200 << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, had[1]))
    try:
        left = free_memory_bytes()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, had)
    assert left == pytest.approx(200 << 20, abs=32 << 20)
    assert free_memory_bytes() > left


def test_peak__grows_with_an_array() -> None:
    before = peak_memory_bytes()
    array = np.ones((64 << 20) // 8)
    assert peak_memory_bytes() > before + (32 << 20) or before > array.nbytes * 2
    assert free_memory_bytes() > 0


def test_vm_stat__free_inactive_and_speculative_pages_are_available() -> None:
    assert available_of_vm_stat(VM_STAT) == 16384 * (3632 + 188213 + 1510)
    for text in (b"", VM_STAT.replace(b"page size of 16384 bytes", b""), VM_STAT[:60]):
        with pytest.raises(ValueError, match="vm_stat"):
            available_of_vm_stat(text)


@pytest.mark.parametrize(
    ("printed", "free"), [(VM_STAT, 16384 * (3632 + 188213 + 1510)), (b"no such words", 4 << 30), (None, 4 << 30)]
)
def test_macos__asks_vm_stat_and_has_no_proc(printed: bytes | None, free: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def vm_stat(program: str, **_: object) -> subprocess.CompletedProcess[bytes]:
        assert program == "/usr/bin/vm_stat"
        if printed is None:
            raise FileNotFoundError
        return subprocess.CompletedProcess(program, 0, printed)

    def no_proc(*_: object, **__: object) -> str:
        raise FileNotFoundError

    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(subprocess, "run", vm_stat)
    monkeypatch.setattr(Path, "read_text", no_proc)
    monkeypatch.delattr(os, "sysconf")
    assert free_memory_bytes() == free


def test_peak__is_reported_in_bytes_on_macos(monkeypatch: pytest.MonkeyPatch) -> None:
    linux = peak_memory_bytes()
    monkeypatch.setattr(sys, "platform", "darwin")
    assert peak_memory_bytes() * 1024 == pytest.approx(linux, rel=0.1)


def test_peak__is_unknown_where_python_has_no_resource(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "resource", None)
    assert np.isnan(peak_memory_bytes())


def test_structures__have_the_sizes_of_the_windows_api() -> None:
    assert ctypes.sizeof(MemoryStatus) == 64
    assert (MemoryStatus.physical_free.offset, MemoryStatus.commit_free.offset) == (16, 32)
    assert ctypes.sizeof(MemoryCounters) == 72
    assert MemoryCounters.peak_working_set.offset == 8
