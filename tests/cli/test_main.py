"""Whatever happens, the command answers in one way: an exit status, data on one stream, three lines on the other."""

from __future__ import annotations

import errno
import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from pyproj import proj_version_str

from furrowmap.cli.main import COMMANDS, command_line
from furrowmap.core.session.examination import Examined

FURROWMAP = Path(sys.executable).with_name("furrowmap")


def test_help__names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [command for command in COMMANDS if any(line.split()[:1] == [command] for line in lines)] == list(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help__of_each_command_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line([command, "--help"]) == 0
    assert f"Example:\n    furrowmap {command} " in capsys.readouterr().out


@pytest.mark.parametrize("command", [*COMMANDS, "calibrate mount", "gnss solve", "farm add"])
def test_help__describes_the_commands_own_options_and_names_the_others(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line([*command.split(), "--help"]) == 0
    own, _, rest = capsys.readouterr().out.partition("\nOptions of every command")
    rows = re.findall(r"^  (?:-\w, )?--([\w-]+)", own, re.MULTILINE)
    assert not {"quiet", "verbose", "log-file", "threads", "lang", "allow-large", "allow-damaged", "debug"} & set(rows)
    named = rest.partition("\n\n")[0].split("describes:")[-1].count("--")
    assert named in (9, 10) or "COMMAND ..." in own or command == "worker"


@pytest.mark.parametrize("options", [["--lang", "de"], ["--lang=ja", "-q"], ["-vv", "--threads", "1"], ["--json"]])
@pytest.mark.parametrize("command", [["inspect"], ["gnss", "solve"], ["run"], ["farm", "list"]])
def test_options_of_every_command__may_stand_before_it(
    command: list[str], options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    status = command_line([*command, *options, "/not-there"])
    behind = capsys.readouterr()
    assert command_line([*options, *command, "/not-there"]) == status
    assert capsys.readouterr() == behind
    assert command_line([command[0], *options, *command[1:], "/not-there"]) == status
    assert capsys.readouterr() == behind


def test_options_of_every_command__without_a_command_leave_help_and_faults_as_they_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert command_line(["--threads", "2", "--help"]) == 0
    assert "COMMAND ..." in capsys.readouterr().out
    assert command_line(["--lang", "de"]) == 2
    assert "kein Befehl" in capsys.readouterr().err
    assert command_line(["--json", "--version"]) == 0
    assert "proj" in json.loads(capsys.readouterr().out)


def test_help__describes_once_what_every_command_has(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["--help"]) == 0
    commands, _, described = capsys.readouterr().out.partition("\nOptions of every command:\n")
    assert "--threads" not in commands
    rows = re.findall(r"^  (?:-\w, )?(--[\w-]+).*?  \w", described, re.MULTILINE)
    assert rows == [
        "--json",
        "--quiet",
        "--verbose",
        "--log-file",
        "--threads",
        "--lang",
        "--allow-large",
        "--allow-damaged",
        "--debug",
        "--help",
    ]


def test_help__imports_nothing_heavy() -> None:
    code = (
        "import sys; from furrowmap.cli.main import command_line; command_line(['--help']);"
        "sys.exit(' '.join({'numpy', 'numba', 'pyproj', 'pyogrio', 'rasterio'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "\n")


@pytest.mark.parametrize(
    ("arguments", "what", "remedy"),
    [
        ([], "no command given", "inspect"),
        (["inspct", "x"], "'inspct'", "furrowmap inspect"),
        (["xyzzy"], "'xyzzy'", ", ".join(COMMANDS)),
        (["inspect", "--jsn", "x"], "--jsn", "--json"),
        (["inspect"], "FILE", "furrowmap inspect --help"),
        (["run", "a", "b"], "unexpected extra argument", "furrowmap run --help"),
        (["run", "a", "-o"], "-o", "furrowmap run --help"),
    ],
)
def test_wrong_call__is_reported_in_three_lines(
    arguments: list[str], what: str, remedy: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line(arguments) == 2
    output = capsys.readouterr()
    lines = output.err.splitlines()
    assert len(lines) == 3
    assert what in lines[0]
    assert remedy in lines[2]
    assert output.out == ""


def test_wrong_call__is_reported_as_json_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["run", "--json", "--overwrit", "x"]) == 2
    output = capsys.readouterr()
    error = json.loads(output.out)["error"]
    assert list(error) == ["code", "what", "meaning", "remedy"]
    assert error["code"] == "usage"
    assert "--overwrite" in error["remedy"]
    assert len(output.err.splitlines()) == 3


def test_promise_25__names_cannot_command_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["run", str(tmp_path / "\x1b[31m\nred\udcff.toml")]) == 3
    output = re.sub(r"^Compiling kernels.*\n", "", capsys.readouterr().err)  # said where this is the first command ever
    assert len(output.splitlines()) == 3
    assert "\x1b" not in output
    assert "red\\udcff.toml" in output


@pytest.mark.parametrize(
    ("raised", "status", "code", "words"),
    [
        (RuntimeError("the gauge broke"), 1, "fault", "RuntimeError: the gauge broke"),
        (AssertionError(), 1, "fault", "bug in furrowmap"),
        (
            OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "cloud.laz"),
            1,
            "not-written",
            "cloud.laz cannot be written",
        ),
        (OSError(errno.EACCES, os.strerror(errno.EACCES), "cloud.laz"), 1, "system", "cloud.laz: Permission denied"),
        (MemoryError(), 1, "out-of-memory", "memory"),
        (KeyboardInterrupt(), 130, "cancelled", "Cancelled"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_anything_raised__becomes_three_lines(
    raised: BaseException,
    status: int,
    code: str,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(_: object) -> None:
        raise raised

    monkeypatch.setattr(Examined, "read", fail)
    assert command_line(["inspect", "x", "--json"]) == status
    output = capsys.readouterr()
    assert json.loads(output.out)["error"]["code"] == code
    assert words in output.err
    assert len(output.err.splitlines()) == 3


def test_debug__shows_the_traceback_before_the_three_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> None:
        raise RuntimeError

    monkeypatch.setattr(Examined, "read", fail)
    assert command_line(["inspect", "x", "--debug"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "Traceback (most recent call last):"
    assert "--debug" in lines[-1]


def test_log_file__keeps_the_steps_and_the_traceback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "furrowmap.log"
    assert command_line(["inspect", str(tmp_path / "none"), "--log-file", str(log)]) == 3
    assert command_line(["run", str(tmp_path / "none.toml"), "--log-file", str(log)]) == 3
    text = log.read_text(encoding="utf-8")
    assert "Reading none" in text
    assert "InputError" in text
    assert "Traceback" not in capsys.readouterr().err


def test_version__tells_what_stands_behind(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(["--version", "--json"]) == 0
    versions = json.loads(capsys.readouterr().out)
    assert (versions["furrowmap"], versions["proj"]) == (version("furrowmap"), proj_version_str)
    assert command_line(["--version"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == f"furrowmap {version('furrowmap')}"


def test_command__ends_with_the_status_and_colours_nothing_in_a_pipe(tmp_path: Path) -> None:
    done = subprocess.run([FURROWMAP, "inspect", tmp_path / "none"], capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 3
    assert "\x1b" not in done.stderr


def test_reader_that_leaves_early__is_no_error(tmp_path: Path) -> None:
    process = subprocess.Popen([FURROWMAP, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    output = process.stderr.read()
    process.stderr.close()
    assert (process.wait(), output) == (1, "")
