"""`furrowmap gnss evaluate`: words, JSON, files, and the statuses with which it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from furrowmap.cli.main import command_line

PLACE = "35.339325776,139.522173128,65.712"


def test_evaluate__answers_in_words_and_json(
    shared_data: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = str(shared_data / "gnss/clas/clas_static.pos")
    assert command_line(["gnss", "evaluate", path, "--reference", PLACE, "-o", str(tmp_path / "out")]) == 0
    words = capfd.readouterr().out
    assert "fixed (581 epochs)" in words
    assert "standard deviation" in words
    assert (tmp_path / "out/evaluation.html").stat().st_size < 1_000_000
    assert command_line(["gnss", "evaluate", path, "--reference", PLACE, "--json"]) == 0
    output = json.loads(capfd.readouterr().out)
    (service,) = output["services"]
    assert service["tables"]["fixed"]["X"]["average_m"] == pytest.approx(0.005, abs=6e-4)
    assert service["test"]["service"] == "clas"
    assert output["output"] is None


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["gnss", "evaluate", "{pos}", "--reference", PLACE, "--antenna-offset", "1,2"], 2, "FORWARD,LEFT,UP"),
        (["gnss", "evaluate", "{pos}", "--reference", PLACE, "--antenna-offset", "nan,0,0"], 2, "FORWARD,LEFT,UP"),
        (["gnss", "evaluate", "{pos}", "--reference", "139.522173128,35.339325776,65.712"], 3, "latitude comes first"),
        (["gnss", "evaluate", "{pos}", "--reference", "nowhere.pos"], 3, "does not exist"),
        (["gnss", "evaluate", "{pos}", "--reference", "{other}"], 3, "no time in common"),
        (["gnss", "evaluate", "{undated}", "--reference", PLACE], 3, "date"),
        (["gnss", "evaluate", "{cloud}", "--reference", PLACE], 3, "holds no positions"),
        (["gnss", "evaluate", "{pos}", "{pos}", "--reference", PLACE, "--name", "A"], 2, "--name once for each"),
        (["gnss", "evaluate", "{pos}", "--reference", PLACE, *(2 * ["--antenna-offset", "0,0,0"])], 2, "once for all"),
        (["gnss", "evalute", "{pos}", "--reference", PLACE], 2, "Did you mean `furrowmap gnss evaluate`"),
    ],
)
def test_what_cannot_be_done__is_three_lines(
    arguments: list[str], status: int, words: str, shared_data: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    files = {
        "pos": "gnss/clas/clas_static.pos",
        "other": "gnss/pos/static_rtk.pos",
        "undated": "gnss/walk_f9p/walk.ubx",
        "cloud": "las/good/small.copc.laz",
    }
    known = {name: str(shared_data / path) for name, path in files.items()}
    assert command_line([argument.format(**known) for argument in arguments]) == status
    error = capfd.readouterr().err
    assert words in error
    # Where no test before compiled them, that is output as well.
    output = [line for line in error.splitlines() if line.strip() and not line.startswith("Compiling kernels")]
    assert len(output) == 3


@pytest.mark.parametrize("date", [["--date", "2025-09-09"], []])
def test_undated_logs__take_the_day_from_the_option_or_from_the_other(
    date: list[str], shared_data: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = shared_data / "gnss/walk_f9p"
    command = ["gnss", "evaluate", str(folder / "walk.ubx"), "--reference", str(folder / "walk.nmea"), "--json", *date]
    assert command_line(command) == 0
    output = json.loads(capfd.readouterr().out)
    assert output["services"][0]["epochs"]["compared"] > 3900
    assert output["services"][0]["tables"]["all"]["2D"]["rmse_m"] < 0.05
