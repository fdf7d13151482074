"""Dask unpickles what arrives at its ports: nobody but the batch itself may reach those of a batch."""

from __future__ import annotations

import json
import os
import re
import socket
import ssl
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from http.client import HTTPException
from pathlib import Path
from time import monotonic, sleep
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest
from dask import config
from distributed import Client
from distributed.security import Security

import furrowmap
from furrowmap.core.runtime.errors import UsageError
from furrowmap.workflows.batch.dask import DaskWorkers, cluster_of_scheduler, local_cluster
from tests.app.ending_workers import variable

CHECKOUT = Path(__file__).resolve().parents[3]
PAGE = CHECKOUT / "docs" / "how-to" / "batch.md"
HTTP_PAGES = ("", "status", "health", "workers", "info/main/workers.html", "json/identity.json", "metrics", "api/v1")


@pytest.fixture(scope="module")
def of_other_tests() -> list[tuple[str, int]]:
    """What this process listened at before the workers were started, such as a browser's driver."""
    return listening() if sys.platform == "linux" else []


@pytest.fixture(scope="module")
def workers(of_other_tests: list[tuple[str, int]]) -> Iterator[DaskWorkers]:
    """Two worker processes of this machine, as a batch starts them."""
    with local_cluster(2, lambda _: None) as engine:
        engine.client.wait_for_workers(2, timeout=60)
        yield engine


def processes_of(pid: str) -> list[str]:
    """A process and all that it started."""
    children = [child for path in Path("/proc", pid).glob("task/*/children") for child in path.read_text().split()]
    return [pid, *(one for child in children for one in processes_of(child))]


def listening() -> list[tuple[str, int]]:
    """Addresses and ports at which this process and all that it started take TCP connections."""
    ports = {}
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            columns = line.split()
            if columns[3] == "0A":  # it listens
                address, _, port = columns[1].partition(":")
                family = socket.AF_INET if len(address) == 8 else socket.AF_INET6
                words = [bytes.fromhex(address[at : at + 8])[::-1] for at in range(0, len(address), 8)]
                ports[columns[9]] = (socket.inet_ntop(family, b"".join(words)), int(port, 16))
    found = set()
    for pid in processes_of(str(os.getpid())):
        for handle in Path("/proc", pid, "fd").iterdir():
            with suppress(OSError):
                found.add(ports.get(str(handle.readlink()).removeprefix("socket:[").rstrip("]")))
    return sorted(port for port in found if port is not None)


def status_of(url: str) -> int | None:
    """The status of HTTP with which a page is answered; None where nothing speaks HTTP."""
    try:
        with urlopen(url, timeout=5.0) as answer:
            return int(answer.status)
    except HTTPError as error:
        return error.code
    except (OSError, HTTPException):
        return None


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_workers_of_a_batch__listen_on_the_loopback_only_and_show_no_page(
    workers: DaskWorkers, of_other_tests: list[tuple[str, int]]
) -> None:
    ports = [port for port in listening() if port not in of_other_tests]
    assert len(ports) >= 2 * 2 + 1, "a scheduler, and two ports of each worker"
    assert {address for address, _ in ports} == {"127.0.0.1"}
    statuses = {status_of(f"http://127.0.0.1:{port}/{page}") for _, port in ports for page in HTTP_PAGES}
    assert statuses == {None, 404}, "no HTTP where there is TLS, and no page where there is HTTP"
    assert workers.client.scheduler.address.startswith("tls://127.0.0.1:")


def test_workers_of_a_batch__take_nothing_without_their_certificate(workers: DaskWorkers) -> None:
    """As another user of the machine would try: without TLS, without a certificate, with one of their own."""
    assert list(workers.each(variable, [("x", "NOBODY_SETS_IT")], lambda: None)) == [("x", None)]
    info = workers.client.scheduler_info(n_workers=-1)["workers"]
    addresses = [workers.client.scheduler.address, *info, *(worker["nanny"] for worker in info.values())]
    assert len(addresses) == 5
    for address in addresses:
        host, _, port = address.removeprefix("tls://").partition(":")
        bare = ssl.create_default_context()
        bare.check_hostname = False
        bare.verify_mode = ssl.CERT_NONE
        connected = socket.create_connection((host, int(port)), 10.0)
        with bare.wrap_socket(connected) as tls, pytest.raises(ssl.SSLError, match=r"(?i)certificate.required"):
            tls.recv(1)
        with socket.create_connection((host, int(port)), 10.0) as plain:
            plain.sendall(b"\1" + b"\0" * 63)
            with suppress(ConnectionResetError):
                while answer := plain.recv(4096):
                    assert answer[:1] == b"\x15", "not an alert of TLS"
    scheduler = workers.client.scheduler.address
    for address, security in (
        (scheduler, Security.temporary()),
        (scheduler.replace("tls://", "tcp://"), Security()),
    ):
        with pytest.raises(OSError, match=r"(?i)time.*out|ssl|certificate|closed|in <TLS"):
            Client(address, security=security, timeout=3.0)


