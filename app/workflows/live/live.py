"""Watch a session while it is recorded: the loop from packets to the page and the outlets."""

import json
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any, Final

import numpy as np

from furrowmap.core.coverage.field_boundary import field_boundary
from furrowmap.core.coverage.field_left import FieldLeft
from furrowmap.core.coverage.worked_cells import MISSED, NOT_SEEN, OVERLAP, WORKED, Tile
from furrowmap.core.implement.saved import load_implement
from furrowmap.core.live.difference import LIVE_LOG, LOGGED
from furrowmap.core.live.live_session import LiveScan, LiveSession, warm_up
from furrowmap.core.readers.arrived_scans import ScanStream
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice, UsageError
from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.core.runtime.supervised import SupervisedThread
from furrowmap.core.session.opened import OpenSession, open_session
from furrowmap.core.session.proposal import FILL_IN
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Scan
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.plain_files import append_to
from furrowmap.workflows.live.background_map import BackgroundMap, open_background
from furrowmap.workflows.live.feeds import FolderFeed, PlayedFeed, first_packet_s, recorder_status
from furrowmap.workflows.live.followed_scanner import with_followed_scanner
from furrowmap.workflows.live.mqtt import MqttOutlet
from furrowmap.workflows.live.nmea import sentences
from furrowmap.workflows.live.repairs import Repairs
from furrowmap.workflows.live.server import BoundedServer, Hub, PageServer, Pictures, event, serve_lines

BACKLOG_S: Final = 0.3
"""A scan that came longer ago is not looked at while newer ones wait."""
POSE_EVERY_S: Final = 0.2
CELLS_EVERY_S: Final = 0.5
FIGURES_EVERY_S: Final = 1.0
RATE_OVER_S: Final = 120.0
OPEN_EVERY_S: Final = 1.0
PLACED_WITHIN_M: Final = 1000.0
HEADLAND_WIDTHS: Final = 2.0
"""Of the tool, along the boundary: where the headland is drawn, so that passes can end there."""
ENDED_SHOWN_S: Final = 10.0
END_STEP_S: Final = 0.5
EARLY_S: Final = 1.6
"""A scan of before the scanner's clock was known is looked at if it came no longer ago."""


@dataclass(frozen=True)
class LiveSummary:
    """What a live session saw.

    Attributes:
        scans: looked at.
        posed: of these with a pose.
        early: came before the scanner's clock was known, or 0.3 s after; those of the last second are looked at then.
        dropped: not looked at in time, because newer ones were waiting.
        not_seen_m2: on which it is not known what the tool did, in the map's plane.
        lost_packets: of the scanner.
        worked_m2, overlap_m2, missed_m2: in the map's plane.
        delays_s: from the last packet of a scan to its pose, without early ones: median, 99.9 %, the longest.
    """

    scans: int = 0
    posed: int = 0
    early: int = 0
    dropped: int = 0
    lost_packets: int = 0
    worked_m2: float = 0.0
    overlap_m2: float = 0.0
    missed_m2: float = 0.0
    not_seen_m2: float = 0.0
    delays_s: tuple[float, float, float] = (math.nan, math.nan, math.nan)


