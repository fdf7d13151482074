"""Post-processed GNSS positions by RTKLIB's `rnx2rtkp`."""

import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from furrowmap.core.readers.antex import antenna_model, copy_antex
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rtklib.pos import RtklibPos
from furrowmap.core.readers.source import look
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.programs import program_on_path
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.exporters.files.atomic import atomic_output, refuse_existing
from furrowmap.settings import SolveSettings

PROGRAM: Final = "rnx2rtkp"
SYSTEMS: Final = "G,R,E,J,C"
"""GPS, GLONASS, Galileo, QZSS, BeiDou."""
_KINEMATIC: Final = "2"
_STATIC: Final = "3"
_ANTENNA_TYPE: Final = re.compile(rb"^.{20}(.{20}).{20}ANT # / TYPE", re.MULTILINE)
_ANTENNAS_FILE: Final = "antennas.atx"
_OPTIONS_FILE: Final = "antennas.conf"
_OF_THE_HEADERS: Final = f"ant1-anttype =*\nant2-anttype =*\nfile-rcvantfile ={_ANTENNAS_FILE}\n"
"""Types and heights of both antennas are those in the headers of RINEX."""
_APPROXIMATE: Final = re.compile(rb"^(.{14})(.{14})(.{14}).{18}APPROX POSITION XYZ", re.MULTILINE)
MIN_RADIUS_M: Final = 6_000_000.0
"""Nearer to the earth's centre no antenna stands: the header was left at 0."""


@dataclass(frozen=True)
class SolvedPositions:
    """A solution: the `.pos` file, number of positions by kind of fix, UTC of the first and the last one."""

    path: Path
    epochs: int
    by_fix: dict[str, int]
    first: str
    last: str
    notices: tuple[Notice, ...]


def solve_gnss(
    rover: str | Path,
    base: str | Path,
    navigation: Sequence[str | Path],
    out: str | Path | None = None,
    settings: SolveSettings = SolveSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
) -> SolvedPositions:
    """Positions of a rover relative to a base, from RINEX files of both, by RTKLIB's `rnx2rtkp`.

    Ambiguities are solved forwards and backwards in time, and both solutions combined.

    Args:
        rover: observations of the rover.
        base: observations of the base.
        navigation: broadcast ephemerides.
        out: the `.pos` file; None for the name of the rover's file with that suffix.

    Raises:
        InputError: if a file is not RINEX of its kind, or nothing can be solved.
        RefusedError: if the solution exists.
        FurrowmapError: if RTKLIB is not installed.
    """
    program = program_on_path(PROGRAM)
    if program is None:
        raise FurrowmapError("no-rtklib")
    rover = Path(rover)
    base = Path(base)
    for path, kind in ((rover, "O"), (base, "O"), *((Path(name), "NGLHPJC") for name in navigation)):
        line = look(path).data.partition(b"\n")[0].decode("latin-1").rstrip("\r")
        wanted = "observations" if kind == "O" else "navigation messages"
        if line[60:].startswith("CRINEX VERS"):
            raise InputError("not-rinex.hatanaka", path=path, name=path.name, program=PROGRAM, wanted=wanted)
        if not line[60:].startswith("RINEX VERSION"):
            raise InputError("not-rinex.other-format", path=path, program=PROGRAM, wanted=wanted)
        if line[20:21].upper() not in kind:
            raise InputError("not-rinex.other-content", path=path, program=PROGRAM, wanted=wanted)
    target = Path(out) if out is not None else rover.with_suffix(".pos")
    refuse_existing(target, overwrite=overwrite)
    place, notices = _base_position(base, settings)
    antex = Path(settings.antennas) if settings.antennas is not None else None
    if antex is not None:
        for path in (rover, base):
            antenna_model(antex, _antenna_of(path))
    progress("solving positions", 0.0)
    with atomic_output(target) as unfinished:
        mode = _STATIC if settings.static else _KINEMATIC
        options = ["-p", mode, "-c", "-t", "-m", f"{settings.mask_deg:g}", "-sys", SYSTEMS]
        # RTKLIB was found in PATH, and every path is absolute, so that none is read as an option.
        paths = [str(resolved(path)) for path in (unfinished, rover, base, *map(Path, navigation))]
        with TemporaryDirectory() as folder:
            if antex is not None:
                # Names of the options' file end at a number sign, so that the calibrations get one without.
                copy_antex(antex, Path(folder) / _ANTENNAS_FILE)
                (Path(folder) / _OPTIONS_FILE).write_text(_OF_THE_HEADERS, encoding="ascii")
                options = ["-k", _OPTIONS_FILE, *options]
            command = [program, *options, *place, "-o", *paths]
            done = subprocess.run(command, capture_output=True, check=False, cwd=folder)  # noqa: S603
        track = _solution(unfinished, done, rover)
    progress("solving positions", 1.0)
    by_fix = {fix.label: int((track.fix == fix).sum()) for fix in Fix}
    return SolvedPositions(
        target,
        len(track),
        {label: count for label, count in by_fix.items() if count},
        iso_utc(float(track.t_s[0])),
        iso_utc(float(track.t_s[-1])),
        notices,
    )


def _antenna_of(rinex: Path) -> str:
    """Type and radome of the antenna in the header of a RINEX file. Raises InputError if there are none."""
    found = _ANTENNA_TYPE.search(look(rinex).data)
    name = found[1].decode("latin-1").strip() if found is not None else ""
    if not name:
        raise InputError("antenna-unnamed", path=rinex)
    return name


def _base_position(base: Path, settings: SolveSettings) -> tuple[list[str], tuple[Notice, ...]]:
    """Options with the position of the base, and what is uncertain about it."""
    if settings.base is not None:
        return ["-l", *(f"{value:.10f}" for value in settings.base)], ()
    found = _APPROXIMATE.search(look(base).data)
    try:
        xyz = [float(part) for part in found.groups()] if found is not None else [0.0]
    except ValueError:
        xyz = [0.0]
    if sum(value**2 for value in xyz) < MIN_RADIUS_M**2:
        return [], (Notice("base-position-assumed.mean-of-singles", base=base.name),)
    return ["-r", *(f"{value:.4f}" for value in xyz)], (Notice("base-position-assumed", base=base.name),)


def _solution(path: Path, done: subprocess.CompletedProcess[bytes], rover: Path) -> GnssTrack:
    """The positions that were written; the program's status is 0 also without any."""
    fault = ""
    if path.is_file() and path.stat().st_size:
        try:
            return RtklibPos([path], ReadOptions()).track()
        except InputError:
            fault = "it wrote no position"
    said = [line for line in re.split(r"[\r\n]+", done.stderr.decode("utf-8", "replace")) if line.strip()]
    words = fault or (said[-1].strip()[:200] if said else f"it ended with status {done.returncode}")
    raise InputError("gnss-unsolved", rover=rover, words=words)
