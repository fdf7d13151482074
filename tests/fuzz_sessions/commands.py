"""What a user does with a session: command lines, and the functions behind those that would not end."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from threading import Event, Timer
from typing import Final

import furrowmap
from furrowmap.cli.main import attempt
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.core.runtime.write_errors import as_furrowmap_error
from tests.fuzz_sessions.place import Place

WATCHED_S: Final = 0.3
"""A folder is watched live for so long."""
Outcome = tuple[int, FurrowmapError | None]


def _run(place: Place, chance: Random) -> list[str]:
    options = [one for one in ("--overwrite", "--resume", "--strict") if chance.random() < 0.3]
    return ["run", _session(place, chance), *_output(place), *options, *_within(place, chance)]


def _preview(place: Place, chance: Random) -> list[str]:
    return ["run", "--preview", _session(place, chance), *_output(place)]


def _crs(place: Place, chance: Random) -> list[str]:
    return ["crs", _session(place, chance)]


def _frames(place: Place, chance: Random) -> list[str]:
    return ["frames", _session(place, chance), *(["--svg", str(place.file)] if chance.random() < 0.5 else [])]


def _inspect(place: Place, chance: Random) -> list[str]:
    return ["inspect", *_files(place, chance)]


def _init(place: Place, chance: Random) -> list[str]:
    options = ["--overwrite"] if chance.random() < 0.5 else []
    options += ["--machine", str(place.session)] if chance.random() < 0.1 else []
    return ["init", *_files(place, chance), "-o", str(place.file), *options]


def _check(place: Place, chance: Random) -> list[str]:
    products = [str(path) for path in (place.out, *_inside(place.out)) if path.suffix in ("", ".tif", ".laz", ".gpkg")]
    product = chance.choice(products if products and chance.random() < 0.5 else _files(place, chance))
    return ["check", product, chance.choice(_files(place, chance))]


def _machine(place: Place, chance: Random) -> list[str]:
    return ["machine", "save", _session(place, chance), chance.choice((str(place.file), "Tractor 1", "../x", "圃"))]


def _batch(place: Place, chance: Random) -> list[str]:
    options = ["--dry-run"] if chance.random() < 0.95 else []  # else a process of its own is started
    options += ["--overwrite"] if chance.random() < 0.3 else []
    options += ["--machine", str(place.session)] if chance.random() < 0.15 else []
    options += ["--boundaries", chance.choice(_files(place, chance))] if chance.random() < 0.15 else []
    return ["batch", str(place.root / "cards"), *_output(place), "--workers", "1", *options]


def _season(place: Place, chance: Random) -> list[str]:
    results = chance.choice((place.out, place.session.parent, place.root / "cards"))
    options = ["--overwrite"] if chance.random() < 0.5 else []
    return ["season", str(results), "-o", str(place.out / "season"), "--workers", "1", *options]


def _live(place: Place, chance: Random) -> list[str]:
    return ["live", "--from", str(place.session), "--speed", "0", "--port", "0", "--nmea-port", "0"]


def _watch(place: Place, chance: Random) -> list[str]:
    return ["watch", str(place.session.parent)]


LINES: Final[tuple[tuple[int, Callable[[Place, Random], list[str]]], ...]] = (
    (300, _preview), (160, _run), (100, _crs), (80, _frames), (80, _inspect), (80, _init), (40, _batch), (40, _check),
    (30, _machine), (20, _season), (2, _live), (2, _watch),
)  # fmt: skip
"""How often each command is given, and what makes its line."""
DEEP: Final = frozenset({"run", "live", "batch"})
"""Commands that take seconds where a session is right."""
NAMES_FILES: Final = frozenset({"inspect", "init", "check", "season", "batch"})
"""Commands that are given files themselves; what a link among them leads to was named."""


def lines(place: Place, chance: Random, *, right: bool, deep: float) -> list[list[str]]:
    """Command lines for a session; where all of it is right, the commands that take long are given rarely."""
    made = []
    for _ in range(chance.choice((1, 1, 1, 1, 2))):
        line = chance.choices([make for _, make in LINES], [weight for weight, _ in LINES])[0](place, chance)
        if right and line[0] in DEEP and chance.random() > deep:
            line = (_crs if chance.random() < 0.8 else _preview)(place, chance)
        if line[0] != "watch":
            line += ["--json"] if chance.random() < 0.7 else []
            line += ["--lang", chance.choice(LANGUAGES)] if chance.random() < 0.15 else []
            line += [chance.choice(("--allow-damaged", "--allow-large"))] if chance.random() < 0.1 else []
        made.append(line)
    return made


def do(line: Sequence[str]) -> Outcome:
    """Run a command line; the exit status and the error."""
    if line[0] != "watch":
        return attempt(list(line))
    stop = Event()
    Timer(WATCHED_S, stop.set).start()
    try:
        furrowmap.live(line[1], port=None, nmea_port=None, stop=stop)
    except Exception as raised:  # noqa: BLE001
        error = as_furrowmap_error(raised)
        return error.exit_status, error
    return 0, None


def _session(place: Place, chance: Random) -> str:
    return str(place.session if chance.random() < 0.8 else place.session.parent)


def _output(place: Place) -> list[str]:
    return ["-o", str(place.out)]


def _within(place: Place, chance: Random) -> list[str]:
    return ["--within", chance.choice(_files(place, chance))] if chance.random() < 0.1 else []


def _files(place: Place, chance: Random) -> list[str]:
    """Some of the files of a session."""
    there = [str(path) for path in _inside(place.session.parent)]
    return chance.sample(there, min(len(there), chance.choice((1, 1, 2, 3, 6)))) or [str(place.session)]


def _inside(folder: Path) -> list[Path]:
    with contextlib.suppress(OSError):
        return sorted(folder.iterdir())
    return []
