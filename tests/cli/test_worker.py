"""The worker, talked to as another program does."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from furrowmap.cli.main import command_line
from furrowmap.cli.worker_process import WorkerConsole, _own_output, work

FURROWMAP = Path(sys.executable).with_name("furrowmap")
GNSS = "gnss.nmea"


class Program:
    """Whoever started a worker."""

    def __init__(self) -> None:
        self.worker = subprocess.Popen(
            [FURROWMAP, "worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )

    def say(self, message: object) -> None:
        assert self.worker.stdin is not None
        self.worker.stdin.write(json.dumps(message).encode() + b"\n")
        self.worker.stdin.flush()

    def order(self, *arguments: str | Path) -> None:
        self.say({"type": "start", "arguments": [str(word) for word in arguments]})

    def heard(self) -> Iterator[dict[str, Any]]:
        assert self.worker.stdout is not None
        for line in self.worker.stdout:
            yield json.loads(line)

    def until(self, kind: str) -> dict[str, Any]:
        return next(message for message in self.heard() if message["type"] == kind)


@pytest.fixture
def program() -> Iterator[Program]:
    started = Program()
    yield started
    started.worker.kill()
    started.worker.wait()
    for stream in (started.worker.stdin, started.worker.stdout, started.worker.stderr):
        assert stream is not None
        stream.close()


def test_worker__answers_as_the_command_line_does(
    program: Program, shared_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = shared_data / "tractor_loop" / GNSS
    program.order("inspect", path)
    heard = list(program.heard())
    assert heard[0] == {"type": "hello", "protocol": 1, "version": version("furrowmap"), "pid": program.worker.pid}
    assert heard[-1] == {"type": "done", "status": 0}
    (result,) = (message["value"] for message in heard if message["type"] == "result")
    assert command_line(["inspect", str(path), "--json"]) == 0
    assert result == json.loads(capsys.readouterr().out)
    assert program.worker.wait(10) == 0


def test_worker__tells_errors_in_three_lines(program: Program, tmp_path: Path) -> None:
    program.order("run", tmp_path / '圃場 "north".toml')
    heard = list(program.heard())
    error, done = heard[-2:]
    assert set(error) == {"type", "code", "what", "meaning", "remedy"}
    assert '圃場 "north".toml' in error["what"]
    assert done == {"type": "done", "status": 3}
    assert program.worker.wait(10) == 3


@pytest.mark.parametrize(
    "order",
    [
        {"type": "start"},
        {"type": "start", "arguments": []},
        {"type": "start", "arguments": ["worker"]},
        {"type": "start", "arguments": ["run", "a\0b"]},
        {"type": "begin", "arguments": ["run"]},
        "run",
    ],
)
def test_worker__refuses_what_is_no_order(order: object) -> None:
    answers = io.BytesIO()
    assert work(io.BytesIO(json.dumps(order).encode() + b"\n"), answers) == 2
    hello, error, done = (json.loads(line) for line in answers.getvalue().splitlines())
    assert (hello["type"], error["code"]) == ("hello", "worker-order")
    assert done == {"type": "done", "status": 2}


def begin_run(program: Program, shared_data: Path, result: Path) -> None:
    program.order("run", shared_data / "tractor_fishtail" / "session.toml", "-o", result)
    while program.until("progress")["share"] == 0.0:
        pass


def test_worker__cancelled_leaves_nothing(program: Program, shared_data: Path, tmp_path: Path) -> None:
    begin_run(program, shared_data, tmp_path / "result")
    program.say({"type": "cancel"})
    assert program.until("error")["code"] == "cancelled"
    assert program.until("done") == {"type": "done", "status": 130}
    assert list(tmp_path.iterdir()) == []


def test_worker__whose_program_is_gone_ends_and_leaves_nothing(
    program: Program, shared_data: Path, tmp_path: Path
) -> None:
    begin_run(program, shared_data, tmp_path / "result")
    assert program.worker.stdin is not None
    program.worker.stdin.close()
    assert program.worker.wait(60) == 130
    assert list(tmp_path.iterdir()) == []


def test_worker__whose_program_was_killed_does_not_stay(shared_data: Path, tmp_path: Path) -> None:
    code = (
        "import subprocess, sys, time\n"
        f"worker = subprocess.Popen([{str(FURROWMAP)!r}, 'worker'], stdin=subprocess.PIPE, stdout=subprocess.PIPE)\n"
        "worker.stdin.write(sys.argv[1].encode() + b'\\n'); worker.stdin.flush()\n"
        "print(worker.pid, flush=True); time.sleep(60)"
    )
    order = {"arguments": ["run", str(shared_data / "tractor_loop" / "session.toml"), "-o", str(tmp_path / "result")]}
    parent = subprocess.Popen(
        [sys.executable, "-c", code, json.dumps({"type": "start", **order})], stdout=subprocess.PIPE
    )
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    end_s = time.monotonic() + 60
    while _alive(pid) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert not _alive(pid)
    assert list(tmp_path.iterdir()) == []


def test_worker__that_hangs_ends_when_its_program_is_gone() -> None:
    code = (
        "import time\n"
        "from furrowmap.cli import worker_process as worker\n"
        "def hang(*_):\n"
        "    while True:\n"
        "        try: print('hangs', flush=True); time.sleep(60)\n"
        "        except KeyboardInterrupt: pass\n"
        "worker.ABANDONED_S, worker.attempt = 0.3, hang\n"
        "worker.worker([], standalone_mode=False)"
    )
    order = json.dumps({"type": "start", "arguments": ["run", "session.toml"]}).encode() + b"\n"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        process.stdin.write(order)
        process.stdin.flush()
        assert process.stderr.readline() == b"hangs\n"
        process.stdin.close()
        assert process.wait(30) == 130


def _alive(pid: int) -> bool:
    """Whether a process still runs; one that ended and nobody has asked about does not."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_protocol__has_standard_output_for_itself(capfd: pytest.CaptureFixture[str]) -> None:
    """Whatever a native library writes there goes to standard error."""
    protocol = _own_output()
    try:
        os.write(1, b"from a library")
        protocol.write(b"a message")
        protocol.flush()
    finally:
        os.dup2(protocol.fileno(), 1)
        protocol.close()
    assert capfd.readouterr() == ("a message", "from a library")


def test_protocol__has_standard_input_for_itself() -> None:
    """A library that looks there while a thread waits for orders would wait, too, on Windows."""
    program = (
        "import os, threading\n"
        "from furrowmap.cli.worker_process import _own_input\n"
        "orders, lines = _own_input(), []\n"
        "reader = threading.Thread(target=lambda: lines.append(orders.readline()))\n"
        "reader.start()\n"
        "print(os.path.samestat(os.fstat(0), os.stat(os.devnull)), os.read(0, 9), flush=True)\n"
        "reader.join()\n"
        "print(lines, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline().split() == [b"True", b"b''"]
        process.stdin.write(b"an order\n")
        process.stdin.flush()
        assert b"an order" in process.stdout.readline()


def test_progress__of_a_stage_is_sent_at_most_ten_times_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[tuple[str, float]] = []
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    console = WorkerConsole(send=lambda kind, **content: sent.append((content["stage"], content["share"])))
    with console.work() as progress:
        for stage, k in [*(("reading", k) for k in range(100)), *(("writing", k) for k in range(50))]:
            progress(stage, k / 99.0)
            now_s += 0.0201
    shares = [share for stage, share in sent if stage == "reading"]
    assert shares == [round(k / 99.0, 4) for k in range(0, 100, 5)]
    assert sent[20] == ("writing", 0.0)
    assert len(sent) == 30
