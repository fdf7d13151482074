"""The process that decodes compressed points, and spreadsheets: a program that imports little, and starts in 30 ms.

lazrs (0.8.2) decodes GPS times by recursion, as deep as the data demand: a damaged chunk overflows the stack, which
ends the process. So the process is one that may end; :mod:`furrowmap.core.readers.las.las_decoder` starts it again.

It reads orders from standard input, one JSON object per line: ``chunks`` (``path``, ``begin``, ``bytes``, ``vlr``,
``table`` of points and bytes, ``size`` of the result), ``stream`` (``path``, ``offset``, ``vlr``, ``size``),
``more`` (``size``), which continues the stream, and ``sheet`` (``path``, ``site``), the first of a spreadsheet, whose
cells calamine expands to a rectangle however far apart they are. It answers with 8 bytes n (a signed integer) and n
bytes of points, or of a JSON list of rows of texts; a negative n announces -n bytes that say why there are none.
"""

import json
import os
import signal
import struct
import sys
from contextlib import suppress
from typing import Any, Final

LENGTH: Final = struct.Struct("<q")
MAX_MEMORY_BYTES: Final = 2 << 30
"""Bytes of address space, or of memory on Windows: no order needs a quarter of it."""


def main() -> None:
    """Answer orders until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started the process ends it
    with suppress(ImportError, OSError, ValueError):  # a lower limit is in force
        _limit_memory()
    sys.path.append(sys.argv[1])
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    stream: Any = None
    held = bytearray()
    for line in sys.stdin.buffer:
        order = json.loads(line)
        try:
            if order["what"] == "stream":
                stream = _stream(order)
            size = 0 if order["what"] == "sheet" else order["size"]
            if len(held) < size:
                held = bytearray(size)
            rest = memoryview(held)[:size]
            if order["what"] == "sheet":
                rest = memoryview(_sheet(order))
            elif order["what"] == "chunks":
                import lazrs

                with open(order["path"], "rb") as file:  # noqa: PTH123 (pathlib takes as long to import as lazrs)
                    file.seek(order["begin"])
                    data = file.read(order["bytes"])
                table = [(number, size) for number, size in order["table"]]
                lazrs.decompress_points_with_chunk_table(data, bytes.fromhex(order["vlr"]), rest, table)
            else:
                stream.decompress_many(rest)
            length = len(rest)
        except BaseException as error:  # noqa: BLE001 (a panic of Rust is not an Exception)
            rest = memoryview((str(error) or type(error).__name__).encode("utf-8", "replace")[:1000])
            length = -len(rest)
        answers.write(LENGTH.pack(length))
        while rest:
            rest = rest[answers.write(rest) :]


if sys.platform == "win32":

    def _limit_memory() -> None:
        """Put this process into a job, whose limits hold until it ends."""
        import ctypes

        limits = (ctypes.c_uint64 * 18)()  # JOBOBJECT_EXTENDED_LIMIT_INFORMATION on a 64-bit Windows
        limits[2] = 0x100  # LimitFlags: JOB_OBJECT_LIMIT_PROCESS_MEMORY
        limits[14] = MAX_MEMORY_BYTES  # ProcessMemoryLimit
        kernel = ctypes.WinDLL("kernel32")
        kernel.CreateJobObjectW.restype = kernel.GetCurrentProcess.restype = ctypes.c_void_p
        job = ctypes.c_void_p(kernel.CreateJobObjectW(None, None))
        extended = 9
        if kernel.SetInformationJobObject(job, extended, limits, ctypes.sizeof(limits)):
            kernel.AssignProcessToJobObject(job, ctypes.c_void_p(kernel.GetCurrentProcess()))

else:

    def _limit_memory() -> None:
        """Limit the address space; macOS takes the limit but does not keep to it."""
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))


def _sheet(order: dict[str, Any]) -> bytes:
    sys.path.append(order["site"])
    from python_calamine import CalamineWorkbook

    sheet = CalamineWorkbook.from_path(order["path"]).get_sheet_by_index(0)
    return json.dumps([[_cell_text(cell) for cell in row] for row in sheet.to_python()]).encode()


def _cell_text(cell: Any) -> str:
    import datetime as dt

    if isinstance(cell, dt.datetime):
        return cell.date().isoformat() if cell.time() == dt.time() else cell.isoformat()
    if isinstance(cell, dt.date):
        return cell.isoformat()
    if isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15:
        return str(int(cell))
    return str(cell)


def _stream(order: dict[str, Any]) -> Any:
    import lazrs

    file = open(order["path"], "rb")  # noqa: PTH123, SIM115 (open as long as the stream)
    file.seek(order["offset"])
    return lazrs.LasZipDecompressor(file, bytes.fromhex(order["vlr"]))


if __name__ == "__main__":
    main()
