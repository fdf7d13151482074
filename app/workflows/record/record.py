"""Recording what scanners and GNSS receivers send, until the end is asked for."""

import gc
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from furrowmap.core.geodesy.crs_choice import choose_crs
from furrowmap.core.readers.arrived_positions import ArrivedPositions
from furrowmap.core.runtime.errors import Notice, OptionError, RefusedError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.machine import Machine, MachineRecord
from furrowmap.workflows.record.gnss_source import GnssSource
from furrowmap.workflows.record.ouster_metadata import MetadataAsker
from furrowmap.workflows.record.receivers import GnssReceiver
from furrowmap.workflows.record.recorded_session import SESSION_FILE, SessionFile
from furrowmap.workflows.record.recorder import Recorder, ThreadEnds
from furrowmap.workflows.record.recording_files import Storage
from furrowmap.workflows.record.senders import Senders
from furrowmap.workflows.record.series import Series
from furrowmap.workflows.record.small_files import SmallFiles
from furrowmap.workflows.record.udp_packets import BUFFER_BYTES, PCAP_HEAD, USUAL_PORTS, Port, ScannerNetwork
from furrowmap.workflows.record.watch import Status, Watch
from furrowmap.workflows.session.known_machines import machine_for

SWITCH_S: Final = 1e-4
"""After this time a thread that computes lets another one receive; Python's own are 5 ms, a packet each."""
STATUS_POLL_S: Final = 0.05


@dataclass(frozen=True)
class Recorded:
    """A finished recording: its session file, and the last status, as in `status.json`."""

    session: Path
    status: Mapping[str, Any]

    @property
    def is_complete(self) -> bool:
        """Whether nothing is known to be lost, and no part of the recorder was ended by a fault."""
        return bool(self.status["complete"])


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
    with the KeyboardInterrupt of the main thread. A part that is ended by any fault is begun again, which the status
    says.

    Args:
        machine: name or file of the profile of the machine: its places and learned implements go into the session,
            its `[record]` states ports and receivers where the arguments do not. Scanners whose `source` it states come
            first.
        gnss: sources of receivers: DEVICE, DEVICE:BAUD, tcp://HOST:PORT, udp://:PORT or udp://HOST:PORT.
        ports: UDP ports of each scanner; by default one list with the usual ports. Scanners of different addresses
            are told apart without it.
        roll_s: age of a capture from which on the next one is begun.
        roll_bytes: size of a file from which on the next one is begun.
        told: is called about once a second; what it raises is logged, and ends nothing but for a KeyboardInterrupt.

    Raises:
        InputError: if there is no such machine.
        OSError: if the folder cannot be written to.
        RefusedError: if a port is in use.
        UsageError: if a source or a port is none.
    """
    folder = Path(folder)
    profile, lacking = machine_for(machine, folder) if machine is not None else (Machine(), [])
    stated = profile.record or MachineRecord()
    gnss = gnss or stated.gnss
    ports = ports or (stated.ports,)
    for source in gnss:
        GnssSource.parse(source)
    interval_s = _prepare()
    opened, doubts = open_ports(ports)
    lasting = [*lacking, *([] if gnss else [Notice("record-no-gnss")]), *doubts]
    folder.mkdir(parents=True, exist_ok=True)

    def new_series(address: str, scanner: int) -> Series:
        stem = f"lidar-{address}" + (f"-{ports[scanner][0]}" if len(ports) > 1 else "")
        return Series(folder, stem, ".pcap", PCAP_HEAD, roll_s=roll_s, roll_bytes=roll_bytes)

    def new_log(receiver: int, address: str) -> Series:
        stem = f"gnss{receiver or ''}" + (f"-from-{address.replace(':', '_')}" if address else "")
        return Series(folder, stem, ".log", roll_bytes=roll_bytes)

    small = SmallFiles(folder)
    ends = ThreadEnds(small)
    storage = Storage(folder, small, ends.note)
    network = ScannerNetwork(opened, storage, Senders(_stated_addresses(profile), new_series), ends.note)
    receivers = [GnssReceiver(source, storage, partial(new_log, k), ends.note) for k, source in enumerate(gnss)]
    asker = MetadataAsker(small, ends.note)
    watch = Watch(network, receivers, storage, lasting, [asker.thread])
    recorder = Recorder(watch, SessionFile(folder, profile, watch), asker, ends)
    for port in opened:
        recorder.log(f"port {port.number}: buffer of {BUFFER_BYTES} bytes asked, {port.granted_bytes} granted")
    try:
        _tell_until(time.monotonic() + duration_s, recorder, told)
    except KeyboardInterrupt:
        pass
    finally:
        sys.setswitchinterval(interval_s)
        status = recorder.end()
    return Recorded(folder / SESSION_FILE, status.values)


def _tell_until(ends_s: float, recorder: Recorder, told: Callable[[Told], None]) -> None:
    """Report each second, and at once where a part of the recorder was ended."""
    seen: Mapping[str, Notice] = {}
    reported: Status | None = None
    while time.monotonic() < ends_s:
        recorder.ensure()
        status = recorder.status
        if status is reported or status is None:
            time.sleep(min(STATUS_POLL_S, max(0.0, ends_s - time.monotonic())))
            continue
        reported = status
        begun = [notice for name, notice in status.warnings.items() if name not in seen]
        ended = [notice for name, notice in seen.items() if name not in status.warnings]
        seen = status.warnings
        try:
            told(Told(status, begun, ended))
        except Exception as error:  # noqa: BLE001 a terminal that is gone must not end the recording
            recorder.note_screen(error)


def _stated_addresses(machine: Machine) -> list[str]:
    """The addresses of the machine's scanners, as far as it states them."""
    lidars = [machine.lidar, *machine.further_lidars]
    return [lidar.source for lidar in lidars if lidar is not None and lidar.source]


def _prepare() -> float:
    """Do first what takes long: while Python computes, it hardly receives. Returns the interval of switches before."""
    ArrivedPositions.prepare()
    choose_crs(139.7, 35.7)
    gc.collect()
    gc.freeze()  # later collections leave out what the libraries have made
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    return interval_s


def open_ports(stated: Sequence[Sequence[int]]) -> tuple[list[Port], list[Notice]]:
    """The ports, open, and notices of usual ports that are not stated and are in use, and of small buffers."""
    opened = []
    notices = []
    for scanner, numbers in enumerate(stated):
        for number in numbers or USUAL_PORTS:
            if not 0 < number < 1 << 16:
                wanted = Text("UDP ports from 1 to 65535")
                raise OptionError("--ports", number, wanted, "2368,8308")
            try:
                opened.append(Port.open(number, scanner))
            except RefusedError as error:
                if numbers:
                    raise
                notices.append(Notice.from_error(error))
    granted = min((port.granted_bytes for port in opened), default=BUFFER_BYTES)
    if granted < BUFFER_BYTES:
        notices.append(Notice("record-buffer", asked=BUFFER_BYTES, granted=granted))
    return opened, notices
