"""The page of a live session and its stream, for readers on the local network that only look."""

import base64
import json
import re
import sys
import zlib
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from queue import Empty, Full, Queue
from socketserver import BaseRequestHandler, ThreadingTCPServer
from threading import Lock, Thread
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.work.worked_cells import CELL_SIDE_M, TILE_CELLS, Tile, WorkedCells
from furrowmap.exporters.reports.pages import render
from furrowmap.workflows.live.background import BackgroundMap, kind_of

QUEUED_MESSAGES: Final = 64
"""Messages that wait for a reader; one that falls further behind begins anew with a whole picture."""
MAX_READERS: Final = 50
KEEP_ALIVE_S: Final = 2.0
"""A reader that hears nothing for some of these connects again: a link may be cut without an end of the connection."""
TILE: Final = re.compile(r"/tiles/(\d{1,2})/(\d{1,8})/(\d{1,8})")


class Hub:
    """Hands each message, and `first` if there is one, to all readers, each of which has its own bounded queue."""

    def __init__(self, first: Callable[[], bytes] | None = None) -> None:
        self._first, self._lock = first, Lock()
        self._readers: dict[int, Queue[bytes]] = {}
        self._count = 0

    @property
    def readers(self) -> int:
        """How many there are."""
        return len(self._readers)

    def join(self) -> tuple[int, Queue[bytes]] | None:
        """The number and queue of a new reader; None if there are too many."""
        with self._lock:
            if len(self._readers) >= MAX_READERS:
                return None
            queue: Queue[bytes] = Queue(QUEUED_MESSAGES)
            if self._first is not None:
                queue.put_nowait(self._first())
            self._count += 1
            self._readers[self._count] = queue
            return self._count, queue

    def leave(self, number: int) -> None:
        """A reader is gone."""
        with self._lock:
            self._readers.pop(number, None)

    def publish(self, make: Callable[[], bytes]) -> None:
        """Hand on a message, made while no reader joins, so that none misses it or gets it twice."""
        with self._lock:
            message = make()
            for queue in self._readers.values():
                try:
                    queue.put_nowait(message)
                except Full:
                    while not queue.empty():
                        queue.get_nowait()
                    if self._first is not None:
                        queue.put_nowait(self._first())


class Pictures:
    """The cells of the ground worked as messages: all of them, or what changed since the last message."""

    def __init__(self) -> None:
        self._sent: dict[Tile, NDArray[np.uint8]] = {}
        self._whole: bytes | None = None
        self._about: dict[str, Any] = {}

    def placed(self, about: dict[str, Any]) -> bytes:
        """Remember where the map is, and say it as a message of its own."""
        self._about, self._whole = about, None
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
                "cells": base64.b64encode(zlib.compress(cells, 1)).decode("ascii"),
            }
            self._whole = event("picture", picture)
        return self._whole

    def changes(self, cells: WorkedCells, tiles: set[Tile]) -> bytes:
        """Runs of cells [first, count, state] that changed, by tile."""
        out = []
        for tile in tiles:
            now, before = cells.tiles()[tile], self._sent.get(tile)
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


class PageServer(ThreadingHTTPServer):
    """Threads that end with the process."""

    daemon_threads = True
    request_queue_size = 128
    """Each of fifty readers asks for several tiles at once."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say what failed, unless a reader only disconnected."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


def serve_page(
    host: str, port: int, hub: Hub, language: str, background: BackgroundMap | None = None
) -> ThreadingHTTPServer:
    """Serve page, stream and tiles in threads; readers change nothing. Raises OSError if the port cannot be used."""
    page = render(
        "live.html", "script-src 'self'", "connect-src 'self'", "img-src 'self' data:", language=language
    ).encode()
    script = files("furrowmap.exporters.share").joinpath("live.js").read_bytes()
    served = {"/": ("text/html; charset=utf-8", page), "/live.js": ("text/javascript; charset=utf-8", script)}

    class LivePage(BaseHTTPRequestHandler):
        """GET of the page, its script, its stream, and tiles."""

        protocol_version = "HTTP/1.1"
        timeout = 30.0

        def do_GET(self) -> None:
            """One of the four."""
            path = self.path.partition("?")[0]
            named = TILE.fullmatch(path)
            if path == "/events":
                self._stream()
            elif path in served:
                kind, content = served[path]
                self._head(HTTPStatus.OK, kind, len(content))
                self.wfile.write(content)
            elif named is not None:  # of a map, most places have no tile: that is no error
                tile = tile_of(background, *map(int, named.groups()))
                status = HTTPStatus.OK if tile else HTTPStatus.NO_CONTENT
                self._head(status, kind_of(tile) or "text/plain", len(tile), "max-age=86400")
                self.wfile.write(tile)
            else:
                self._head(HTTPStatus.NOT_FOUND, "text/plain", 0)

        def _head(self, status: HTTPStatus, kind: str, length: int | None, kept: str = "no-store") -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Cache-Control", kept)
            self.send_header("X-Content-Type-Options", "nosniff")
            if length is None:
                self.send_header("Connection", "close")
                self.close_connection = True
            else:
                self.send_header("Content-Length", str(length))
            self.end_headers()

        def _stream(self) -> None:
            joined = hub.join()
            if joined is None:
                self._head(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", 0)
                return
            number, queue = joined
            try:
                self._head(HTTPStatus.OK, "text/event-stream", None)
                self.wfile.write(b"retry: 1000\n\n")
                while True:
                    try:
                        self.wfile.write(queue.get(timeout=KEEP_ALIVE_S))
                    except Empty:
                        self.wfile.write(event("alive", None))
            except OSError:  # the reader is gone
                pass
            finally:
                hub.leave(number)

        def log_message(self, *_: object) -> None:
            """Requests are not logged."""

    server = PageServer((host, port), LivePage)
    Thread(target=server.serve_forever, daemon=True).start()
    return server


def tile_of(background: BackgroundMap | None, zoom: int, column: int, row: int) -> bytes:
    """An image; empty where there is none, or it cannot be read."""
    if background is None or zoom > background.zooms[1] or max(column, row) >= 1 << zoom:
        return b""
    with suppress(Exception):  # whatever the packages raise on damaged files
        tile = background.tile(zoom, column, row) or b""
        return tile if kind_of(tile) else b""
    return b""


def serve_lines(host: str, port: int, hub: Hub) -> ThreadingTCPServer:
    """Send a hub's messages to whoever connects, as NMEA receivers do; raises OSError if the port cannot be used."""

    class LineOutlet(BaseRequestHandler):
        """A connection."""

        def handle(self) -> None:
            """Send until the reader is gone."""
            joined = hub.join()
            if joined is None:
                return
            number, queue = joined
            self.request.settimeout(30.0)
            try:
                while True:
                    self.request.sendall(queue.get())
            except OSError:
                pass
            finally:
                hub.leave(number)

    class OutletServer(ThreadingTCPServer):
        """Threads that end with the process."""

        allow_reuse_address = True
        daemon_threads = True

    server = OutletServer((host, port), LineOutlet)
    Thread(target=server.serve_forever, daemon=True).start()
    return server
