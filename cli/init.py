"""`furrowmap init`: a session file proposed from recordings."""

from __future__ import annotations

from pathlib import Path

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import command, files, option, output, overwrite
from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.settings import language_of_user


@command("Write a session file for a recording.", "furrowmap init recording.pcap.gz gnss.nmea")
@files("recordings", "RECORDING...")
@output("FILE", "Session file to write [default: session.toml beside RECORDING].", "Session file")
@option("--machine", "NAME|FILE", "Machine whose sensors' places are copied: the name of a saved one, or its profile.")
@overwrite("Replace an existing session file.")
def init(
    console: Console, recordings: tuple[Path, ...], output: Path | None, machine: str | None, *, overwrite: bool
) -> None:
    """Examine each RECORDING (LiDAR, GNSS, IMU, trajectory) and write a commented session file.

    A table of images, the parcels of a trial and their treatments may be among them, and are found beside them.

    What the recordings do not show, such as the mounting of the sensors, is listed, and left in the file as comments to
    fill in.
    """
    with console.work(passing=True) as progress:
        proposal = furrowmap.propose_session(
            recordings, output, machine=machine, overwrite=overwrite, progress=progress
        )
    words = [f"Wrote {printable(str(proposal.path))}"]
    words += [f"  {printable(notice.text)}" for notice in proposal.found]
    if proposal.missing:
        words += ["Not found in the recordings; fill in what you know:"]
        words += [f"  {printable(notice.text)}" for notice in proposal.missing]
    found, missing = (
        [{"code": notice.code, "text": notice.text_in(language_of_user())} for notice in notices]
        for notices in (proposal.found, proposal.missing)
    )
    console.answer({"session": proposal.path, "found": found, "missing": missing}, "\n".join(words))
