"""What is watched during a recording: a status each second, and the warnings that hold at the moment."""

import math
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.gnss import Fix
from furrowmap.workflows.record.network import BUFFER_BYTES, ScannerNetwork
from furrowmap.workflows.record.receivers import GnssReceiver
from furrowmap.workflows.record.storage import Storage

STATUS_SCHEMA: Final = 1
STREAM_SILENT_S: Final = 2.0
"""From this on a scanner or a receiver that sends nothing is reported."""
RECENT_S: Final = 10.0
"""For this long the last loss, or jump of the clock, is reported."""
UNKNOWN_BYTES: Final = 4096
"""Bytes of a receiver without a message from which on its settings are wrong."""
UNSYNCED_S: Final = 1.0
HOURS_LEFT: Final = 1.0
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
    _started_s: float = field(default_factory=time.monotonic)
    _looked_s: float = field(default_factory=time.monotonic)
    _clock_s: float = field(default_factory=lambda: time.time() - time.monotonic())
    _jump_s: float = 0.0
    _counts: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Of each counter its last value, and when it changed last, by the monotonic clock."""

    def look(self, state: str = "recording") -> Status:
        """The status now; to be called about once a second."""
        now_s = time.monotonic()
        scanners = [self._scanner(key, now_s) for key in list(self.network.senders)]
        gnss = [self._gnss(receiver, now_s) for receiver in self.receivers]
        for port in self.network.ports:
            port.look()
        disk = self._disk(now_s)
        self._note_clock()
        self._looked_s = now_s
        warnings = {
            f"{notice.key} {subject}": notice
            for subject, notice in [
                *(("", notice) for notice in self.lasting),
                *self._of_scanners(scanners, now_s),
                *self._of_gnss(gnss),
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
            "warnings": [{"code": notice.code, "text": notice.text} for notice in warnings.values()],
        }
        return Status(values, _summary(values), warnings)

    def _scanner(self, key: tuple[str, int], now_s: float) -> dict[str, Any]:
        sender = self.network.senders[key]
        sender.arrived.look()
        before, _ = self._counts.get(f"packets {key}", (0, 0.0))
        self._count(f"packets {key}", sender.packets, now_s)
        return {
            "address": sender.address,
            "stem": sender.series.stem,
            "ports": sorted(sender.ports),
            "maker": sender.arrived.maker,
            "unread_maker": sender.arrived.unread,
            "file": sender.series.files[-1] if sender.series.files else None,
            "packets": sender.packets,
            "packets_per_s": round((sender.packets - before) / max(now_s - self._looked_s, 1e-3)),
            "bytes": sender.series.written,
            "age_s": now_s - sender.last_s,
            "lost": sender.arrived.lost,
            "pps": sender.arrived.pps or None,
        }

    def _gnss(self, receiver: GnssReceiver, now_s: float) -> dict[str, Any]:
        receiver.arrived.look()
        arrived = receiver.arrived
        return {
            "source": receiver.source,
            "format": arrived.format,
            "file": receiver.series.files[-1] if receiver.series.files else None,
            "bytes": receiver.series.written,
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
        senders = list(self.network.senders.values())
        series = [*(sender.series for sender in senders), *(receiver.series for receiver in self.receivers)]
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

    def _of_scanners(self, scanners: Sequence[Mapping[str, Any]], now_s: float) -> Iterator[tuple[str, Notice]]:
        known = [scanner for scanner in scanners if scanner["maker"]]
        unread = [scanner for scanner in scanners if scanner["unread_maker"]]
        for scanner in unread:
            yield scanner["address"], Notice("record-unread", source=scanner["address"], maker=scanner["unread_maker"])
        if not known + unread and self.network.ports and now_s - self._started_s > STREAM_SILENT_S:
            ports = ", ".join(str(port.number) for port in self.network.ports)
            yield "", Notice("record-no-packets", ports=ports, others=", ".join(s["address"] for s in scanners) or None)
        for scanner in known:
            address, pps = scanner["address"], scanner["pps"]
            if scanner["age_s"] > STREAM_SILENT_S:
                yield address, Notice("record-silent", source=address, age_s=scanner["age_s"])
            if self._count(f"lost {address}", scanner["lost"], now_s):
                yield address, Notice("record-lost", source=address, lost=scanner["lost"])
            if scanner["maker"] == "Ouster" and not (self.storage.folder / f"{scanner['stem']}.json").exists():
                yield address, Notice("record-no-metadata", source=address)
            if pps not in (None, "locked"):
                yield address, Notice("record-pps", source=address, state=pps)
        if self._count("ignored", self.network.ignored, now_s):
            yield "", Notice("record-senders", senders=len(scanners), ignored=self.network.ignored)

    def _of_gnss(self, gnss: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, Notice]]:
        for each in gnss:
            source = each["source"]
            if each["fault"]:
                yield source, Notice("record-gnss-fault", source=source, fault=each["fault"])
            elif each["age_s"] > STREAM_SILENT_S:
                yield source, Notice("record-gnss-silent", source=source, age_s=each["age_s"])
            elif not each["format"]:
                if each["bytes"] > UNKNOWN_BYTES:
                    yield source, Notice("record-gnss-unknown", source=source, count=each["bytes"])
            elif each["fix"] == Fix.NONE.label:
                yield source, Notice("record-no-fix", source=source)
            elif not CLOCK_S[0] < each["recorder_minus_gnss_s"] < CLOCK_S[1]:
                yield source, Notice("record-clock", source=source, off_s=each["recorder_minus_gnss_s"])

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
