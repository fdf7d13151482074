"""`furrowmap live`: watch a session while it is recorded."""

import io
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from threading import Event
from typing import Any

import click

import furrowmap
from furrowmap.cli.command_options import FILE, command, flag, option
from furrowmap.cli.console import Console
from furrowmap.cli.result_tables import figures, table
from furrowmap.core.runtime.errors import UsageError
from furrowmap.workflows.live.hosts import own_addresses


@command(
    "Watch a session while it is recorded.",
    "furrowmap live field-recording",
    "furrowmap live --from session.toml --speed 4",
    json_help="Print each scan as a line of JSON to standard output, and the summary at the end.",
)
@click.argument("folder", type=FILE, required=False)
@option("--from", "SESSION", "Play back the recording of SESSION instead of following a folder.", "played")
@option("--speed", "N", "Play N times as fast as recorded [default: 1; 0: as fast as possible].")
@option("--port", "N", "Port of the page in the local network [default: 8080; 0: no page].")
@option("--nmea-port", "N", "TCP port that sends GGA, VTG and HDT [default: 10110; 0: none].")
@option("--mqtt", "URL", "Send messages to this broker: mqtt://[USER:PASSWORD@]HOST[:PORT][/TOPIC], or mqtts://.")
@option("--map", "FILE", "Background map of the page: raster tiles in a PMTiles or MBTiles file.", "background")
@option("--host", "NAME", "Another host name of this computer that browsers may use. May be repeated.", multiple=True)
@flag("--local", "Serve on this computer only, not in the local network.")
def live(
    console: Console,
    folder: Path | None,
    played: Path | None,
    speed: int | None,
    port: int | None,
    nmea_port: int | None,
    mqtt: str | None,
    background: Path | None,
    host: tuple[str, ...],
    *,
    local: bool,
) -> None:
    """Show vehicle, tool and worked ground on a web page while FOLDER is recorded.

    FOLDER is the output of furrowmap record. The command adds only live.jsonl to it. A played recording stays on the
    page until Ctrl-C.
    """
    if folder is not None and played is not None:
        raise UsageError("usage.both", one="FOLDER", other="--from")
    recording = played or folder
    if recording is None:
        raise UsageError("usage.neither", one="FOLDER", other="--from")
    port = 8080 if port is None else port
    if port:
        addresses = (own_addresses() if not local else []) or ["localhost"]
        for address in addresses:
            console.say(f"http://{address}:{port}/")
        if addresses != ["localhost"] and sys.stderr.isatty():
            console.say(qr_code(f"http://{addresses[0]}:{port}/"))
    summary = furrowmap.live(
        recording,
        play=0.0 if played is None else math.inf if speed == 0 else float(speed or 1),
        host=["127.0.0.1" if local else "0.0.0.0", *host],  # noqa: S104 (tablets on the local network look at it)
        port=port or None,
        nmea_port=10110 if nmea_port is None else nmea_port or None,
        mqtt=mqtt,
        background=background,
        on_scan=_put_line if console.as_json else _stay if port and played is not None else None,
    )
    console.answer(asdict(summary), table(figures(asdict(summary))))


def qr_code(address: str) -> str:
    """A QR code of an address in block characters, for phones; empty without the package that makes it."""
    try:
        import segno
    except ImportError:
        return ""
    drawn = io.StringIO()
    segno.make(address, micro=False).terminal(drawn, compact=True)
    return drawn.getvalue()


def _put_line(scan: dict[str, Any]) -> None:
    """Write what is known with a scan as a line of JSON."""
    if "over" not in scan:
        click.echo(json.dumps(scan, separators=(",", ":")))


def _stay(scan: dict[str, Any]) -> None:
    """Keep the page after the end, until Ctrl-C."""
    if "over" in scan:
        Event().wait()
