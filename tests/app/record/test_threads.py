"""Each thread of a recording is killed: that is said at once, the thread works again, and the exit status says so."""

from __future__ import annotations

import ctypes
import json
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import furrowmap
from furrowmap.cli.main import command_line
from furrowmap.workflows.record.record import Told

from .senders import free_ports, numbered, payloads, velodyne_packet

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the addresses of the loopback are those of Linux")

SAID_WITHIN_S = 1.0
LOADED_S = 4.0
"""Further time on a machine that does something else."""
PATIENCE_S = 120.0
"""Until something is taken for never coming; only the time that threads had to run is measured more tightly."""
POLL_S = 0.02
GGA = b"$GPGGA,010203.00,3652.2000,N,14001.2000,E,4,12,0.8,270.0,M,37.0,M,1.0,0000*"


# An exception that is raised in a thread may come to it in somebody's __del__.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


class Killed(BaseException):
    """What no handler of a thread expects."""


def kill(thread: threading.Thread) -> None:
    """Raise an exception in a thread, at whatever it is just doing."""
    assert thread.ident is not None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident), ctypes.py_object(Killed))


def status_of(folder: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads((folder / "status.json").read_text(encoding="utf-8"))
    except OSError:
        found = {}
    return found


def waited_for(holds: Callable[[], bool], within_s: float = PATIENCE_S) -> float:
    """The time until something holds, without that for which this thread asked to run and was not let."""
    begun_s = time.monotonic()
    held_up_s = 0.0
    while not holds():
        assert time.monotonic() - begun_s - held_up_s < within_s
        asleep_s = time.monotonic()
        time.sleep(POLL_S)
        held_up_s += time.monotonic() - asleep_s - POLL_S
    return time.monotonic() - begun_s - held_up_s


def kill_by_name(name: str, before: set[threading.Thread]) -> None:
    """Kill the thread of a name, once there is one: it may just be started again."""
    found: list[threading.Thread] = []

    def is_there() -> bool:
        thread = recorder_threads(before).get(name)
        found[:] = [thread] if thread is not None else []
        return bool(found)

    waited_for(is_there)
    kill(found[0])


@contextmanager
def sending(ports: tuple[int, int, int]) -> Iterator[Callable[[], int]]:
    """Send 200 numbered packets of a scanner a second, and positions; yields how many packets were sent so far."""
    sent = 0
    ended = threading.Event()
    checksum = 0
    for byte in GGA[1:-1]:
        checksum ^= byte

    def send() -> None:
        nonlocal sent
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not ended.wait(0.005):
                sender.sendto(velodyne_packet(sent), ("127.0.0.1", ports[0]))
                if sent % 20 == 0:
                    sender.sendto(GGA + b"%02X\r\n" % checksum, ("127.0.0.1", ports[2]))
                sent += 1

    thread = threading.Thread(target=send, name="sender of the test", daemon=True)
    thread.start()
    try:
        yield lambda: sent
    finally:
        ended.set()
        thread.join()


def recorder_threads(before: set[threading.Thread]) -> dict[str, threading.Thread]:
    """Threads that run since and are not the test's, by their names."""
    since = [each for each in threading.enumerate() if each not in before and each.ident is not None]
    return {each.name: each for each in since if not each.name.endswith("test")}


def reached(folder: Path, number: int) -> bool:
    """Whether a packet of that number or a later one is in the captures: one may be lost with a thread."""
    return max(numbered(payloads(folder, "lidar-127.0.0.1")), default=-1) >= number


class Killer:
    """Kills each thread of a recording, and measures how long it takes until that is said everywhere."""

    def __init__(self, folder: Path, ports: tuple[int, int, int]) -> None:
        self.folder = folder
        self.ports = ports
        self.before = {*threading.enumerate()}
        self.alarms: list[str] = []
        self.said_s: dict[str, float] = {}
        self.sent = 0
        self.fault: BaseException | None = None
        self.worker = threading.Thread(target=self._work, name="killer of the test")

    def told(self, moment: Told) -> None:
        self.alarms += [notice.text for notice in moment.begun if notice.code == "record-thread"]
        if self.worker.ident is None:
            self.worker.start()
        elif not self.worker.is_alive():
            raise KeyboardInterrupt  # as the user does

    def _work(self) -> None:
        try:
            with sending(self.ports) as sent:
                waited_for(lambda: bool(status_of(self.folder)))
                waited_for(lambda: reached(self.folder, 0))
                for name in sorted(each["name"] for each in status_of(self.folder)["threads"]):
                    self._kill_one(name, sent)
                self._kill_often(sent)
                self.sent = sent()
        except BaseException as error:  # noqa: BLE001 raised by the test itself
            self.fault = error

    def _kill_one(self, name: str, sent: Callable[[], int]) -> None:
        count = len(self.alarms)

        def is_said() -> bool:
            of_it = [each for each in status_of(self.folder).get("threads", []) if each["name"] == name]
            log = (self.folder / "record.log").read_text(encoding="utf-8")
            in_status = bool(of_it) and of_it[0]["ends"] > 0 and "Killed" in of_it[0]["cause"]
            return in_status and f"thread {name}: ended" in log and len(self.alarms) > count

        for attempt in range(3):
            kill_by_name(name, self.before)
            try:
                self.said_s[name] = waited_for(is_said, SAID_WITHIN_S + LOADED_S)
                break
            except AssertionError:
                ended = any(each["ends"] for each in status_of(self.folder).get("threads", []) if each["name"] == name)
                if attempt == 2 or ended:  # an exception that comes to a thread between two attempts may be lost
                    raise
        later = sent() + 20
        waited_for(lambda: reached(self.folder, later))

    def _kill_often(self, sent: Callable[[], int]) -> None:
        """Between two attempts, an exception ends the thread itself."""
        for _ in range(10):
            for thread in recorder_threads(self.before).values():
                kill(thread)
            time.sleep(0.03)
        later = sent() + 20
        waited_for(lambda: reached(self.folder, later))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_promise_26__every_thread_that_is_killed_is_named_at_once_and_works_again(tmp_path: Path) -> None:
    ports = free_ports()
    folder = tmp_path / "rec"
    killer = Killer(folder, ports)
    found = furrowmap.record(folder, gnss=[f"udp://:{ports[2]}"], ports=[ports[:2]], told=killer.told)
    if killer.fault is not None:
        raise killer.fault
    names = {each["name"] for each in found.status["threads"]}
    assert killer.said_s.keys() == names
    assert {"packets", "writer", "flusher", "metadata", "watch", f"GNSS receiver udp://:{ports[2]}"} == names
    assert all(f"for {name}. It was" in " ".join(killer.alarms) for name in names)
    recorded = numbered(payloads(folder, "lidar-127.0.0.1"))
    lost = killer.sent - len({*recorded} & {*range(killer.sent)})
    sys.stderr.write(f"said within {max(killer.said_s.values()):.2f} s: {killer.said_s}; {lost} packets lost, ")
    sys.stderr.write(f"{len(recorded) - len({*recorded})} written twice, of {killer.sent}\n")
    assert recorded == sorted(recorded)
    assert lost < 0.02 * killer.sent, "what a thread had in its hands"
    assert not found.is_complete
    assert (folder / "gnss-0001.log").stat().st_size > 100


def test_promise_26__thread_that_was_ended_makes_the_exit_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ports = free_ports()
    before = {*threading.enumerate()}

    def kill_one() -> None:
        waited_for((tmp_path / "rec" / "status.json").exists)
        kill_by_name("packets", before)

    statuses = []
    for work, duration_s in ((kill_one, 6), (lambda: None, 1)):
        folder = tmp_path / "rec"
        (folder / "status.json").unlink(missing_ok=True)
        killer = threading.Thread(target=work, name="killer of the test")
        killer.start()
        words = ["record", "-o", str(folder), "--ports", str(ports[0]), "--duration", str(duration_s), "--json"]
        statuses.append(command_line(words))
        killer.join()
    assert statuses == [1, 0]
    out, told = capsys.readouterr()
    assert "incomplete" in told
    assert "started again" in told
    assert "Killed" in out
