"""The session of a recording, which names what was recorded so far."""

import math
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import Final

from furrowmap.core.geodesy.crs_choice import CrsChoice, choose_crs
from furrowmap.core.runtime.errors import Notice, RefusedError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.session.proposal import recorded_session, with_recorded
from furrowmap.core.values.machine import Machine
from furrowmap.workflows.record.senders import Rank, Sender
from furrowmap.workflows.record.watch import SESSION_SCANNERS, Watch

SESSION_FILE: Final = "session.toml"
MAX_BYTES: Final = 1 << 20


class SessionFile:
    """Writes the session where it changes, with all scanners: first stated ones, then those that it names already."""

    def __init__(self, folder: Path, machine: Machine, watch: Watch) -> None:
        self._folder = folder
        self._machine = machine
        self._watch = watch
        self._text = ""
        self._crs: CrsChoice | None = None
        self._lasting = watch.lasting

    def update(self) -> None:
        """Write it, if it has changed."""
        watch = self._watch
        receiver = next((each for each in watch.receivers if each.arrived.format), None)
        gnss = receiver.files if receiver is not None else list[str]()
        places = [(each.arrived.lon_deg, each.arrived.lat_deg) for each in watch.receivers]
        place = next((each for each in places if math.isfinite(each[0])), None)
        if self._crs is None and place is not None:
            self._crs = choose_crs(*place)
        text = self._text or self._there() or recorded_session(resolved(self._folder).name, self._machine)
        files = [sender.series.files for sender in self._scanners(text)]
        try:
            text = with_recorded(text, files, gnss, self._crs, self._machine)
        except (RefusedError, ValueError) as error:  # one that was there, and is written in another way: it is kept
            watch.lasting = [
                *self._lasting,
                Notice("record-session-kept", name=SESSION_FILE, fault=str(error).partition("\n")[0]),
            ]
        else:
            watch.lasting = self._lasting
        if text != self._text:
            self._text = text
            watch.storage.small.replace(SESSION_FILE, text, durable=True)

    def _scanners(self, text: str) -> list[Sender]:
        heard = [sender for sender in self._watch.network.senders.first_ones if sender.series.files]
        scanners = [sender for sender in heard if sender.arrived.maker]
        scanners = scanners or [each for each in heard if each.arrived.unread]  # a run says what it cannot read
        end = len(text) + 1
        scanners.sort(key=lambda each: (each.rank is not Rank.STATED, text.find(f'"{each.series.stem}-') % end))
        return scanners[:SESSION_SCANNERS]

    def _there(self) -> str:
        """The session of an earlier recording into the folder, with what its user has filled in; empty without one."""
        with suppress(OSError, UnicodeDecodeError):
            descriptor = os.open(self._folder / SESSION_FILE, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
            with os.fdopen(descriptor, "rb") as file:
                status = os.fstat(descriptor)
                if stat.S_ISREG(status.st_mode) and status.st_size <= MAX_BYTES:
                    return file.read(MAX_BYTES).decode("utf-8").replace("\r\n", "\n")
        return ""
