"""Compressed points decoded in a process that may die of them."""

import atexit
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from threading import Lock, Timer
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las import decoding
from furrowmap.core.runtime.settings import threads

MIN_ORDER_S: Final = 20.0
MIN_BYTES_PER_S: Final = 1e6
"""An order that takes longer than MIN_ORDER_S and its bytes at this speed hangs; two cores decode 40 MB/s."""


class Undecodable(Exception):
    """Why points cannot be decoded."""


class Decoder:
    """A process that decodes points. It is started with the first order, and again after it has ended."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def points(self, size: int, **order: Any) -> NDArray[np.uint8]:
        """The decoded bytes; Undecodable if the points are damaged, whatever that does to the decoder.

        `order` is what is decoded; see :mod:`~furrowmap.core.readers.las.decoding`.
        """
        return self._ask({**order, "size": size}, size, partial(_points, size))

    def sheet(self, path: Path, most_bytes: int) -> list[list[str]]:
        """The rows of the first sheet of a spreadsheet; Undecodable if it is damaged, or has more text than that."""
        place = find_spec("python_calamine")
        assert place is not None
        assert place.origin is not None
        order = {"what": "sheet", "path": str(path.absolute()), "site": str(Path(place.origin).parents[1])}
        rows: list[list[str]] = json.loads(self._ask(order, path.stat().st_size, partial(_text, most_bytes)).tobytes())
        return rows

    def _ask(
        self, order: dict[str, Any], size: int, answer: Callable[[IO[bytes], int], NDArray[np.uint8]]
    ) -> NDArray[np.uint8]:
        line = json.dumps(order).encode() + b"\n"
        with self._lock:
            process = self._start()
            longest_s = MIN_ORDER_S + size / MIN_BYTES_PER_S
            began_s = time.monotonic()
            late = Timer(longest_s, process.kill)
            late.start()
            try:
                return _answer(process, line, answer)
            except Undecodable:
                raise
            except BaseException as error:
                self._end()
                if isinstance(error, EOFError | OSError):
                    hangs = time.monotonic() - began_s >= longest_s
                    why = f"needs more than {longest_s:.0f} s" if hangs else f"crashed ({process.returncode})"
                    raise Undecodable(f"the decoder {why}") from None
                raise
            finally:
                late.cancel()

    def close(self) -> None:
        """End the process."""
        with self._lock:
            if self._process is not None and self._owner == os.getpid():
                self._end()

    def _start(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._owner != os.getpid():  # a fork has no part in its parent's pipes
            place = find_spec("lazrs")
            assert place is not None
            assert place.origin is not None
            # Without site-packages' own start-up, and without this folder among those that are imported from.
            program = [sys.executable, "-S", "-E", "-P", decoding.__file__, str(Path(place.origin).parents[1])]
            self._process = subprocess.Popen(  # noqa: S603 (this interpreter, and a file beside this one)
                program,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"RAYON_NUM_THREADS": str(threads()), "MALLOC_ARENA_MAX": "2"},
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
            self._owner = os.getpid()
            if sys.platform == "linux":
                import fcntl

                assert self._process.stdout is not None
                with suppress(OSError):  # fewer changes between the processes
                    fcntl.fcntl(self._process.stdout, fcntl.F_SETPIPE_SZ, 1 << 20)
        return self._process

    def _end(self) -> None:
        process = self._process
        self._process = None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with suppress(OSError):
                        pipe.close()


DECODER: Final = Decoder()
"""Serves all files; a stream, which has a state, needs one of its own."""
atexit.register(DECODER.close)


def _answer(
    process: subprocess.Popen[bytes], line: bytes, answer: Callable[[IO[bytes], int], NDArray[np.uint8]]
) -> NDArray[np.uint8]:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(line)
    process.stdin.flush()
    (length,) = decoding.LENGTH.unpack(_exactly(process.stdout, decoding.LENGTH.size).tobytes())
    if length < 0:
        raise Undecodable(bytes(_exactly(process.stdout, -length)).decode("utf-8", "replace"))
    return answer(process.stdout, length)


def _points(size: int, pipe: IO[bytes], length: int) -> NDArray[np.uint8]:
    if length != size:
        raise Undecodable("too few points")
    return _exactly(pipe, size)


def _text(most_bytes: int, pipe: IO[bytes], length: int) -> NDArray[np.uint8]:
    if length > most_bytes:
        raise EOFError  # the rest of the answer is not read: the process ends
    return _exactly(pipe, length)


def _exactly(pipe: IO[bytes], size: int) -> NDArray[np.uint8]:
    """The next bytes of a pipe."""
    data = np.empty(size, np.uint8)
    rest = memoryview(data.data)
    while rest:
        got = pipe.readinto(rest)  # type: ignore[attr-defined]
        if not got:
            raise EOFError
        rest = rest[got:]
    return data