def live(
    recording: str | Path,
    *,
    play: float = 0.0,
    host: str | Sequence[str] = "0.0.0.0",  # noqa: S104 (tablets on the local network look at it)
    port: int | None = 8080,
    nmea_port: int | None = 10110,
    mqtt: str | None = None,
    background: str | Path | None = None,
    language: str | None = None,
    on_scan: Callable[[dict[str, Any]], None] | None = None,
    stop: Event | None = None,
) -> LiveSummary:
    """Watch a session while it is recorded, until the recorder ends, `stop` is set, or a KeyboardInterrupt.

    What was not shown in time is worked out from the recording: with what time is left, and after its end.

    Args:
        recording: the folder that `furrowmap record` writes; with `play` the session file of an earlier recording.
        play: play the recording as it came in, so many times as fast; infinite for as fast as it can be looked at.
        host: address of this computer at which page and outlet are served; or that and further names by which the page
            is opened. Requests for other names than its own come from foreign pages, and are refused.
        port: of the page; None for no page, 0 for any that is free.
        nmea_port: of the outlet of NMEA sentences over TCP; None for none.
        mqtt: broker that messages are sent to: mqtt://[USER:PASSWORD@]HOST[:PORT][/TOPIC], or mqtts://.
        background: PMTiles or MBTiles file of raster tiles that are drawn below the ground worked.
        language: its code, such as "en", in which the page begins; by default that of its reader.
        on_scan: gets what is known with each scan, as values of JSON; before the first one what is waited for; at the
            end of the recording that it is over: the page stays until this returns.

    Raises:
        FurrowmapError: if the session cannot be used, or a port is taken.
    """
    stop = stop or Event()
    file = Path(recording) / "session.toml" if not play else Path(recording)
    if not play and not Path(recording).is_dir():
        raise UsageError("usage.live-folder", recording=recording)
    pictures = Pictures()
    outlets = Outlets(
        pictures,
        Hub(pictures.whole),
        Hub(),
        MqttOutlet(mqtt) if mqtt is not None else None,
        open_background(Path(background)) if background is not None else None,
        on_scan,
    )
    watch: LiveWatch | None = None
    threads = [outlets.mqtt.thread] if outlets.mqtt is not None else list[SupervisedThread]()
    with suppress(KeyboardInterrupt), ExitStack() as closing:
        if outlets.mqtt is not None:
            closing.callback(outlets.mqtt.close)
        threads += _serve([host] if isinstance(host, str) else host, port, nmea_port, outlets, language, closing)
        outlets.say_waiting({language: Notice("live-starts").text_in(language) for language in LANGUAGES})
        warm_up()  # while the recorder waits for its sensors
        opened = open_session(file) if play else _opened(file, outlets, stop)
        if opened is None:
            return LiveSummary()
        opened = with_followed_scanner(opened)
        session = _session(opened)
        closing.callback(session.close)
        scanner = opened.session.lidar
        scans = ScanStream((*opened.inputs.lidar, file)[0], scanner.model, scanner.source)
        folder = None if play else Path(recording)
        feed: FolderFeed | PlayedFeed = (
            PlayedFeed(opened, scans, play, stop)
            if folder is None
            else FolderFeed(folder, opened.session.recording, scans, stop)
        )
        threads += feed.threads
        repairs = Repairs(file, session)
        closing.callback(repairs.close)
        watch = LiveWatch(session, opened, scans, outlets, threads, repairs, folder)
        _follow(feed, watch, session, outlets, threads)
        watch.end(stop)
    return LiveSummary() if watch is None else watch.summary()


def _session(opened: OpenSession) -> LiveSession:
    """What is known while the recording comes in, with the implement as an earlier session learned it."""
    tools = opened.inputs.tools
    learned = load_implement(tools[0].learned) if tools and tools[0].learned is not None else None
    return LiveSession(opened.session, opened.frame, learned)


def _follow(
    feed: FolderFeed | PlayedFeed,
    watch: "LiveWatch",
    session: LiveSession,
    outlets: "Outlets",
    threads: Sequence[SupervisedThread],
) -> None:
    """Take what comes in until its end."""
    for piece in feed.pieces():
        for thread in threads:
            thread.ensure()
        if isinstance(piece.data, bytes):
            session.add_gnss(piece.data)
        elif isinstance(piece.data, GnssTrack):
            session.add_track(piece.data)
        elif isinstance(piece.data, list):
            watch.take(piece.data, piece.due_s, feed.status)
        else:
            outlets.wait_for(piece.data, feed.status.get("warnings", ()))


