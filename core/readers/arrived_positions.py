"""What a GNSS receiver says while its bytes arrive: the format, the last position, its fix and its time."""

import math
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from furrowmap.core.readers.nmea.log import NmeaLog
from furrowmap.core.readers.sbf.log import SBF, SbfLog
from furrowmap.core.readers.source import Head
from furrowmap.core.readers.ubx.log import UBX, UbxLog
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.gnss import Fix

Kind: TypeAlias = type[NmeaLog] | type[UbxLog] | type[SbfLog]

_MARKS: Final[dict[Kind, bytes]] = {NmeaLog: b"$", UbxLog: UBX.sync, SbfLog: SBF.sync}
"""What a message of each format begins with."""
_MIN_BYTES: Final = 256
"""From this on the format is looked for."""
_MAX_UNREAD_BYTES: Final = 1 << 20
"""That wait to be looked at; older ones are left out."""
_MAX_MESSAGE: Final = 8192


def log_kind(data: bytes) -> Kind | None:
    """The format in which a receiver writes; None where it is unknown, or too little has arrived."""
    head = Head(Path("stream"), data, "", "")
    score, kind = max(((kind.recognise(head), kind) for kind in _MARKS), key=lambda found: found[0])
    return kind if score and len(data) >= _MIN_BYTES else None


@dataclass
class ArrivedPositions:
    """Follows the bytes of one receiver.

    Attributes:
        format: "nmea", "ubx" or "sbf"; empty while it is unknown.
        fix: of the last position; `Fix.NONE` if the receiver has none.
        satellites: of the last position; None if unknown.
        t_s: UTC of the last position; nan without one.
        lon_deg, lat_deg: the last position; nan without one.
        late_s: time of its arrival, by this machine's clock, minus `t_s`.
    """

    format: str = ""
    fix: Fix = Fix.NONE
    satellites: int | None = None
    t_s: float = math.nan
    lon_deg: float = math.nan
    lat_deg: float = math.nan
    late_s: float = math.nan
    _kind: Kind | None = None
    _bytes: bytearray = field(default_factory=bytearray, repr=False)
    _arrived_s: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def prepare(cls) -> None:
        """Compile the kernels of all formats, so that nothing is compiled while bytes arrive."""
        arrived = cls()
        arrived.add(b"".join(_MARKS.values()) * _MIN_BYTES, 0.0)
        arrived.look()

    def add(self, data: bytes, arrived_s: float) -> None:
        """Keep bytes for `look`, which arrived at that time of this machine's clock. Another thread may call it."""
        with self._lock:
            self._bytes += data
            del self._bytes[:-_MAX_UNREAD_BYTES]
            self._arrived_s = arrived_s

    def look(self) -> None:
        """Look at the bytes that were added.

        They are gone also where looking fails, which hostile bytes may do: the next ones are looked at afresh.
        """
        try:
            self._look()
        except BaseException:
            with self._lock:
                self._bytes.clear()
            raise

    def _look(self) -> None:
        with self._lock:
            data = bytes(self._bytes)
            arrived_s = self._arrived_s
            self._bytes.clear()
        if self._kind is None and (kind := log_kind(data)) is not None:
            self._kind = kind
            self.format = kind.format
        mark = _MARKS[self._kind] if self._kind else b""
        rest = data[-_MAX_MESSAGE:]
        with self._lock:  # the last message may be incomplete
            self._bytes[:0] = rest[max(rest.rfind(mark), 0) :] if mark else rest
        if self._kind is None:
            return
        try:
            near_s = arrived_s if math.isnan(self.late_s) else arrived_s - self.late_s
            positions = self._kind.of_bytes(data, near_s)
        except InputError:
            return
        track = positions.track
        if len(track):
            satellites = int(track.satellites[-1])
            self.fix = Fix(int(track.fix[-1]))
            self.satellites = satellites if satellites >= 0 else None
            self.t_s = float(track.t_s[-1])
            self.lon_deg = float(track.lon_deg[-1])
            self.lat_deg = float(track.lat_deg[-1])
            self.late_s = arrived_s - self.t_s
        elif positions.without_position:
            self.fix = Fix.NONE
            self.satellites = None
