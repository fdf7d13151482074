"""`furrowmap calibrate`: mounting calibration and clock offset from the recording itself."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import UsageError, printable

if TYPE_CHECKING:
    from furrowmap import Board, Calibration

FEWEST_CORNERS = 3
_ASSUMED = "not determined: too little relief, and nothing upright stands out"


class WithMount(click.Command):
    """A command whose first word may be that of another one: no session file is called so."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """The context of this command, or of `calibrate mount`."""
        if args[:1] == [mount.name]:
            return mount.make_context(f"{info_name} {mount.name}", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@click.command(
    short_help="Attitude of a moving mount, from images of a board.",
    epilog="\b\nExample:\n  furrowmap calibrate mount frames --board 9x6 --square-m 0.03 -o mount.csv",
)
@click.argument("frames", type=FILE)
@click.option("--board", required=True, metavar="COLUMNSxROWS", help="Inner corners of the chessboard, such as 9x6.")
@click.option(
    "--square-m", type=click.FloatRange(0.0, min_open=True), required=True, help="Length of a square's sides."
)
@click.option("-o", "--output", type=FILE, metavar="FILE", help="The CSV [default: mount.csv beside FRAMES].")
@click.option("--camera", type=FILE, metavar="SESSION", help="Take the intrinsics from [camera] of a session file.")
@click.option(
    "--board-rpy",
    default="0,0,0",
    show_default=True,
    metavar="ROLL,PITCH,YAW",
    help="Angles of the board's axes in the vehicle frame, in degrees, in the first frame.",
)
@click.option(
    "--board-on",
    type=click.Choice(["body", "mount"]),
    default="body",
    help="Where the board is; the camera is on the other [default: body].",
)
@click.option("--overwrite", is_flag=True, help="Replace an existing file.")
@common_options
def mount(
    console: Console,
    frames: Path,
    board: str,
    square_m: float,
    output: Path | None,
    camera: Path | None,
    **options: Any,
) -> None:
    """Write the attitude of a mount over time from FRAMES, images of a chessboard, for `[mount] attitude` of a session.

    FRAMES is a folder of images, with a table of their files and times (CSV) or EXIF times, or such a table. The
    attitude is zero in the first frame that shows the board.
    """
    with console.work() as progress:
        found = furrowmap.calibrate_mount(
            frames,
            _board(board, square_m),
            output,
            camera=camera,
            board_rpy_deg=_board_angles(options["board_rpy"]),
            board_on=options["board_on"],
            overwrite=options["overwrite"],
            progress=progress,
        )
    for notice in found.notices:
        console.warn(notice)
    figures = found.plain()
    words = (
        f"{figures['frames_with_board']} of {found.frames} frames show the board; corners within "
        f"{figures['rms_px']:.3f} pixels, attitudes ± {figures['sigma_deg']:.3f}°.\n"
        f"Roll, pitch and yaw range over {_angles(figures['range_deg'])}°.\n"
        f"{printable(str(found.path))} is written: name it under [mount] attitude."
    )
    console.answer({"attitude": found.path, **figures}, words)


def _board(text: str, square_m: float) -> Board:
    """The board of a text such as `9x6`."""
    numbers = re.fullmatch(r"(\d{1,3})[xX×](\d{1,3})", text.strip())
    if numbers is None or min(int(numbers[1]), int(numbers[2])) < FEWEST_CORNERS:
        raise UsageError("bad-board", text=text)
    return furrowmap.Board(int(numbers[1]), int(numbers[2]), square_m)


def _board_angles(text: str) -> tuple[float, float, float]:
    """The angles of a text such as `180,0,90`."""
    try:
        roll, pitch, yaw = (float(part) for part in text.split(","))
    except ValueError:
        roll = pitch = yaw = math.nan
    if not all(map(math.isfinite, (roll, pitch, yaw))):
        raise UsageError("usage.board-angles", text=text)
    return roll, pitch, yaw


@click.command(
    cls=WithMount,
    short_help="Estimate the sensor mounting from the recording itself.",
    epilog="\b\nExample:\n  furrowmap calibrate session.toml --write",
)
@click.argument("session", type=FILE)
@click.option("--write", is_flag=True, help="Write the estimates into SESSION; its other lines are kept.")
@click.option(
    "--machine",
    metavar="NAME|FILE",
    help="Write the mounting into this machine's profile, with the day and the standard deviations.",
)
@common_options
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
    rows: list[tuple[str, Any]] = [
        ("scanner rpy_deg, stated", _angles(found.stated.rpy_deg)),
        ("scanner rpy_deg, estimated", _angles(found.found.rpy_deg) if found.mounting_differs else "unchanged"),
        ("sigma of roll, pitch, yaw", _angles(found.sigma_deg)),
        (
            "scanner xyz_m, estimated",
            _places(found.found.xyz_m) if found.found.xyz_m != found.stated.xyz_m else "unchanged",
        ),
        ("facing of the scanner", "shown by the scans" if found.facing_shown else _ASSUMED),
        (
            "vehicle origin above ground",
            f"{height_m:+.3f} m ± {sigma_m:.3f}" if math.isfinite(height_m) else "not shown",
        ),
        ("lidar_minus_gnss_s, stated", f"{found.stated_offset_s:.3f}"),
        (
            "lidar_minus_gnss_s, estimated",
            f"{found.offset_s[0]:.3f} ± {found.offset_s[1]:.3f}" if found.clock_differs else "unchanged",
        ),
    ]
    end = "Written to the session file." if written else "The session file was not changed."
    saved = f"\nThe mounting was written to the machine {printable(machine)}." if machine is not None else ""
    return f"{table(rows)}\n{end}{saved}"


def _angles(angles_deg: Sequence[float]) -> str:
    return ", ".join(f"{angle:.2f}" for angle in angles_deg)


def _places(places_m: tuple[float, float, float]) -> str:
    return ", ".join(f"{place:.3f} m" for place in places_m)
