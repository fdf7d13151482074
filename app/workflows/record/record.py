"""Recording what scanners and GNSS receivers send, until the end is asked for."""

import gc
import math
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.request import urlopen

from furrowmap.core.geodesy.crs_choice import CrsChoice, choose_crs
from furrowmap.core.readers.arrived_positions import ArrivedPositions
from furrowmap.core.readers.ouster.metadata import Metadata
from furrowmap.core.runtime.errors import Notice, RefusedError
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.session.proposal import recorded_session, with_recorded
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.machine import Machine, MachineRecord
from furrowmap.workflows.record.network import BUFFER_BYTES, PCAP_HEAD, USUAL_PORTS, Port, ScannerNetwork, Sender
from furrowmap.workflows.record.receivers import GnssReceiver, GnssSource
from furrowmap.workflows.record.storage import Series, Storage
from furrowmap.workflows.record.watch import Status, Watch
from furrowmap.workflows.session.machines import machine_for

SESSION: Final = "session.toml"
MAX_SCANNERS: Final = 4
"""That a session can have."""
LOOK_S: Final = 1.0
SWITCH_S: Final = 1e-4
"""After this time a thread that computes lets another one receive; Python's own are 5 ms, a packet each."""
LOGGED_S: Final = 60.0
"""Between two lines of the status in the log."""
ASK_AGAIN_S: Final = 10.0
MAX_METADATA_BYTES: Final = 1 << 20


@dataclass(frozen=True)
class Recorded:
    """A finished recording: its session file, and the last status, as in `status.json`."""

    session: Path
    status: Mapping[str, Any]


@dataclass(frozen=True)
class Told:
    """What is reported each second: the status, and the warnings that begin and end with it."""

    status: Status
    begun: Sequence[Notice] = ()
    ended: Sequence[Notice] = ()


def record(
    folder: str | Path,
    *,
    machine: str | Path | None = None,
    gnss: Sequence[str] | None = None,
    ports: Sequence[Sequence[int]] | None = None,
    roll_s: float = math.inf,
    roll_bytes: float = math.inf,
    duration_s: float = math.inf,
    told: Callable[[Told], None] = lambda _: None,
) -> Recorded:
    """Record what scanners send over UDP, and GNSS receivers over serial devices, TCP or UDP.

    Writes captures (`lidar-ADDRESS-NNNN.pcap`), logs as received (`gnss-NNNN.log`), `session.toml`, `status.json` and
    `record.log` into the folder, and goes on with one that holds an earlier recording. It ends after `duration_s`, or
    with the KeyboardInterrupt of the main thread.

    Args:
        machine: name or file of the profile of the machine: its places and learned implements go into the session,
            its `[record]` states ports and receivers where the arguments do not.
        gnss: sources of receivers: DEVICE, DEVICE:BAUD, tcp://HOST:PORT or udp://:PORT.
        ports: UDP ports of each scanner; by default one list with the usual ports. Scanners of different addresses
            are told apart without it.
        roll_s: age of a capture from which on the next one is begun.
        roll_bytes: size of a file from which on the next one is begun.
        told: is called about once a second.

    Raises:
        InputError: if there is no such machine.
        OSError: if the folder cannot be written to.
        RefusedError: if a port is in use.
        UsageError: if a source is none.
    """
    folder = Path(folder)
    profile, lacking = machine_for(machine, folder) if machine is not None else (Machine(), [])
    stated = profile.record or MachineRecord()
    gnss, ports = gnss or stated.gnss, ports or (stated.ports,)
    for source in gnss:
        GnssSource.parse(source)
    interval_s = _prepare()
    lasting = [*lacking, *([] if gnss else [Notice("record-no-gnss")])]
    opened = open_ports(ports, lasting)
    folder.mkdir(parents=True, exist_ok=True)
    storage = Storage(folder)

    def new_series(address: str, scanner: int) -> Series:
        stem = f"lidar-{address}" + (f"-{ports[scanner][0]}" if len(ports) > 1 else "")
        return Series(folder, stem, ".pcap", PCAP_HEAD, roll_s=roll_s, roll_bytes=roll_bytes)

    network = ScannerNetwork(opened, storage, new_series)
    receivers = [
        GnssReceiver(source, storage, Series(folder, f"gnss{k or ''}", ".log", roll_bytes=roll_bytes))
        for k, source in enumerate(gnss)
    ]
    watch = Watch(network, receivers, storage, lasting)
    recording = _Recording(folder, profile, watch)
    ends_s = time.monotonic() + duration_s
    try:
        while (left_s := ends_s - time.monotonic()) > 0.0:
            time.sleep(min(LOOK_S, left_s))
            told(recording.note(watch.look()))
    except KeyboardInterrupt:
        pass
    finally:
        network.stop()
        for receiver in receivers:
            receiver.stop()
        storage.drain()
        status = watch.look("ended")
        recording.note(status)
        storage.close()
        sys.setswitchinterval(interval_s)
    return Recorded(folder / SESSION, status.values)


