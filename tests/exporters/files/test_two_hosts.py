"""Two hosts with one folder, each with a name and numbers of processes of its own, whose runs die at random moments."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from furrowmap.exporters.files import lease
from furrowmap.exporters.files.staging import recover
from tests.conftest import CHECKOUT
from tests.exporters.files.host import NAMES, PATIENCE_S, REFUSED

KILLS = int(os.environ.get("KILLS", "0"))
NAMESPACES = ("unshare", "--user", "--map-root-user", "--uts", "--pid", "--fork", "--mount-proc")


@contextmanager
def host(name: str) -> Iterator[subprocess.Popen[str]]:
    command = [*NAMESPACES, sys.executable, "-m", "tests.exporters.files.host", name]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=CHECKOUT) as process:
        yield process
        process.communicate()


def ask(host: subprocess.Popen[str], **task: object) -> None:
    assert host.stdin is not None
    host.stdin.write(json.dumps(task) + "\n")
    host.stdin.flush()


def ended(host: subprocess.Popen[str]) -> int:
    assert host.stdout is not None
    return int(host.stdout.readline())


def test_promise_21__two_hosts_whose_runs_die_at_random_never_mix_their_products(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if (
        not shutil.which("unshare")
        or subprocess.run([*NAMESPACES, "true"], capture_output=True, check=False).returncode
    ):
        pytest.skip("no namespaces can be made here")
    monkeypatch.setattr(lease, "MAX_SILENCE_S", PATIENCE_S)
    chance, folder = random.Random(7), str(tmp_path)
    tally = {"killed": 0, "refused": 0, "done": 0}
    with host("north") as north, host("south") as south:
        for trial in range(KILLS or 3):
            texts = [f"{name} {trial}" for name in ("north", "south")]
            for each, text in zip((north, south), texts, strict=True):
                kill_s = chance.uniform(0.0, 0.3) if trial == 0 or chance.random() < 0.45 else None
                ask(each, folder=folder, text=text, pause_s=chance.uniform(0.0, 0.08), kill_s=kill_s)
            statuses = [ended(each) for each in (north, south)]
            assert set(statuses) <= {0, REFUSED, -9}
            recover(tmp_path)  # by a third host
            found = {path.read_text() for path in tmp_path.iterdir() if not path.name.startswith(".")}
            allowed = {text for text, status in zip(texts, statuses, strict=True) if status != REFUSED}
            allowed |= set() if 0 in statuses else {f"after {trial - 1}"}
            assert len(found) == 1 or (trial == 0 and not found)
            assert found <= allowed
            # Whichever host comes next finds that the others have ended.
            following = chance.choice((north, south))
            ask(following, folder=folder, text=f"after {trial}", pause_s=0.0)
            assert ended(following) == 0
            assert {(path.name, path.read_text()) for path in tmp_path.iterdir()} == {
                (name, f"after {trial}") for name in NAMES
            }
            for status, word in ((-9, "killed"), (REFUSED, "refused"), (0, "done")):
                tally[word] += statuses.count(status)
    sys.stderr.write(f"two hosts: {KILLS or 3} trials, {tally}\n")