def _serve(
    hosts: Sequence[str],
    port: int | None,
    nmea_port: int | None,
    outlets: "Outlets",
    language: str | None,
    closing: ExitStack,
) -> list[SupervisedThread]:
    """Serve page and NMEA sentences until the end; the threads that do. Raises UsageError if a port is taken."""
    servers = list[BoundedServer]()
    try:
        if port is not None:
            servers.append(
                PageServer(hosts[0], port, outlets.page, language or "", outlets.background, names=hosts[1:])
            )
        if nmea_port is not None:
            servers.append(serve_lines(hosts[0], nmea_port, outlets.lines))
    except (OSError, OverflowError) as error:  # OverflowError: of a number that is no port
        fault = getattr(error, "strerror", None) or error
        raise UsageError("usage.live-port", port=port, nmea_port=nmea_port, error=fault) from None
    finally:
        for server in servers:
            closing.callback(server.shutdown)
    return [server.thread for server in servers]


def _opened(file: Path, outlets: "Outlets", stop: Event) -> OpenSession | None:
    """The session, as soon as the recorder has written it and knows where it is; None if stopped or ended before."""
    while not stop.is_set():
        try:
            return open_session(file)
        except FurrowmapError as error:
            begun = file.exists() and FILL_IN not in error.what
            status = recorder_status(file.parent)
            outlets.wait_for(error if begun else InputError("live-waits"), status.get("warnings", ()))
            if status.get("state") == "ended":
                return None
        stop.wait(OPEN_EVERY_S)
    return None


@dataclass(frozen=True)
class Outlets:
    """What learns of a live session, and the background of its page."""

    pictures: Pictures
    page: Hub
    lines: Hub
    mqtt: MqttOutlet | None
    background: BackgroundMap | None
    on_scan: Callable[[dict[str, Any]], None] | None

    def say(self, name: str, content: dict[str, Any]) -> None:
        """Tell page and broker."""
        self.page.publish(lambda: event(name, content))
        if self.mqtt is not None:
            self.mqtt.publish(name, content)

    def say_waiting(self, what: Mapping[str, str]) -> None:
        """Tell the page what is waited for, by language; readers who join later as well."""
        self.pictures.remember("waiting", event("waiting", what))
        self.page.publish(lambda: event("waiting", what))

    def wait_for(self, error: FurrowmapError, warnings: Sequence[dict[str, str]] = ()) -> None:
        """Tell page and caller what is missing, and the page what the recorder warns of."""
        said = [by_language(warning) for warning in warnings[:2]]
        content = {
            language: " ".join([error.lines_in(language)[0], *(text[language] for text in said)])
            for language in LANGUAGES
        }
        self.say_waiting(content)
        if self.on_scan is not None:
            self.on_scan({"waiting": error.what})


class LiveLog:
    """What was shown, by which a run says how much it differed: a new file, which follows no links.

    Attributes:
        fault: why it was not written the last time; None if it was.
    """

    def __init__(self, path: Path) -> None:
        self.fault: Notice | None = None
        self._path = path

    def begin(self, line: dict[str, Any]) -> None:
        """Begin it anew, with a line."""
        with self._noted(), atomic_output(self._path, durable=False) as unfinished:
            unfinished.write_text(json_line(line), encoding="utf-8")

    def append(self, line: dict[str, Any]) -> None:
        """Append a line."""
        with self._noted(), append_to(self._path) as file:
            file.write(json_line(line).encode("utf-8"))

    @contextmanager
    def _noted(self) -> Iterator[None]:
        """On a full disk, or where something else has its name, lines are left out."""
        try:
            yield
            self.fault = None
        except (OSError, FurrowmapError) as error:
            self.fault = Notice("live-log", name=self._path.name, fault=str(error).partition("\n")[0])


def json_line(value: dict[str, Any]) -> str:
    """A line of JSON."""
    return json.dumps(value, separators=(",", ":")) + "\n"


def thread_fault(thread: SupervisedThread) -> Notice | None:
    """That a thread was ended by an exception in the last seconds; None if it was not."""
    if not thread.ends or time.monotonic() - thread.ended_s > ENDED_SHOWN_S:
        return None
    return Notice("live-thread", part=thread.name, cause=thread.cause, ends=thread.ends)