def _prepare() -> float:
    """Do first what takes long: while Python computes, it hardly receives. Returns the interval of switches before."""
    ArrivedPositions.prepare()
    choose_crs(139.7, 35.7)
    gc.collect()
    gc.freeze()  # later collections leave out what the libraries have made
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    return interval_s


def open_ports(stated: Sequence[Sequence[int]], lasting: list[Notice]) -> list[Port]:
    """The ports, open; usual ports that are not stated and are in use, and small buffers, are added to the notices."""
    opened = []
    for scanner, numbers in enumerate(stated):
        for number in numbers or USUAL_PORTS:
            try:
                opened.append(Port.open(number, scanner))
            except RefusedError as error:
                if numbers:
                    raise
                lasting.append(Notice.from_error(error))
    granted = min((port.granted_bytes for port in opened), default=BUFFER_BYTES)
    if granted < BUFFER_BYTES:
        lasting.append(Notice("record-buffer", asked=BUFFER_BYTES, granted=granted))
    return opened


class _Recording:
    """Session, status file and log of a recording, and the metadata of its sensors."""

    def __init__(self, folder: Path, machine: Machine, watch: Watch) -> None:
        self._folder, self._watch, self._storage = folder, watch, watch.storage
        self._machine = machine
        self._text = ""
        self._crs: CrsChoice | None = None
        self._warnings: Mapping[str, Notice] = {}
        self._logged_s = -math.inf
        self._asked: set[str] = set()
        for port in watch.network.ports:
            self._log(f"port {port.number}: buffer of {BUFFER_BYTES} bytes asked, {port.granted_bytes} granted")

    def note(self, status: Status) -> Told:
        """Write the status, the session where it changed, and the log."""
        told = Told(
            status,
            [notice for name, notice in status.warnings.items() if name not in self._warnings],
            [notice for name, notice in self._warnings.items() if name not in status.warnings],
        )
        self._warnings = status.warnings
        for notice in told.begun:
            self._log(f"warning {notice.code}: {notice.text_in(language_of_user())}")
        for notice in told.ended:
            self._log(f"over {notice.code}: {notice.text_in(language_of_user())}")
        if time.monotonic() - self._logged_s >= LOGGED_S or status.values["state"] == "ended":
            self._logged_s = time.monotonic()
            self._log(status.summary.text_in(language_of_user()))
        self._note_session(status)
        self._storage.replace("status.json", json_text(status.values))
        return told

    def _log(self, text: str) -> None:
        self._storage.log(f"{iso_utc(time.time())} {text}")

    def _note_session(self, status: Status) -> None:
        """Write the session, with all scanners: first those that it names already."""
        watch = self._watch
        gnss = next((each.series.files for each in watch.receivers if each.arrived.format), list[str]())
        place = next((each for each in status.values["gnss"] if math.isfinite(each["lon_deg"])), None)
        if self._crs is None and place is not None:
            self._crs = choose_crs(place["lon_deg"], place["lat_deg"])
        heard = list(watch.network.senders.values())
        senders = [sender for sender in heard if sender.arrived.maker]
        senders = senders or [sender for sender in heard if sender.arrived.unread]  # a run says what it cannot read
        text = self._text or self._session_there() or recorded_session(self._folder.resolve().name, self._machine)
        scanners = [each.series for each in senders if each.series.files]
        scanners.sort(key=lambda each: text.find(f'"{each.stem}-') % (len(text) + 1))
        files = [each.files for each in scanners[:MAX_SCANNERS]]
        with suppress(RefusedError, ValueError):  # one that was there, and is written in another way: it is kept
            text = with_recorded(text, files, gnss, self._crs, self._machine)
        if text != self._text:
            self._text = text
            self._storage.replace(SESSION, text, durable=True)
        for sender in senders:
            if sender.arrived.maker == "Ouster" and sender.address not in self._asked:
                self._asked.add(sender.address)
                threading.Thread(target=self._ask_metadata, args=(sender,), daemon=True).start()

    def _session_there(self) -> str:
        """The session of an earlier recording into the folder, with what its user has filled in; empty without one."""
        with suppress(OSError, UnicodeDecodeError):
            return (self._folder / SESSION).read_text(encoding="utf-8")
        return ""

    def _ask_metadata(self, sender: Sender) -> None:
        """Ask an Ouster for its metadata, without which its packets cannot be decoded, until it answers."""
        while True:
            text = sensor_metadata(sender.address)
            if text:
                self._storage.replace(f"{sender.series.stem}.json", text, durable=True)
                return
            time.sleep(ASK_AGAIN_S)


def sensor_metadata(host: str) -> str:
    """The metadata of an Ouster sensor, by its HTTP API (firmware 2.1 and later); empty where it does not answer."""
    try:
        with urlopen(f"http://{host}/api/v1/sensor/metadata", timeout=5.0) as answer:
            text = answer.read(MAX_METADATA_BYTES).decode()
        return text if Metadata.parse(text, host) else ""
    except (OSError, ValueError):
        return ""
