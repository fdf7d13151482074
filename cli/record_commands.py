"""`furrowmap record`: what scanners and GNSS receivers send, into files."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

import furrowmap
from furrowmap.cli.command_options import command, flag, numbers, option, output
from furrowmap.cli.console import CLEARED_LINE, Console
from furrowmap.cli.result_tables import table
from furrowmap.core.runtime.errors import Notice, OptionError, printable
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.settings import language_of_user

if TYPE_CHECKING:
    from furrowmap.workflows.record.record import Told

STATUS_SHOWN_S: Final = 60.0
"""Between two lines of the status where standard error is no terminal."""
VIEWER_QUIET_S: Final = 2.0
VIEWER_ENDS_S: Final = 300.0
"""The page works out what it did not show in time, and ends then; another Ctrl-C ends it at once."""


@command(
    "Record scanners and GNSS receivers in the cab.",
    "furrowmap record -o monday --machine 'Tractor 1, tiller' --live",
    "furrowmap record -o monday --gnss /dev/ttyACM0:115200",
    "furrowmap record -o monday --gnss tcp://192.168.1.30:5017 --ports 2368,8308",
)
@output("DIR", "Folder of the recording. If it contains a recording, that is continued.", "Folder", required=True)
@option(
    "--machine", "NAME|FILE", "Machine to record: its ports and receivers, and its sensor positions for the session."
)
@option(
    "--gnss",
    "SOURCE",
    "GNSS receiver: DEVICE, DEVICE:BAUD, tcp://HOST:PORT, udp://:PORT or udp://HOST:PORT. May be repeated; the session "
    "uses the first.",
    multiple=True,
)
@option(
    "--ports",
    "PORT,...",
    "UDP ports of a scanner [default: those of the machine, else the usual ones of Velodyne, Hesai, Ouster and "
    "Livox]. Repeat it for each scanner at the same address.",
    multiple=True,
)
@option("--roll-minutes", "N", "Start a new capture every N minutes.", default=15, minimum=1)
@option("--roll-megabytes", "N", "Start a new file every N megabytes.", default=1024, minimum=1)
@flag("--live", "Also serve the page of furrowmap live, in a separate process.")
@option("--duration", "SECONDS", "Stop after this time [default: at Ctrl-C or SIGTERM].", above=0.0)
def record(
    console: Console,
    output: Path,
    machine: str | None,
    gnss: tuple[str, ...],
    ports: tuple[str, ...],
    roll_minutes: int,
    roll_megabytes: int,
    duration: float | None,
    *,
    live: bool,
) -> None:
    """Record the UDP packets of scanners and the bytes of GNSS receivers until Ctrl-C.

    Writes captures (PCAP), GNSS logs as received, and a session file for `furrowmap run DIR`. A power cut loses at most
    a second. Problems appear on the screen, in record.log and in status.json. The exit status is 1 if packets were lost
    or a part of the recorder restarted.
    """
    shown_s, language = -STATUS_SHOWN_S, language_of_user()

    def show(told: Told) -> None:
        nonlocal shown_s
        if sys.stderr.isatty():
            click.echo(CLEARED_LINE, nl=False, err=True)
        console.warn_all(told.begun)
        for notice in told.ended:
            console.say(f"{Text('over:').in_language(language)} {printable(notice.text_in(language))}")
        line = printable(told.status.summary.text_in(language))
        if sys.stderr.isatty():
            click.echo(line, nl=False, err=True)
        elif time.monotonic() - shown_s >= STATUS_SHOWN_S:
            shown_s = time.monotonic()
            console.say(line)

    with console.work(), _viewer(output) if live else nullcontext():  # reports that kernels are compiled
        recorded = furrowmap.record(
            output,
            machine=machine,
            gnss=gnss,
            ports=[_numbers(text) for text in ports],
            roll_s=60.0 * roll_minutes,
            roll_bytes=1e6 * roll_megabytes,
            duration_s=math.inf if duration is None else duration,
            told=show,
        )
    if sys.stderr.isatty():
        click.echo(err=True)  # the last status stays
    status = recorded.status
    rows = [
        *((each["address"], f"{each['packets']:,} packets, {each['lost']:,} lost") for each in status["scanners"]),
        *((each["source"], f"{each['bytes']:,} bytes, {each['format'] or 'unknown'}") for each in status["gnss"]),
        ("duration", f"{status['elapsed_s']:.1f} s"),
    ]
    session = printable(str(recorded.session))
    lacks = Notice(
        "record-lacks",
        scans=any(each["maker"] or each["unread_maker"] for each in status["scanners"]),
        positions=any(each["format"] for each in status["gnss"]),
    )
    is_usable = all(value for _, value in lacks.values)
    after = f"\nNext: furrowmap run {session}" if is_usable else ""
    console.answer({"session": recorded.session, **status}, f"{table(rows)}{after}")
    if not is_usable:
        console.warn(lacks)
    if not recorded.is_complete:
        console.warn(
            Notice(
                "record-incomplete",
                ends=sum(thread["ends"] for thread in status["threads"]),
                lost=sum(each["lost"] for each in status["scanners"]),
                dropped=sum(each["dropped"] or 0 for each in status["sockets"]),
                discarded=status["disk"]["discarded_bytes"] / 1e6,
                ignored=status["ignored"]["packets"],
            )
        )
        click.get_current_context().exit(1)


@contextmanager
def _viewer(folder: Path) -> Iterator[None]:
    """Run `furrowmap live` beside; recording goes on whatever becomes of it."""
    folder.mkdir(parents=True, exist_ok=True)
    with suppress(OSError):
        (folder / "status.json").unlink()  # of an earlier recording, which ended
    command = [sys.executable, "-P", "-m", "furrowmap", "live", str(folder)]
    # In a session of its own: Ctrl-C in the terminal ends the recording, and what is left then is shown first.
    viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)  # noqa: S603 (this interpreter)
    try:
        yield
    finally:
        try:
            with suppress(subprocess.TimeoutExpired):
                viewer.wait(VIEWER_QUIET_S)
            if viewer.poll() is None:
                click.echo(Notice("live-works-on").text_in(language_of_user()), err=True)
            viewer.wait(VIEWER_ENDS_S)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            viewer.terminate()
            viewer.wait()


def _numbers(text: str) -> tuple[int, ...]:
    found = numbers(text)
    if not found or any(port % 1.0 or not 0 < port < 1 << 16 for port in found):
        wanted = Text("UDP ports separated by commas")
        raise OptionError("--ports", text, wanted, "2368,8308")
    return tuple(map(int, found))
