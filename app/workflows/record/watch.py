"""What is watched during a recording: a status each second, and the warnings that hold at the moment."""

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.supervised import SupervisedThread, cause_of
from furrowmap.core.values.gnss import Fix
from furrowmap.workflows.record.receivers import MAX_BYTES_PER_S, GnssReceiver
from furrowmap.workflows.record.recording_files import Storage
from furrowmap.workflows.record.senders import Rank, Sender
from furrowmap.workflows.record.udp_packets import BUFFER_BYTES, ScannerNetwork

STATUS_SCHEMA: Final = 1
STREAM_SILENT_S: Final = 2.0
"""From this on a scanner or a receiver that sends nothing is reported."""
RECENT_S: Final = 10.0
"""For this long the last loss, or jump of the clock, is reported."""
UNKNOWN_BYTES: Final = 4096
"""Bytes of a receiver without a message from which on its settings are wrong."""
UNSYNCED_S: Final = 1.0
HOURS_LEFT: Final = 1.0
SESSION_SCANNERS: Final = 4
"""That a session can have."""
MAX_EXAMPLES: Final = 4
"""Addresses of others that are named."""
CLOCK_S: Final = (-0.1, 1.5)
"""Usual range of the times of arrival minus the times in the messages: a receiver needs up to a second to send them."""
JUMP_S: Final = 0.1
"""NTP moves a clock by 0.0005 s a second at most, or sets it."""


@dataclass(frozen=True)
class Status:
    """A recording at one moment: values as in `status.json`, one line, and the warnings that hold, by name."""

    values: Mapping[str, Any]
    summary: Notice
    warnings: Mapping[str, Notice]


