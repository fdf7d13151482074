"""The running recording: what looks at it each second, keeps its threads alive, and ends it."""

import math
import time
from collections.abc import Mapping
from typing import Final

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.runtime.supervised import SupervisedThread, cause_of
from furrowmap.core.values.clock import iso_utc
from furrowmap.workflows.record.ouster_metadata import MetadataAsker
from furrowmap.workflows.record.recorded_session import SESSION_FILE, SessionFile
from furrowmap.workflows.record.small_files import SmallFiles
from furrowmap.workflows.record.watch import Status, Watch

LOOK_S: Final = 1.0
LOGGED_S: Final = 60.0
"""Between two lines of the status in the log."""
ENDS_POLL_S: Final = 0.1
STATUS: Final = "status.json"


class ThreadEnds:
    """Notes at once, into the log, where a thread was ended by an exception; `count` of them so far."""

    def __init__(self, small: SmallFiles) -> None:
        self.count = 0
        self._small = small

    def note(self, thread: SupervisedThread) -> None:
        """A thread was ended; it calls this itself."""
        self._small.log(f"{iso_utc(time.time())} thread {thread.name}: ended, and begun again ({thread.cause})")
        self.count += 1


class Recorder:
    """Looks at a recording in a thread of its own, so that whoever is told may hang.

    Attributes:
        status: the last one; None before any.
    """

    def __init__(self, watch: Watch, session: SessionFile, asker: MetadataAsker, ends: ThreadEnds) -> None:
        self.status: Status | None = None
        self._watch = watch
        self._session = session
        self._asker = asker
        self._ends = ends
        self._warnings: Mapping[str, Notice] = {}
        self._logged_s = -math.inf
        self._thread = SupervisedThread("watch", self._look_often, ends.note)
        watch.further_threads = [*watch.further_threads, self._thread]
        self._thread.ensure()

    def log(self, text: str) -> None:
        """Write a line into the log."""
        self._watch.storage.small.log(f"{iso_utc(time.time())} {text}")

    def ensure(self) -> None:
        """Start threads again that an exception ended altogether."""
        for thread in self._watch.threads:
            thread.ensure()

    def note_screen(self, error: Exception) -> None:
        """What showed the status to the user failed: the log says so, and the next status."""
        self._watch.note_fault("screen", error)

    def end(self) -> Status:
        """Take what has arrived, write all, and say how it ended."""
        watch = self._watch
        self._thread.stop(10.0 * LOOK_S)
        for receiver in watch.receivers:
            receiver.thread.stopping.set()
        self._asker.thread.stopping.set()
        try:
            watch.network.stop()
            for receiver in watch.receivers:
                receiver.stop()
        finally:
            watch.storage.drain()
            try:
                status = self._looked("ended")
                self._note(status)
            finally:
                watch.storage.close()
        self._asker.stop()
        return status

    def _look_often(self) -> None:
        while not self._thread.stopping.is_set():
            count = self._ends.count
            self.ensure()
            self._note(self._looked())
            next_s = time.monotonic() + LOOK_S
            while time.monotonic() < next_s and self._ends.count == count:
                if self._thread.stopping.wait(ENDS_POLL_S):
                    return

    def _looked(self, state: str = "recording") -> Status:
        """The status now, or where it cannot be found out, the last one, which says so."""
        try:
            return self._watch.look(state)
        except Exception as error:
            last = self.status
            if last is None:
                raise
            notice = Notice("record-not-understood", source=STATUS, cause=cause_of(error))
            warnings = {**last.warnings, f"{notice.key} {STATUS}": notice}
            said = [{"code": each.code, **each.texts} for each in warnings.values()]
            values = {**last.values, "state": state, "time_s": time.time(), "complete": False, "warnings": said}
            return Status(values, last.summary, warnings)

    def _note(self, status: Status) -> None:
        """Write the status, the session where it changed, and the log."""
        storage = self._watch.storage
        for name, notice in status.warnings.items():
            if name not in self._warnings:
                self.log(f"warning {notice.code}: {notice.text_in(language_of_user())}")
        for name, notice in self._warnings.items():
            if name not in status.warnings:
                self.log(f"over {notice.code}: {notice.text_in(language_of_user())}")
        self._warnings = status.warnings
        if time.monotonic() - self._logged_s >= LOGGED_S or status.values["state"] == "ended":
            self._logged_s = time.monotonic()
            self.log(status.summary.text_in(language_of_user()))
        self.status = status
        storage.small.replace(STATUS, json_text(status.values))
        try:
            self._session.update()
        except Exception as error:  # noqa: BLE001 whatever a session says that was there
            self._watch.note_fault(SESSION_FILE, error)
        for sender in self._watch.network.senders.first_ones:
            if sender.arrived.maker == "Ouster":
                self._asker.ask(sender.address, sender.series.stem)
