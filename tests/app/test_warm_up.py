"""`furrowmap warm-up` compiles what commands call, so that they compile nothing afterwards."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

from furrowmap.cli.main import COMMANDS
from furrowmap.process import CACHE_VARIABLE
from furrowmap.warm_up import LIST, types_of

CODE = """
import sys
from furrowmap.process import prepare_process
prepare_process()
from numba.core import event
from furrowmap.cli.main import command_line
with event.install_recorder("numba:compile") as recorder:
    status = command_line(sys.argv[1:])
print(status, sum(each.is_start for _, each in recorder.buffer))
"""


def test_warmed_command__compiles_nothing(shared_data: Path, tmp_path: Path) -> None:
    environment = os.environ | {CACHE_VARIABLE: str(tmp_path / "kernels"), "FURROWMAP_THREADS": "2"}

    def run(*command: str | Path) -> str:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return done.stdout

    first = run(sys.executable, "-m", "furrowmap", "warm-up", "fields", "--json")
    assert json.loads(first)["compiled"] > 0
    task_data = shared_data / "isoxml/field_days/tillage_two_fields_holes.zip"
    assert run(sys.executable, "-c", CODE, "fields", task_data).splitlines()[-1] == "0 0"


def test_list__states_as_many_types_as_the_kernels_have_arguments() -> None:
    commands = tomllib.loads(LIST.read_text(encoding="utf-8"))
    assert {*commands} - {*COMMANDS} == {"flights", "others"}
    for kernels in commands.values():
        for name, signatures in kernels.items():
            place, _, kernel = name.rpartition(".")
            module = import_module(f"furrowmap.{place}")
            for signature in signatures:
                arguments = len(types_of(signature, module))
                assert arguments == getattr(module, kernel).py_func.__code__.co_argcount, name