class LiveWatch:
    """Takes scans, looks at those that are new, and tells the readers."""

    def __init__(
        self,
        session: LiveSession,
        opened: OpenSession,
        stream: ScanStream,
        outlets: Outlets,
        threads: Sequence[SupervisedThread],
        repairs: Repairs,
        folder: Path | None = None,
    ) -> None:
        self._session = session
        self._opened = opened
        self._frame = opened.frame
        self._stream = stream
        self._to = outlets
        self._scans = self._posed = self._early = self._dropped = 0
        self._begun_s = math.nan
        self._delays = np.zeros(10_001, np.int64)  # counted by milliseconds, so that memory does not grow
        self._changed: set[Tile] = set()
        self._told_s = {"pose": -math.inf, "cells": -math.inf, "figures": -math.inf}
        self._areas: deque[tuple[float, float]] = deque()
        self._placed_m: tuple[float, float] | None = None
        self._threads = threads
        self._repairs = repairs
        self._levelled = False
        self._field: FieldLeft | None = None
        self._last: tuple[LiveScan, dict[str, Any]] | None = None
        self._folder = folder
        self._log = LiveLog(folder / LIVE_LOG) if folder is not None else None
        if self._log is not None:
            self._log.begin({"crs": opened.frame.name})

    def take(self, scans: list[Scan], due_s: float, status: dict[str, Any]) -> None:
        """Look at scans, the last of which is complete since `due_s`, unless newer ones wait."""
        if scans and math.isnan(self._begun_s):
            self._begin(scans[0])
        for scan in scans:
            scan_due_s = due_s - float(scans[-1].t_s[-1] - scan.t_s[-1])
            late_s = time.time() - scan_due_s
            early = scan_due_s < self._begun_s + BACKLOG_S  # while the first ones are looked at, others wait
            self._early += early
            if late_s > (EARLY_S if early else BACKLOG_S):
                self._dropped += not early
                behind_s = self._opened.session.recording.lidar_minus_gnss_s or 0.0
                if len(scan):
                    self._repairs.lose(float(scan.t_s[0]) - behind_s, float(scan.t_s[-1]) - behind_s)
                continue
            seen = self._session.add_scan(scan)
            if seen is not None:
                self._tell(seen, time.time() - scan_due_s, status)
                if not early:
                    self._delays[np.clip(round(1e3 * (time.time() - scan_due_s)), 0, 10_000)] += 1

    def _begin(self, scan: Scan) -> None:
        """The first scan has come: what was recorded before was not shown."""
        self._begun_s = time.time()
        self._to.pictures.remember("waiting")
        if math.isfinite(self._stream.utc_minus_host_s):
            self._repairs.utc_minus_host_s = self._stream.utc_minus_host_s
        if self._folder is not None and len(scan):
            with suppress(FurrowmapError, OSError):
                began_s = first_packet_s(self._opened.inputs.lidar[0]) + self._repairs.utc_minus_host_s
                self._repairs.lose(began_s, float(scan.t_s[0]))

    def end(self, stop: Event) -> None:
        """No more scans come: what was recorded but not shown is worked out."""
        self._changed |= self._session.finish()
        while self._last is not None and not stop.is_set():
            if not self._session.learns_on() and not self._repairs.can_go_on():
                break
            self._say_end(is_over=False)
            stop.wait(END_STEP_S)
        self._say_end(is_over=True)

    def _say_end(self, *, is_over: bool) -> None:
        """Tell the readers what is known after the last scan."""
        if self._last is None:
            return
        seen, status = self._last
        self._changed |= self._repairs.step(seen.t_s, is_over=True)
        self._changed |= self._session.finish()
        self._put_cells()
        figures = self._figures(seen, status, is_over=True)
        self._to.say("figures", figures)
        if is_over:
            self._append(figures, seen)
            pose = self._pose_json(seen, 0.0)
            for name, content in (("pose", pose), ("figures", figures), ("over", {})):
                self._to.pictures.remember(name, event(name, content))
            self._to.say("over", {})
            if self._to.on_scan is not None:
                self._to.on_scan({"over": True})

    def summary(self) -> LiveSummary:
        """What was seen so far."""
        cells = self._session.cells
        counted = np.cumsum(self._delays)
        states = (WORKED, OVERLAP, MISSED, NOT_SEEN)
        worked, overlap, missed, not_seen = (cells.area_m2(s) if cells is not None else 0.0 for s in states)
        at = 1e-3 * np.searchsorted(counted, np.array([0.5, 0.999, 1.0]) * counted[-1])
        quantiles = tuple(at.tolist()) if counted[-1] else (math.nan,) * 3
        counts = (self._scans, self._posed, self._early, self._dropped, self._stream.lost_packets)
        return LiveSummary(*counts, worked, overlap, missed, not_seen, quantiles)

    def _tell(self, seen: LiveScan, delay_s: float, status: dict[str, Any]) -> None:
        pose, now_s = seen.pose, time.time()
        self._scans += 1
        self._changed |= seen.changed
        if pose is not None:
            self._posed += 1
            self._place(pose.xyz_m[0], pose.xyz_m[1])
            self._to.pictures.drive(pose.xyz_m[0], pose.xyz_m[1])
            self._to.lines.publish(lambda: sentences(pose, self._frame))
        elif self._session.antenna_m is not None:
            self._place(*self._session.antenna_m)
        if self._to.on_scan is not None:
            self._to.on_scan(as_json(seen) | {"delay_s": round(delay_s, 3), "dropped": self._dropped})
        self._last = seen, status
        if self._is_due("pose", POSE_EVERY_S, now_s):
            self._to.say("pose", self._pose_json(seen, delay_s))
        if self._changed and self._is_due("cells", CELLS_EVERY_S, now_s):
            self._put_cells()
        if self._is_due("figures", FIGURES_EVERY_S, now_s):
            if not self._levelled and self._session.knows_level:
                self._levelled = True
                self._repairs.lose(self._session.since_s, seen.t_s)
            self._changed |= self._repairs.step(seen.t_s)
            figures = self._figures(seen, status)
            self._to.say("figures", figures)
            if pose is not None:
                self._append(figures, seen)

    def _pose_json(self, seen: LiveScan, delay_s: float) -> dict[str, Any]:
        """What is known with a scan, and how far the edges of other passes are."""
        gaps_m = self._session.edge_gaps_m(seen.pose) if seen.pose is not None else (math.nan, math.nan)
        edge_m = [round(gap, 2) if math.isfinite(gap) else None for gap in gaps_m]
        antenna_m = self._session.antenna_m if seen.pose is None else None
        if antenna_m is not None:
            return as_json(seen) | {"antenna_m": [round(value, 2) for value in antenna_m]}
        return as_json(seen) | {"delay_s": round(delay_s, 3), "edge_m": edge_m}

    def _put_cells(self) -> None:
        """Tell the page which cells changed."""
        cells = self._session.cells
        changed = self._changed
        self._changed = set()
        if cells is None:
            return
        if self._field is not None:
            self._field.look_at(cells, changed)
        self._to.page.publish(lambda: self._to.pictures.changes(cells, changed))

    def _append(self, figures: dict[str, Any], seen: LiveScan) -> None:
        """Log what is shown."""
        if self._log is not None and seen.pose is not None:
            self._log.append({name: (figures | as_json(seen))[name] for name in LOGGED})

    def _place(self, e_m: float, n_m: float) -> None:
        """Tell where the map is, at first and where the background is not linear any more."""
        if self._placed_m is not None and math.dist(self._placed_m, (e_m, n_m)) < PLACED_WITHIN_M:
            return
        if self._placed_m is None:
            self._field = self._field_at(e_m, n_m)
        self._placed_m = round(e_m), round(n_m)
        background = self._to.background
        pictures = self._to.pictures
        implement = self._opened.session.implement
        about: dict[str, Any] = {
            "origin_m": self._placed_m,
            "background": background.place(self._frame, *self._placed_m) if background is not None else None,
            "tool": None if implement is None else {"xy_m": implement.xy_m, "width_m": implement.width_m},
            "field_m": [],
            "headland_m": [],
        }
        if self._field is not None and implement is not None:
            inner = self._field.rings(HEADLAND_WIDTHS * implement.width_m)
            about |= {"headland_m": [ring.round(2).tolist() for ring in inner]}
        if self._field is not None:
            about |= {"field_m": [ring.round(2).tolist() for ring in self._field.rings()]}
        self._to.page.publish(lambda: pictures.placed(about))

    def _field_at(self, e_m: float, n_m: float) -> FieldLeft | None:
        """The field of the session; None where it states none, or its file cannot be used."""
        file = self._opened.inputs.boundary
        if file is None:
            return None
        with suppress(FurrowmapError, OSError):
            boundary, _ = field_boundary(file, self._frame, self._opened.session.field.name, np.array([[e_m, n_m]]))
            return FieldLeft(boundary)
        return None

    def _is_due(self, what: str, every_s: float, now_s: float) -> bool:
        due = now_s - self._told_s[what] >= every_s - 0.02
        if due:
            self._told_s[what] = now_s
        return due

    def _figures(self, seen: LiveScan, status: dict[str, Any], *, is_over: bool = False) -> dict[str, Any]:
        """Areas, the rate of the last minutes, and what recorder and live session lack."""
        said = self.summary()
        self._areas.append((seen.t_s, said.worked_m2))
        while self._areas[0][0] < seen.t_s - RATE_OVER_S:
            self._areas.popleft()
        faults = [self._to.mqtt.fault if self._to.mqtt is not None else None]
        faults += [self._log.fault if self._log is not None else None, *map(thread_fault, self._threads)]
        warnings = [{"code": fault.code, **fault.texts} for fault in faults if fault is not None]
        warnings += status.get("warnings", ())
        first_s, first_m2 = self._areas[0]
        over_s = seen.t_s - first_s
        return {
            "worked_m2": round(said.worked_m2, 1),
            "overlap_m2": round(said.overlap_m2, 1),
            "missed_m2": round(said.missed_m2, 1),
            "rate_m2ps": round((said.worked_m2 - first_m2) / over_s, 3) if over_s > 5.0 else None,
            "not_seen_m2": round(said.not_seen_m2, 1),
            "left_m2": round(self._field.left_m2, 1) if self._field is not None else None,
            "waits_s": round(self._repairs.left_s(is_over=is_over), 1),
            "dropped": said.dropped,
            "lost_packets": said.lost_packets,
            "over": is_over,
            "warnings": [by_language(warning) | {"code": warning["code"]} for warning in warnings[:5]],
        }