WATCH = """
import os, stat, sys
from pathlib import Path

def hook(event, arguments):
    if event == "open" and str(arguments[0]).endswith(("dask.pem", "dask.crt")):
        mode = stat.S_IMODE(os.stat(os.path.dirname(arguments[0])).st_mode)
        with open(os.environ["SEEN"], "a") as seen:
            seen.write(f"{mode:o}\\n")

sys.addaudithook(hook)
"""
BATCH = """
from furrowmap.workflows.batch.dask import local_cluster
from tests.app.ending_workers import variable
if __name__ == "__main__":
    with local_cluster(1, lambda _: None) as engine:
        print(list(engine.each(variable, [("x", "NOBODY_SETS_IT")], lambda: None)))
"""


def test_keys_of_a_batch__are_in_folders_of_this_user_alone_and_gone_afterwards(tmp_path: Path) -> None:
    start = tmp_path / "start"
    temporary = tmp_path / "temporary"
    for folder in (start, temporary):
        folder.mkdir()
    (start / "sitecustomize.py").write_text(WATCH)
    script = tmp_path / "batch.py"
    script.write_text(BATCH)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join((str(start), str(CHECKOUT))),
        "SEEN": str(tmp_path / "seen"),
        "TMPDIR": str(temporary),
    }
    previous = os.umask(0)
    try:
        done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
    finally:
        os.umask(previous)
    assert "('x', None)" in done.stdout
    assert set((tmp_path / "seen").read_text().split()) == {"700"}
    assert list(temporary.rglob("*.pem")) == []


def test_scheduler_without_tls__is_warned_of(simulated: furrowmap.Simulated, tmp_path: Path) -> None:
    for address, warned in (("tcp://127.0.0.1:9", True), ("127.0.0.1:9", True), ("tls://127.0.0.1:9", False)):
        settings = furrowmap.BatchSettings(scheduler=address)
        planned = furrowmap.batch([simulated.folder], tmp_path / "results", settings, dry_run=True)
        codes = [notice.code for notice in planned.notices]
        assert ("scheduler-unprotected" in codes) == warned, address


def test_scheduler_with_tls__needs_a_certificate() -> None:
    with pytest.raises(UsageError) as refused, cluster_of_scheduler("tls://127.0.0.1:9", print):
        pass
    assert refused.value.code == "usage"


@pytest.mark.skipif(sys.platform == "win32", reason="the page's commands are of a shell")
def test_certificates__of_the_page_protect_a_cluster(tmp_path: Path) -> None:
    """The commands of the page make a key that only its owner reads, and a scheduler that refuses all others."""
    (text,) = re.findall(r"```sh\n(umask 077\n.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    shown = subprocess.run(["sh", "-ec", f"{text}\nenv"], cwd=tmp_path, capture_output=True, text=True, check=True)
    stated = dict(line.split("=", 1) for line in shown.stdout.splitlines() if line.startswith("DASK_DISTRIBUTED__"))
    assert stat.S_IMODE((tmp_path / "dask.key").stat().st_mode) == 0o600
    environment = os.environ | stated | {"PYTHONPATH": str(CHECKOUT)}
    file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    same = ["--no-dashboard", "--host", "127.0.0.1", "--scheduler-file", str(file)]
    scheduler = [*dask, "scheduler", *same, "--port", "0"]
    worker = [*dask, "worker", *same, "--nthreads", "1", "--no-nanny"]
    started = [subprocess.Popen(command, cwd=tmp_path, env=environment) for command in (scheduler, worker)]
    try:
        until_s = monotonic() + 120.0
        while not (file.is_file() and file.stat().st_size):
            assert monotonic() < until_s
            sleep(0.2)
        address = json.loads(file.read_text())["address"]
        assert address.startswith("tls://")
        values = {name.removeprefix("DASK_").replace("__", ".").lower(): value for name, value in stated.items()}
        with config.set(values), cluster_of_scheduler(address, lambda _: None) as engine:
            engine.client.wait_for_workers(1, timeout=120)
            assert list(engine.each(variable, [("x", "NOBODY_SETS_IT")], lambda: None)) == [("x", None)]
        with pytest.raises(OSError, match=r"(?i)time.*out|ssl|certificate|closed|in <TLS"):
            Client(address, security=Security.temporary(), timeout=3.0)
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait(30)
