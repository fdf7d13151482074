"""`furrowmap calibrate`: mounting calibration and clock offset from the recording itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.tables import table

if TYPE_CHECKING:
    from furrowmap import Calibration

_ASSUMED = "not determined: too little relief, and nothing upright stands out"


@click.command(
    short_help="Estimate the sensor mounting from the recording itself.",
    epilog="\b\nExample:\n  furrowmap calibrate session.toml --write",
)
@click.argument("session", type=FILE)
@click.option("--write", is_flag=True, help="Write the estimates into SESSION; its other lines are kept.")
@common_options
def calibrate(console: Console, session: Path, *, write: bool) -> None:
    """Estimate the mounting angles of the scanner and the clock offset from the recording described by SESSION.

    Assumes that the ground under the vehicle is level on average over the session and that the vehicle drives straight
    ahead; ground scanned on passes in opposite directions must coincide.
    """
    with console.work() as progress:
        found = furrowmap.calibrate(session, write=write, progress=progress)
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
            "written": written,
        },
        _words(found, written=written),
    )


def _words(found: Calibration, *, written: bool) -> str:
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
    return f"{table(rows)}\n{end}"


def _angles(angles_deg: tuple[float, float, float]) -> str:
    return ", ".join(f"{angle:.2f}" for angle in angles_deg)


def _places(places_m: tuple[float, float, float]) -> str:
    return ", ".join(f"{place:.3f} m" for place in places_m)