def by_language(warning: Mapping[str, str]) -> dict[str, str]:
    """The texts of a warning by language, since the page is in that of its reader."""
    return {language: warning.get(f"text_{language}", warning["text"]) for language in LANGUAGES}


def as_json(seen: LiveScan) -> dict[str, Any]:
    """What is known with a scan, as values of JSON: null for what is not known."""
    out: dict[str, Any] = {"t_s": round(seen.t_s, 3), "tool": seen.tool.label, "missing": list(seen.missing)}
    out["tool_height_m"] = round(seen.tool_height_m, 3) if math.isfinite(seen.tool_height_m) else None
    pose = seen.pose
    if pose is None:
        return out
    roll, pitch, heading = pose.attitude_deg
    return out | {
        "e_m": round(pose.xyz_m[0], 3),
        "n_m": round(pose.xyz_m[1], 3),
        "h_m": round(pose.xyz_m[2], 3),
        "roll_deg": round(roll, 2),
        "pitch_deg": round(pitch, 2),
        "heading_deg": round(heading, 2),
        "turn_degps": round(-math.degrees(pose.turn_radps), 2),
        "speed_mps": round(pose.speed_mps, 3),
        "sigma_m": round(math.hypot(*pose.sigma[:2]), 3),
        "sigma_heading_deg": round(pose.sigma[5], 2),
        "fix": pose.fix.label,
        "position_age_s": round(pose.position_age_s, 2),
    }
