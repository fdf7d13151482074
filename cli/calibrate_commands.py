"""`furrowmap calibrate`: mounting calibration and clock offset from the recording itself."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

import furrowmap
from furrowmap.cli.command_options import FILE, DescribedCommand, command, flag, numbers, option, output, overwrite
from furrowmap.cli.console import Console
from furrowmap.cli.result_tables import table
from furrowmap.core.runtime.errors import OptionError, printable
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.margins import margin, with_margin

if TYPE_CHECKING:
    from furrowmap import Board, Calibration

MIN_CORNERS: Final = 3
_FACING_ASSUMED: Final = "not determined: too little relief, and nothing upright stands out"


class WithMount(DescribedCommand):
    """A command whose first word may be that of another one: no session file is called so."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """The context of this command, or of `calibrate mount`."""
        if args[:1] == [mount.name]:
            return mount.make_context(f"{info_name} {mount.name}", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@command(
    "Attitude of a moving mount, from images of a board.",
    "furrowmap calibrate mount frames --board 9x6 --square-m 0.03 -o mount.csv",
)
@click.argument("frames", type=FILE)
@option(
    "--board",
    "COLUMNSxROWS",
    "Inner corners of the chessboard, such as 9x6.",
    required=True,
    label="Inner corners of the chessboard",
)
@option("--square-m", "METRES", "Side of a square.", required=True, above=0.0, label="Side of a square")
@output("FILE", "CSV file to write [default: mount.csv beside FRAMES].", "Attitude of the mount")
@option(
    "--camera", "SESSION", "Take the intrinsics from [camera] of a session file.", label="Session with the intrinsics"
)
@option(
    "--board-rpy",
    "ROLL,PITCH,YAW",
    "Angles of the board's axes in the vehicle frame, in degrees, in the first frame.",
    default="0,0,0",
    label="Roll, pitch and yaw of the board",
)
@option(
    "--board-on",
    "",
    "Position of the board; the camera is on the other part.",
    default="body",
    choices=("body", "mount"),
    label="The board is on the",
)
@option(
    "--begin",
    "TIME",
    "Time of the first frame of a video, such as 2026-05-23T09:41:12.345 (UTC, or with a zone).",
    label="Time of a video's first frame",
)
@option("--every", "N", "Use every n-th frame.", default=1, minimum=1, label="Use every n-th frame")
@overwrite("Replace an existing file.")
def mount(
    console: Console,
    frames: Path,
    board: str,
    square_m: float,
    board_rpy: str,
    board_on: str,
    output: Path | None,
    **options: Any,
) -> None:
    """Write the attitude of a mount over time from FRAMES, images of a chessboard, for `[mount] attitude` of a session.

    FRAMES is a folder of images with EXIF times or with a table of files and times (CSV), such a table, or a video with
    --begin. The attitude is zero in the first frame that shows the board.
    """
    with console.work() as progress:
        found = furrowmap.calibrate_mount(
            frames,
            _board(board, square_m),
            output,
            board_rpy_deg=_board_angles(board_rpy),
            board_on=board_on,
            **options,
            progress=progress,
        )
    console.warn_all(found.notices)
    figures = found.plain()
    words = (
        f"{figures['frames_with_board']} of {found.frames} frames show the board; corners within "
        f"{figures['rms_px']:.3f} pixels, attitudes {margin(figures['sigma_deg'], '°')} (95 %).\n"
        f"Roll, pitch and yaw range over {_angles(figures['range_deg'])}°.\n"
        f"{printable(str(found.path))} is written: name it under [mount] attitude."
    )
    console.answer({"attitude": found.path, **figures}, words)


def _board(text: str, square_m: float) -> Board:
    """The board of a text such as `9x6`."""
    numbers = re.fullmatch(r"(\d{1,3})[xX×](\d{1,3})", text.strip())
    if numbers is None or min(int(numbers[1]), int(numbers[2])) < MIN_CORNERS:
        wanted = Text("the numbers of inner corners, where four squares meet, in a row and of rows")
        raise OptionError("--board", text, wanted, "9x6")
    return furrowmap.Board(int(numbers[1]), int(numbers[2]), square_m)


def _board_angles(text: str) -> tuple[float, float, float]:
    """The angles of a text such as `180,0,90`."""
    angles = numbers(text)
    if len(angles) != 3:
        wanted = Text("ROLL,PITCH,YAW in degrees")
        raise OptionError("--board-rpy", text, wanted, "180,0,90")
    return angles[0], angles[1], angles[2]


@command(
    "Estimate the sensor mounting from the recording itself.", "furrowmap calibrate session.toml --write", cls=WithMount
)
@click.argument("session", type=FILE)
@flag(
    "--write",
    "Write the estimates into SESSION; its other lines do not change.",
    label="Write the estimates into the session file",
)
@option(
    "--machine",
    "NAME|FILE",
    "Write the mounting into this machine's profile, with the day and the standard deviations.",
)
def calibrate(console: Console, session: Path, machine: str | None, *, write: bool) -> None:
    """Estimate the mounting angles of the scanner and the clock offset from the recording described by SESSION.

    Assumes that the ground under the vehicle is level on average over the session and that the vehicle drives straight
    ahead; ground scanned on passes in opposite directions must coincide.

    `furrowmap calibrate mount` is another command: the attitude of a moving mount from images of a board.
    """
    with console.work() as progress:
        found = furrowmap.calibrate(session, write=write, machine=machine, progress=progress)
    written = write and found.differs
    console.answer(
        {
            "session": session,
            "lidar_rpy_deg": {"stated": found.stated.rpy_deg, "found": found.found.rpy_deg},
            "lidar_xyz_m": {"stated": found.stated.xyz_m, "found": found.found.xyz_m},
            "sigma_deg": found.sigma_deg,
            "facing_shown": found.facing_shown,
            "height_above_ground_m": found.height_m,
            "lidar_minus_gnss_s": {"stated": found.stated_offset_s, "found": found.offset_s},
            "date": found.date,
            "written": written,
            "machine": machine,
        },
        _words(found, machine, written=written),
    )


def _words(found: Calibration, machine: str | None, *, written: bool) -> str:
    height_m, sigma_m = found.height_m
    places = ", ".join(f"{place:.3f} m" for place in found.found.xyz_m)
    rows: list[tuple[str, Any]] = [
        ("scanner rpy_deg, stated", _angles(found.stated.rpy_deg)),
        ("scanner rpy_deg, estimated", _angles(found.found.rpy_deg) if found.mounting_differs else "unchanged"),
        ("sigma of roll, pitch, yaw", _angles(found.sigma_deg)),
        ("scanner xyz_m, estimated", places if found.found.xyz_m != found.stated.xyz_m else "unchanged"),
        ("facing of the scanner", "shown by the scans" if found.facing_shown else _FACING_ASSUMED),
        (
            "vehicle origin above ground",
            f"{with_margin(height_m, sigma_m, ' m', sign=True)} (95 %)" if math.isfinite(height_m) else "not shown",
        ),
        ("lidar_minus_gnss_s, stated", f"{found.stated_offset_s:.3f}"),
        (
            "lidar_minus_gnss_s, estimated",
            f"{with_margin(*found.offset_s, ' s')} (95 %)" if found.clock_differs else "unchanged",
        ),
    ]
    end = "Written to the session file." if written else "The session file was not changed."
    saved = f"\nThe mounting was written to the machine {printable(machine)}." if machine is not None else ""
    return f"{table(rows)}\n{end}{saved}"


def _angles(angles_deg: Sequence[float]) -> str:
    return ", ".join(f"{angle:.2f}" for angle in angles_deg)