@dataclass
class Watch:
    """Looks at the threads of a recording; `lasting` are the warnings that hold from its start to its end."""

    network: ScannerNetwork
    receivers: Sequence[GnssReceiver]
    storage: Storage
    lasting: Sequence[Notice]
    further_threads: Sequence[SupervisedThread] = ()
    _started_s: float = field(default_factory=time.monotonic)
    _looked_s: float = field(default_factory=time.monotonic)
    _clock_s: float = field(default_factory=lambda: time.time() - time.monotonic())
    _jump_s: float = 0.0
    _counts: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Of each counter its last value, and when it changed last, by the monotonic clock."""
    _not_understood: dict[str, tuple[str, float]] = field(default_factory=dict)
    """Of senders, receivers and the session: why they could not be looked at the last time, and when that was."""

    @property
    def threads(self) -> list[SupervisedThread]:
        """All threads of the recording."""
        receivers = [receiver.thread for receiver in self.receivers]
        return [self.network.thread, *receivers, *self.storage.threads, *self.further_threads]

    def look(self, state: str = "recording") -> Status:
        """The status now; to be called about once a second."""
        now_s = time.monotonic()
        senders = self.network.senders.first_ones
        scanners = [self._scanner(sender, now_s) for sender in senders]
        gnss = [self._gnss(receiver, now_s) for receiver in self.receivers]
        for port in self.network.ports:
            port.look()
        disk = self._disk(now_s)
        threads = [_thread(thread, now_s) for thread in self.threads]
        self._note_clock()
        self._looked_s = now_s
        warnings = {
            f"{notice.key} {subject}": notice
            for subject, notice in [
                *self._of_threads(threads),
                *(("", notice) for notice in self.lasting),
                *self._of_scanners(scanners, now_s),
                *self._of_senders(scanners, now_s),
                *self._of_gnss(gnss, now_s),
                *self._of_machine(disk, now_s),
            ]
        }
        values = {
            "schema": STATUS_SCHEMA,
            "state": state if state != "recording" or not self.storage.fault else "waiting-for-space",
            "pid": os.getpid(),
            "time_s": time.time(),
            "elapsed_s": now_s - self._started_s,
            "scanners": scanners,
            "gnss": gnss,
            "ignored": {
                "packets": self.network.senders.ignored,
                "addresses": list(self.network.senders.ignored_of)[:MAX_EXAMPLES],
            },
            "sockets": [
                {
                    "port": port.number,
                    "asked_bytes": BUFFER_BYTES,
                    "granted_bytes": port.granted_bytes,
                    "dropped": port.dropped,
                }
                for port in self.network.ports
            ],
            "disk": disk,
            "threads": threads,
            "complete": self._is_complete(scanners, threads),
            "warnings": [{"code": notice.code, **notice.texts} for notice in warnings.values()],
        }
        return Status(values, _summary(values), warnings)

    def _is_complete(self, scanners: Sequence[Mapping[str, Any]], threads: Sequence[Mapping[str, Any]]) -> bool:
        """Whether all that scanners and receivers sent is recorded, as far as it is known."""
        known = [scanner for scanner in scanners if scanner["maker"] or scanner["unread_maker"]]
        lost = sum(scanner["lost"] for scanner in scanners) + sum(port.dropped or 0 for port in self.network.ports)
        ignored = 0 if known else self.network.senders.ignored  # one of them may have been the scanner
        return not (lost or ignored or self.storage.discarded_bytes or any(thread["ends"] for thread in threads))

    def _understand(self, subject: str, look: Callable[[], None]) -> None:
        """Look at what arrived. It is recorded already, whatever looking at hostile bytes raises."""
        try:
            look()
        except Exception as error:  # noqa: BLE001 it is recorded already, whatever hostile bytes raise here
            self.note_fault(subject, error)

    def note_fault(self, subject: str, error: Exception) -> None:
        """What could not be looked at, or shown."""
        self._not_understood[subject] = (cause_of(error), time.monotonic())

    def _scanner(self, sender: Sender, now_s: float) -> dict[str, Any]:
        key = f"packets {sender.series.stem}"
        self._understand(sender.address, sender.arrived.look)
        before, _ = self._counts.get(key, (0, 0.0))
        self._count(key, sender.packets, now_s)
        return {
            "address": sender.address,
            "stem": sender.series.stem,
            "ports": sorted(sender.ports.copy()),
            "maker": sender.arrived.maker,
            "unread_maker": sender.arrived.unread,
            "stated": sender.rank is Rank.STATED,
            "file": sender.series.files[-1] if sender.series.files else None,
            "packets": sender.packets,
            "packets_per_s": max(0, round((sender.packets - before) / max(now_s - self._looked_s, 1e-3))),
            "bytes": sender.series.written,
            "discarded_bytes": sender.series.discarded_bytes,
            "age_s": now_s - sender.last_s,
            "lost": sender.arrived.lost,
            "pps": sender.arrived.pps or None,
        }

    def _gnss(self, receiver: GnssReceiver, now_s: float) -> dict[str, Any]:
        self._understand(receiver.source, receiver.look)
        arrived = receiver.arrived
        files = receiver.files
        return {
            "source": receiver.source,
            "sender": receiver.sender,
            "format": arrived.format,
            "file": files[-1] if files else None,
            "bytes": sum(series.written for series in receiver.all_series),
            "discarded_bytes": sum(series.discarded_bytes for series in receiver.all_series),
            "foreign_messages": receiver.foreign,
            "age_s": now_s - receiver.last_s,
            "fault": receiver.fault,
            "fix": arrived.fix.label,
            "satellites": arrived.satellites,
            "gnss_time_s": arrived.t_s,
            "lon_deg": arrived.lon_deg,
            "lat_deg": arrived.lat_deg,
            "recorder_minus_gnss_s": arrived.late_s,
        }

    def _disk(self, now_s: float) -> dict[str, Any]:
        storage = self.storage
        try:
            free_bytes = max(0, storage.free_bytes)
        except OSError:
            free_bytes = 0
        series = [sender.series for sender in self.network.senders.first_ones]
        series += [each for receiver in self.receivers for each in receiver.all_series]
        rate = sum(each.written for each in series) / max(now_s - self._started_s, 1.0)
        return {
            "free_bytes": free_bytes,
            "hours_left": free_bytes / rate / 3600.0 if rate else None,
            "fault": storage.fault,
            "unsynced_s": storage.unsynced_s,
            "most_unsynced_s": storage.most_unsynced_s,
            "waiting_bytes": storage.waiting_bytes,
            "discarded_bytes": storage.discarded_bytes,
        }

    def _note_clock(self) -> None:
        clock_s = time.time() - time.monotonic()
        if abs(clock_s - self._clock_s) > JUMP_S:
            self._jump_s = clock_s - self._clock_s
            self._count("jumps", clock_s, self._looked_s)
        self._clock_s = clock_s

    def _count(self, name: str, value: float, now_s: float) -> bool:
        """Note a counter, which began at 0; whether it changed recently."""
        last, changed_s = self._counts.get(name, (0, -math.inf))
        if value != last:
            changed_s = now_s
        self._counts[name] = value, changed_s
        return now_s - changed_s < RECENT_S

    def _is_down(self, thread: SupervisedThread) -> bool:
        """Whether a thread was ended just now: what it has not received says nothing about cables."""
        recently = thread.ends > 0 and time.monotonic() - thread.ended_s < RECENT_S
        return not thread.stopping.is_set() and (recently or not thread.is_working)

    def _of_threads(self, threads: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, Notice]]:
        for thread in threads:
            if thread["ends"] and (thread["age_s"] < RECENT_S or not thread["is_working"]):
                subject = f"{thread['name']} {thread['ends']}"  # a further end is a further alarm
                yield (
                    subject,
                    Notice("record-thread", part=thread["name"], cause=thread["cause"], ends=thread["ends"]),
                )
        for subject, (cause, failed_s) in self._not_understood.copy().items():
            if time.monotonic() - failed_s < RECENT_S:
                yield subject, Notice("record-not-understood", source=subject, cause=cause)
        for name, fault in self.storage.small.faults.copy().items():
            yield name, Notice("record-small-file", name=name, fault=fault)

    def _of_scanners(self, scanners: Sequence[Mapping[str, Any]], now_s: float) -> Iterator[tuple[str, Notice]]:
        known = [scanner for scanner in scanners if scanner["maker"]]
        unread = [scanner for scanner in scanners if scanner["unread_maker"]]
        is_down = self._is_down(self.network.thread)
        for scanner in unread:
            yield scanner["address"], Notice("record-unread", source=scanner["address"], maker=scanner["unread_maker"])
        late = self.network.ports and now_s - self._started_s > STREAM_SILENT_S
        if not known + unread and late and not is_down:
            ports = ", ".join(str(port.number) for port in self.network.ports)
            heard = scanners or self.network.senders.ignored or any(port.dropped for port in self.network.ports)
            if heard:
                others = [scanner["address"] for scanner in scanners] or list(self.network.senders.ignored_of)
                listed = ", ".join(others[:MAX_EXAMPLES])
                yield "", Notice("record-unknown-packets", ports=ports, others=listed or None)
            else:
                yield "", Notice("record-no-packets", ports=ports)
        for scanner in known:
            address = scanner["address"]
            pps = scanner["pps"]
            if scanner["age_s"] > STREAM_SILENT_S and not is_down:
                yield address, Notice("record-silent", source=address, age_s=scanner["age_s"])
            if self._count(f"lost {scanner['stem']}", scanner["lost"], now_s):
                yield address, Notice("record-lost", source=address, lost=scanner["lost"])
            if scanner["maker"] == "Ouster" and not (self.storage.folder / f"{scanner['stem']}.json").is_file():
                yield address, Notice("record-no-metadata", source=address)
            if pps not in (None, "locked"):
                yield address, Notice("record-pps", source=address, state=pps)

    def _of_senders(self, scanners: Sequence[Mapping[str, Any]], now_s: float) -> Iterator[tuple[str, Notice]]:
        senders = self.network.senders
        if self._count("ignored", senders.ignored, now_s):
            listed = ", ".join(list(senders.ignored_of)[:MAX_EXAMPLES])
            yield (
                "",
                Notice("record-senders", senders=len(senders.ignored_of), examples=listed, ignored=senders.ignored),
            )
        known = [scanner["address"] for scanner in scanners if scanner["maker"]]
        if len(known) > SESSION_SCANNERS:
            yield (
                "",
                Notice("record-many-scanners", scanners=len(known), most=SESSION_SCANNERS, listed=", ".join(known)),
            )

    def _of_gnss(self, gnss: Sequence[Mapping[str, Any]], now_s: float) -> Iterator[tuple[str, Notice]]:
        for each, receiver in zip(gnss, self.receivers, strict=True):
            source = each["source"]
            if self._count(f"foreign {source}", receiver.foreign, now_s):
                others = ", ".join(list(receiver.foreign_of)[:MAX_EXAMPLES])
                yield (
                    source,
                    Notice(
                        "record-gnss-senders",
                        source=source,
                        used=each["sender"] or None,
                        others=others,
                        count=receiver.foreign,
                    ),
                )
            if now_s - receiver.flooded_s < RECENT_S:
                yield source, Notice("record-gnss-flood", source=source, most=MAX_BYTES_PER_S / 1e6)
            if self._is_down(receiver.thread):
                continue
            yield from _of_positions(each)

    def _of_machine(self, disk: Mapping[str, Any], now_s: float) -> Iterator[tuple[str, Notice]]:
        dropped = {port.number: port.dropped or 0 for port in self.network.ports}
        for number, count in dropped.items():
            if self._count(f"dropped {number}", count, now_s):
                yield str(number), Notice("record-dropped", port=number, count=count)
        if self._counts.get("jumps", (0.0, -math.inf))[1] > now_s - RECENT_S:
            yield "", Notice("record-clock-jump", jump_s=self._jump_s)
        if disk["fault"]:
            yield "", Notice("record-disk", fault=disk["fault"], waiting=disk["waiting_bytes"] / 1e6)
        elif disk["hours_left"] is not None and disk["hours_left"] < HOURS_LEFT:
            yield "", Notice("record-disk-low", free=disk["free_bytes"] / 1e9, minutes=60.0 * disk["hours_left"])
        elif disk["unsynced_s"] > UNSYNCED_S:
            yield "", Notice("record-disk-slow", unsynced_s=disk["unsynced_s"])
        if self._count("discarded", disk["discarded_bytes"], now_s):
            yield "", Notice("record-discarded", discarded=disk["discarded_bytes"] / 1e6)


def _of_positions(gnss: Mapping[str, Any]) -> Iterator[tuple[str, Notice]]:
    """What is wrong with a receiver that is listened to."""
    source = gnss["source"]
    if gnss["fault"]:
        yield source, Notice("record-gnss-fault", source=source, fault=gnss["fault"])
    elif gnss["age_s"] > STREAM_SILENT_S:
        yield source, Notice("record-gnss-silent", source=source, age_s=gnss["age_s"])
    elif not gnss["format"]:
        if gnss["bytes"] > UNKNOWN_BYTES:
            yield source, Notice("record-gnss-unknown", source=source, count=gnss["bytes"])
    elif gnss["fix"] == Fix.NONE.label:
        yield source, Notice("record-no-fix", source=source)
    elif not CLOCK_S[0] < gnss["recorder_minus_gnss_s"] < CLOCK_S[1]:
        yield source, Notice("record-clock", source=source, off_s=gnss["recorder_minus_gnss_s"])


def _thread(thread: SupervisedThread, now_s: float) -> dict[str, Any]:
    """A thread in the status."""
    return {
        "name": thread.name,
        "is_working": thread.is_working,
        "ends": thread.ends,
        "cause": thread.cause,
        "age_s": now_s - thread.ended_s if thread.ends else None,
    }


def _summary(values: Mapping[str, Any]) -> Notice:
    scanners = [scanner for scanner in values["scanners"] if scanner["maker"]]
    gnss = next((each for each in values["gnss"] if each["format"]), None)
    minutes, seconds = divmod(int(values["elapsed_s"]), 60)
    lost = sum(scanner["lost"] for scanner in scanners) + sum(port["dropped"] or 0 for port in values["sockets"])
    return Notice(
        "record-status",
        elapsed=f"{minutes // 60}:{minutes % 60:02d}:{seconds:02d}",
        rate=sum(scanner["packets_per_s"] for scanner in scanners),
        lost=lost,
        fix=gnss["fix"].replace("_", " ") if gnss else None,
        satellites=gnss["satellites"] if gnss else None,
        pps=next((scanner["pps"] for scanner in scanners if scanner["pps"]), None),
        hours=f"{values['disk']['hours_left']:.1f}" if values["disk"]["hours_left"] is not None else None,
    )
