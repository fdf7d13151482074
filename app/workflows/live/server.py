"""The page of a live session and its stream, for readers on the local network that only look."""

import base64
import io
import json
import math
import re
import socket
import sys
import zlib
from _thread import start_new_thread
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from importlib.resources import files
from queue import Empty, Full, Queue
from socketserver import BaseRequestHandler, TCPServer, ThreadingMixIn
from threading import Lock
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.coverage.worked_cells import CELL_SIDE_M, TILE_CELLS, Tile, WorkedCells
from furrowmap.core.runtime.languages.texts import LIVE, texts_by_language
from furrowmap.core.runtime.supervised import SupervisedThread
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.work_colours import DAY, NIGHT
from furrowmap.workflows.live.background_map import BackgroundMap, kind_of
from furrowmap.workflows.live.hosts import OwnHosts
from furrowmap.workflows.live.reader_places import Places, ReaderPlace

QUEUED_MESSAGES: Final = 64
"""Messages that wait for a reader; one that falls further behind begins anew with a whole picture."""
MAX_READERS: Final = 50
MAX_READERS_OF_ADDRESS: Final = 16
MAX_CONNECTIONS: Final = 400
MAX_OF_ADDRESS: Final = 64
"""A browser opens six at a time."""
REQUEST_S: Final = 15.0
"""Until a request is whole, from the one before on."""
MAX_REQUEST_BYTES: Final = 1 << 14
PAGE_ANSWER_S: Final = 30.0
WRITE_S: Final = 10.0
"""A reader that takes nothing for so long is left."""
SEND_BUFFER_BYTES: Final = 1 << 16
WRONG_HOST: Final = b"This page is not known by that name. Open it by the address of the computer, or state --host.\n"
KEEP_ALIVE_S: Final = 2.0
"""A reader that hears nothing for some of these connects again: a link may be cut without an end of the connection."""
MAX_WAY: Final = 5000
"""Places of the own track that a reader gets who joins; the last ones."""
WAY_STEP_M: Final = 1.0
TILE: Final = re.compile(r"/tiles/(\d{1,2})/(\d{1,8})/(\d{1,8})")


@dataclass(frozen=True, eq=False)
class PageReader:
    """A reader of a hub: its place, and the messages that wait for it."""

    place: ReaderPlace
    queue: Queue[bytes] = field(default_factory=lambda: Queue(QUEUED_MESSAGES))


class Hub:
    """Hands each message, and `first` if there is one, to all readers, each of which has its own bounded queue."""

    def __init__(self, first: Callable[[], bytes] | None = None) -> None:
        self.places = Places(MAX_READERS, MAX_READERS_OF_ADDRESS)
        self._first = first
        self._lock = Lock()
        self._readers: dict[PageReader, None] = {}

    @property
    def readers(self) -> int:
        """How many there are."""
        return len(self._readers)

    def join(self, address: str = "", close: Callable[[], None] = lambda: None) -> PageReader | None:
        """A new reader at an address, whose connection `close` ends; None if there are too many."""
        place = self.places.take(address, close)
        if place is None:
            return None
        reader = PageReader(place)
        with self._lock:
            if self._first is not None:
                reader.queue.put_nowait(self._first())
            self._readers[reader] = None
        return reader

    def leave(self, reader: PageReader) -> None:
        """A reader is gone."""
        self.places.leave(reader.place)
        with self._lock:
            self._readers.pop(reader, None)

    def publish(self, make: Callable[[], bytes]) -> None:
        """Hand on a message, made while no reader joins, so that none misses it or gets it twice."""
        with self._lock:
            message = make()
            for reader in self._readers:
                try:
                    reader.queue.put_nowait(message)
                except Full:
                    while not reader.queue.empty():
                        reader.queue.get_nowait()
                    if self._first is not None:
                        reader.queue.put_nowait(self._first())


