"""Every file that a command is given by an argument or an option, where there is none: named, and refused at once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import furrowmap
from furrowmap.cli.main import command_line
from tests.app.command_cases import CASES, materials
from tests.inputs.test_matrix import KINDS, MATRIX

OF_CASE = {"check": "check --table", "calibrate": "calibrate --machine", "run": "run --preview"}
"""The case whose words are those of a command, where it has another name."""
LEFT_OUT = {
    *("calibrate --machine", "init --machine", "record --machine", "live --from", "live --map", "check --pairs"),
    "gnss solve --antennas",
}
"""Options of no case, or such that the case has already."""
INSTEAD = {"canopy --polygons": "--cell"}
"""Options of the case that another one takes the place of."""
WRITTEN = {"frames --svg", "check --table", "qgis install --plugins-folder"}
OPTIONS = sorted(
    name
    for name in {
        *(name for kind in KINDS for names in kind["places"].values() for name in names if " --" in name),
        *(name for name in MATRIX["no_kind"] if " --" in name),
    }
    - LEFT_OUT
    - WRITTEN
)
GIVEN = [(name, word) for name, case in CASES.items() for word in re.findall(r"\{(\w+)\}", case.words) if word != "out"]


@pytest.fixture(scope="module")
def made(
    tmp_path_factory: pytest.TempPathFactory, simulated: furrowmap.Simulated, result: furrowmap.Result
) -> dict[str, Path]:
    return materials(tmp_path_factory.mktemp("materials"), simulated, result)


def nowhere(folder: Path, suffix: str, kind: str) -> Path:
    """A path at which nothing is, or a link that leads nowhere."""
    path = folder / f"missing{suffix}"
    if kind == "link":
        path.symlink_to(folder / "nowhere")
    return path


def refused(words: list[str], missing: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = command_line(words)
    said = capsys.readouterr().err
    assert status in (2, 3, 4), said
    assert missing.name in said or "nowhere" in said, said
    assert "[field] boundary" not in said, "no option is that key"


@pytest.mark.parametrize("kind", ["nothing", "link"])
@pytest.mark.parametrize(("name", "word"), GIVEN)
def test_argument__that_is_missing(
    name: str, word: str, kind: str, made: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = CASES[name]
    out = tmp_path / "out"
    out.mkdir()
    case.before(made, out)
    missing = nowhere(tmp_path, made[word].suffix, kind)
    names = {**made, word: missing, "out": out}
    refused([part.format(**names) for part in case.words.split()], missing, capsys)


@pytest.mark.parametrize("kind", ["nothing", "link"])
@pytest.mark.parametrize("option", OPTIONS)
def test_option__that_is_missing(
    option: str, kind: str, made: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command, _, flag = option.partition(" ")
    name = next(one for one in (option, OF_CASE.get(command, ""), command, "gnss evaluate") if one in CASES)
    words = CASES[name].words.split()
    for given in (flag, INSTEAD.get(option, "")):
        if given in words:
            del words[words.index(given) : words.index(given) + 2]
    missing = nowhere(tmp_path, ".gpkg", kind)
    flags = flag.split()
    refused([part.format(**made, out=tmp_path / "out") for part in words] + [*flags, str(missing)], missing, capsys)
