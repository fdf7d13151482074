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
from pathlib import Path
from numba.core import event
from furrowmap.core.readers.isoxml.log import read_tasks
with event.install_recorder("numba:compile") as recorder:
    read_tasks(Path(sys.argv[1]))
print(sum(each.is_start for _, each in recorder.buffer))
"""
"""What only `furrowmap fields` calls; benchmarks/compilation.py counts the compilations of whole commands."""


def test_warmed_kernels__are_not_compiled_again(shared_data: Path, tmp_path: Path) -> None:
    environment = os.environ | {CACHE_VARIABLE: str(tmp_path / "kernels"), "FURROWMAP_THREADS": "2"}

    def run(*words: str | Path) -> str:
        command = [sys.executable, *words]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    read = "-c", CODE, shared_data / "isoxml/field_days/tillage_two_fields_holes.zip"
    assert json.loads(run("-m", "furrowmap", "warm-up", "fields", "--json"))["compiled"] > 0
    assert run(*read) == "0\n"
    assert json.loads(run("-m", "furrowmap", "warm-up", "fields", "--json"))["compiled"] == 0


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