class Pictures:
    """The cells of the ground worked as messages: all of them, or what changed since the last message."""

    def __init__(self) -> None:
        self._sent: dict[Tile, NDArray[np.uint8]] = {}
        self._whole: bytes | None = None
        self._about: dict[str, Any] = {}
        self._way: deque[tuple[float, float]] = deque(maxlen=MAX_WAY)
        self._said: dict[str, bytes] = {}

    def drive(self, e_m: float, n_m: float) -> None:
        """Remember where the vehicle drove."""
        if not self._way or math.dist(self._way[-1], (e_m, n_m)) > WAY_STEP_M:
            self._way.append((round(e_m, 2), round(n_m, 2)))
            self._whole = None

    def remember(self, name: str, message: bytes = b"") -> None:
        """Say this to who joins later as well; nothing of that name any more without a message."""
        self._said[name] = message

    def placed(self, about: dict[str, Any]) -> bytes:
        """Remember where the map is, and say it as a message of its own."""
        self._about = about
        self._whole = None
        return event("place", about)

    def whole(self) -> bytes:
        """What was sent so far, as one message."""
        if self._whole is None:
            tiles = list(self._sent)
            cells = b"".join(self._sent[tile].tobytes() for tile in tiles)
            picture = self._about | {
                "cell_m": CELL_SIDE_M,
                "tile": TILE_CELLS,
                "tiles": tiles,
                "way_m": list(self._way),
                "cells": base64.b64encode(zlib.compress(cells, 1)).decode("ascii"),
            }
            self._whole = event("picture", picture)
        return self._whole + b"".join(self._said.values())

    def changes(self, cells: WorkedCells, tiles: set[Tile]) -> bytes:
        """Runs of cells [first, count, state] that changed, by tile."""
        out = []
        for tile in tiles:
            now = cells.tiles().get(tile)
            if now is None:
                continue
            before = self._sent.get(tile)
            changed = (now != (before if before is not None else 0)).ravel()
            at = np.flatnonzero(changed)
            if not len(at):
                continue
            state = now.ravel()[at]
            begins = np.flatnonzero((np.diff(at, prepend=-2) != 1) | (np.diff(state.astype(int), prepend=-1) != 0))
            counts = np.diff(np.append(begins, len(at)))
            out.append([*tile, np.column_stack([at[begins], counts, state[begins]]).ravel().tolist()])
            self._sent[tile] = now.copy()
        self._whole = None if out else self._whole
        return event("cells", out)


def event(name: str, content: Any) -> bytes:
    """A message of a stream of server-sent events (HTML standard, section 9.2)."""
    return f"event: {name}\ndata: {json.dumps(content, separators=(',', ':'), allow_nan=False)}\n\n".encode("ascii")


def closed(connection: socket.socket) -> None:
    """End a connection, from any thread."""
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)


def prepare(connection: socket.socket) -> None:
    """Let it be noticed soon that a reader has vanished or takes nothing."""
    connection.settimeout(WRITE_S)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3), ("TCP_USER_TIMEOUT", 20_000)):
        if hasattr(socket, name):  # not all systems have all
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def has_left(connection: socket.socket) -> bool:
    """Whether a reader has closed its side; what it sends is read and dropped."""
    try:
        connection.setblocking(False)  # noqa: FBT003 (the function of a socket)
        return not connection.recv(4096)
    except BlockingIOError:
        return False
    except OSError:
        return True
    finally:
        connection.settimeout(WRITE_S)


def send_all(reader: PageReader, connection: socket.socket, idle: bytes) -> None:
    """Send a reader its messages until it is gone; `idle` where there are none. Raises OSError."""
    while not has_left(connection):
        try:
            message = reader.queue.get(timeout=KEEP_ALIVE_S)
        except Empty:
            message = idle
        if message:
            reader.place.expect(WRITE_S)
            connection.sendall(message)
            reader.place.expect_nothing()


