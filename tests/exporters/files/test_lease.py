"""One run at a time writes to a folder, whichever processes, containers and hosts share it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from furrowmap.core.runtime.errors import RefusedError
from furrowmap.exporters.files import lease as lease_module
from furrowmap.exporters.files.lease import PREFIX, hold_lease, leases
from furrowmap.exporters.files.owner import Owner
from furrowmap.exporters.files.staging import recover, staged_folder

linux = pytest.mark.skipif(sys.platform != "linux", reason="the system does not report when a process started")
CHECKOUT = Path(__file__).resolve().parents[3]
WRITE = """
import sys
from pathlib import Path
from furrowmap.exporters.files import owner
from furrowmap.exporters.files.staging import staged_folder
if len(sys.argv) > 2:
    owner.machine = lambda: sys.argv[2]
with staged_folder(Path(sys.argv[1])) as staging:
    (staging / "report.json").write_text("theirs")
    print("at work", flush=True)
    sys.stdin.readline()
print("done", flush=True)
"""
ELSEWHERE = "0" * 8
"""A machine whose processes cannot be seen from here."""


@contextmanager
def writer(folder: Path, *machine: str, before: tuple[str, ...] = ()) -> Iterator[subprocess.Popen[str]]:
    """A process that writes to the folder until it reads a line."""
    command = [*before, sys.executable, "-c", WRITE, str(folder), *machine]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "at work\n"
        try:
            yield process
        finally:
            process.kill()


def write(folder: Path) -> None:
    with staged_folder(folder) as staging:
        (staging / "report.json").write_text("ours")


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """A heartbeat of another machine is watched for two of its beats."""
    monkeypatch.setattr(lease_module, "MAX_SILENCE_S", 2.5)


@pytest.mark.parametrize("machine", [(), (ELSEWHERE,)])
def test_promise_21__second_run_is_refused_and_the_first_one_ends_well(tmp_path: Path, machine: tuple[str]) -> None:
    with writer(tmp_path, *machine) as first:
        for attempt in (write, recover):
            with pytest.raises(RefusedError, match=r"another run \(process \d+ on .+\) is writing there"):
                attempt(tmp_path)
        assert first.stdout is not None
        out, _ = first.communicate("\n")
        assert out == "done\n"
    assert (tmp_path / "report.json").read_text() == "theirs"
    assert not leases(tmp_path)


@linux
def test_promise_21__killed_run_of_this_machine_is_recognised_at_once(tmp_path: Path) -> None:
    with writer(tmp_path) as first:
        first.kill()
        first.wait()
        begun_s = time.monotonic()
        write(tmp_path)
        assert time.monotonic() - begun_s < lease_module.MAX_SILENCE_S / 2
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]


@linux
def test_promise_21__process_with_a_number_that_was_used_before_is_another(tmp_path: Path) -> None:
    here = Owner.here()
    (tmp_path / f"{PREFIX}{Owner(here.machine, os.getppid(), 1).words()}-{'0' * 8}" / "products").mkdir(parents=True)
    write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]


def test_promise_21__run_that_ended_on_another_machine_is_recognised(tmp_path: Path, hasty: None) -> None:
    with writer(tmp_path, ELSEWHERE) as first:
        first.kill()
        first.wait()
        write(tmp_path)
    assert (tmp_path / "report.json").read_text() == "ours"
    assert not leases(tmp_path)


@linux
def test_promise_21__two_containers_with_one_folder(tmp_path: Path) -> None:
    own_numbers = ("unshare", "--user", "--map-root-user", "--pid", "--fork", "--mount-proc")
    possible = shutil.which("unshare") and subprocess.run([*own_numbers, "true"], capture_output=True, check=False)
    if not possible or possible.returncode:
        own_numbers = ()  # where the kernel refuses namespaces, two processes of one machine
    with writer(tmp_path, before=own_numbers) as first:
        for other in ((), own_numbers):
            second = subprocess.run(
                [*other, sys.executable, "-c", WRITE, str(tmp_path)],
                input="",
                capture_output=True,
                text=True,
                check=False,
            )
            assert "is writing there" in second.stderr
        out, _ = first.communicate("\n")
        assert out == "done\n"
    assert (tmp_path / "report.json").read_text() == "theirs"


@pytest.mark.parametrize("done", [False, True])
def test_promise_21__run_that_lost_its_folder_while_asleep_changes_nothing(tmp_path: Path, *, done: bool) -> None:
    write(tmp_path)
    with pytest.raises(RefusedError, match="taken over"), staged_folder(tmp_path) as staging:
        (staging / "report.json").write_text("late")
        (own,) = leases(tmp_path)
        if done:
            own.rename(own.with_name("gone"))  # as a run does that has found this one to have ended
        else:
            (own / "ended").touch()
    assert (tmp_path / "report.json").read_text() == "ours"


def test_promise_21__of_many_runs_at_once_one_gets_the_folder(tmp_path: Path) -> None:
    refused: list[RefusedError] = []

    def ask(_: int) -> bool:
        try:
            with hold_lease(tmp_path):
                while len(refused) < 11:  # as long as this run has the folder, all others are refused
                    time.sleep(0.01)
        except RefusedError as error:
            refused.append(error)
            return False
        return True

    with ThreadPoolExecutor(12) as pool:
        assert sum(pool.map(ask, range(12))) == 1