class BoundedHead(io.BufferedReader):
    """What a browser sends: a request has a bounded size, however many lines it has."""

    left_bytes = MAX_REQUEST_BYTES

    def readline(self, size: int | None = -1, /) -> bytes:
        """A line; ConnectionAbortedError if the request is too long."""
        line = super().readline(size)
        self.left_bytes -= len(line)
        if self.left_bytes < 0:
            raise ConnectionAbortedError
        return line


class BoundedServer(ThreadingMixIn, TCPServer):
    """Connections in threads that end with the process, with places for them, and a thread that accepts them."""

    allow_reuse_address = sys.platform != "win32"  # there it would let two programs listen
    request_queue_size = 128
    """Each of fifty readers asks for several tiles at once."""
    timeout = 0.1
    """Seconds after which the thread that accepts looks for connections that hang, and for its end."""

    def __init__(
        self, host: str, port: int, handler: type[BaseRequestHandler], places: Places, name: str, further: Places | None
    ) -> None:
        super().__init__((host, port), handler)
        self._places = places
        self._further = further
        self._of: dict[socket.socket, ReaderPlace] = {}
        self.thread = SupervisedThread(name, self._accept, lambda _: None)
        self.thread.ensure()

    def _accept(self) -> None:
        """Accept connections until `shutdown`.

        `serve_forever` would mark begin and end by a `threading.Event`; see `StopFlag` for why a supervised thread has
        none.
        """
        while not self.thread.stopping.is_set():
            self.handle_request()
            self.service_actions()

    def shutdown(self) -> None:
        """Accept no more connections; those that are there stay."""
        self.thread.stop()

    def place_of(self, connection: socket.socket) -> ReaderPlace:
        """The place of a connection."""
        return self._of.get(connection) or ReaderPlace("", lambda: None)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection, unless too many are there."""
        place = self._places.take(str(client_address[0]), partial(closed, request))
        if place is None:
            self.shutdown_request(request)
            return
        self._of[request] = place
        prepare(request)
        # `Thread.start` would wait for the thread, for ever where an exception ends that before it begins.
        start_new_thread(self.process_request_thread, (request, client_address))

    def shutdown_request(self, request: Any) -> None:
        """A connection has ended."""
        place = self._of.pop(request, None)
        if place is not None:
            self._places.leave(place)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """End connections that hang; about ten times a second."""
        super().service_actions()
        self._places.close_overdue()
        if self._further is not None:
            self._further.close_overdue()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say what failed, unless a reader only disconnected."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class LivePage(BaseHTTPRequestHandler):
    """GET of the page, its script, its stream, and tiles."""

    protocol_version = "HTTP/1.1"
    timeout = WRITE_S
    server: "PageServer"

    def setup(self) -> None:
        """Bound what is read."""
        super().setup()
        self.rfile = self._bounded = BoundedHead(self.connection.makefile("rb", buffering=0))
        self._place = self.server.place_of(self.connection)

    def handle_one_request(self) -> None:
        """Read a request within a time and a size, and answer it."""
        self._bounded.left_bytes = MAX_REQUEST_BYTES
        self._place.expect(REQUEST_S)
        super().handle_one_request()

    def do_GET(self) -> None:
        """One of the four."""
        self._place.expect(PAGE_ANSWER_S)
        path = self.path.partition("?")[0]
        named = TILE.fullmatch(path)
        refused = self._refused(path)
        if refused is not None:
            self._refuse(refused)
        elif path == "/events":
            self._stream()
        elif path in self.server.served:
            kind, content = self.server.served[path]
            self._head(HTTPStatus.OK, kind, len(content))
            self.wfile.write(content)
        elif named is not None:  # of a map, most places have no tile: that is no error
            tile = tile_of(self.server.background, *map(int, named.groups()))
            status = HTTPStatus.OK if tile else HTTPStatus.NO_CONTENT
            self._head(status, kind_of(tile) or "text/plain", len(tile), "max-age=86400")
            self.wfile.write(tile)
        else:
            self._head(HTTPStatus.NOT_FOUND, "text/plain", 0)

    def _refused(self, path: str) -> HTTPStatus | None:
        """Why a request is none of a reader of the page; None if it is one."""
        hosts = self.headers.get_all("Host") or []
        origin = self.headers.get("Origin")
        if len(hosts) != 1 or not self.server.own.include(hosts[0].strip()):
            return HTTPStatus.MISDIRECTED_REQUEST
        if self.headers.get("Transfer-Encoding") or self.headers.get("Content-Length", "0").strip() != "0":
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE
        if origin is not None and origin.partition("://")[2].lower() != hosts[0].strip().lower():
            return HTTPStatus.FORBIDDEN
        if path != "/" and self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return HTTPStatus.FORBIDDEN
        return None

    def _refuse(self, status: HTTPStatus) -> None:
        text = WRONG_HOST if status is HTTPStatus.MISDIRECTED_REQUEST else b""
        self.close_connection = True
        self._head(status, "text/plain; charset=utf-8", len(text))
        self.wfile.write(text)

    def _head(self, status: HTTPStatus, kind: str, length: int | None, kept: str = "no-store") -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", kept)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        if length is None:
            self.close_connection = True
        else:
            self.send_header("Content-Length", str(length))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()

    def _stream(self) -> None:
        reader = self.server.hub.join(self.client_address[0], partial(closed, self.connection))
        if reader is None:
            self._head(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", 0)
            return
        try:
            self._head(HTTPStatus.OK, "text/event-stream", None)
            self.wfile.write(b"retry: 1000\n\n")
            self._place.expect_nothing()
            send_all(reader, self.connection, event("alive", None))
        except OSError:  # the reader is gone
            pass
        finally:
            self.server.hub.leave(reader)

    def log_message(self, *_: object) -> None:
        """Requests are not logged."""


class PageServer(BoundedServer):
    """Serves page, stream and tiles in threads; readers change nothing.

    Args:
        names: of this computer, besides its own.

    Raises:
        OSError: if the port cannot be used.
    """

    def __init__(
        self,
        host: str,
        port: int,
        hub: Hub,
        language: str,
        background: BackgroundMap | None = None,
        names: Sequence[str] = (),
    ) -> None:
        page = render(
            "live.html",
            "script-src 'self'",
            "connect-src 'self'",
            "img-src 'self' data:",
            language=language,
            day=DAY,
            night=NIGHT,
        ).encode()
        words = f"const LANGUAGES = {json.dumps(texts_by_language(LIVE))};\n".encode()
        script = words + files("furrowmap.exporters.share").joinpath("live.js").read_bytes()
        self.served = {"/": ("text/html; charset=utf-8", page), "/live.js": ("text/javascript; charset=utf-8", script)}
        self.own = OwnHosts.of(host, names)
        self.hub = hub
        self.background = background
        super().__init__(host, port, LivePage, Places(MAX_CONNECTIONS, MAX_OF_ADDRESS), "page", hub.places)


def tile_of(background: BackgroundMap | None, zoom: int, column: int, row: int) -> bytes:
    """An image; empty where there is none, or it cannot be read."""
    if background is None or zoom > background.zooms[1] or max(column, row) >= 1 << zoom:
        return b""
    with suppress(Exception):  # whatever the packages raise on damaged files
        tile = background.tile(zoom, column, row) or b""
        return tile if kind_of(tile) else b""
    return b""


def serve_lines(host: str, port: int, hub: Hub) -> BoundedServer:
    """Send a hub's messages to whoever connects, as NMEA receivers do; raises OSError if the port cannot be used."""

    class LineOutlet(BaseRequestHandler):
        """A connection."""

        def handle(self) -> None:
            """Send until the reader is gone."""
            reader = hub.join(self.client_address[0], partial(closed, self.request))
            if reader is None:
                return
            try:
                send_all(reader, self.request, b"")
            except OSError:
                pass
            finally:
                hub.leave(reader)

    return BoundedServer(host, port, LineOutlet, Places(MAX_CONNECTIONS, MAX_OF_ADDRESS), "NMEA outlet", hub.places)
