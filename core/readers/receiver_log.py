"""What a receiver's own binary log is to the user, whichever maker's it is."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.frames import Records, Scan, Tally, joined, read_records
from furrowmap.core.readers.position_log import PositionLog, Positions, file_at, log_name
from furrowmap.core.values.errors import Notice


class ReceiverLog(PositionLog):
    """The positions in a log of binary messages of fixed layout, with whatever stands between them.

    Args:
        paths: the files of one recording, in the order of time.
        options: `date`, `near_s` and `week` are used where the messages carry no date.
    """

    messages: ClassVar[str]
    """What the frames are called, in the plural."""
    layouts: ClassVar[Mapping[int, np.dtype[np.void]]]
    find: ClassVar[Scan]

    @abstractmethod
    def _epochs(
        self, records: Mapping[int, Records], tally: Tally, name: str, place: Callable[[int], str]
    ) -> Positions:
        """The positions of the messages; `place` has words for where in the stream something stands."""

    @abstractmethod
    def _names(self, kinds: Sequence[int]) -> dict[int, str]:
        """Names of kinds of messages."""

    def _read(self, paths: list[Path]) -> Positions:
        tally = Tally()
        parts: dict[int, list[Records]] = {kind: [] for kind in self.layouts}
        ends: list[int] = []
        for source in self._sources(paths):
            for kind, pieces in read_records(source, type(self).find, self.layouts, tally, tally.stream_bytes).items():
                parts[kind] += pieces
            ends.append(tally.stream_bytes)

        def place(at: int) -> str:
            path, byte = file_at(paths, ends, at)
            return f"{path}, byte {byte}"

        name = log_name(paths)
        records = {kind: joined(pieces, self.layouts[kind]) for kind, pieces in parts.items()}
        positions = self._epochs(records, tally, name, place)
        if tally.bad_checksums or tally.cut:
            self.notices.append(
                Notice(
                    "messages-damaged",
                    f"{name}: {tally.intact} messages are intact; {tally.bad_checksums} with a wrong checksum or "
                    f"length and {tally.cut} that the log's end cuts are not used.",
                )
            )
        names = self._names(list(tally.kinds))
        facts = {
            self.messages: {names[kind]: count for kind, count in tally.kinds.most_common()},
            "intact": tally.intact,
            "bad_checksums": tally.bad_checksums,
            "cut": tally.cut,
            "other_bytes": tally.other_bytes,
            **positions.facts,
        }
        return replace(positions, facts=facts, scale="UTC by its messages")


def sound(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Which epochs (n,) state a place on the earth: finite, no pole passed, no height beyond 100 km."""
    lon, lat, height = (columns[name] for name in ("lon_deg", "lat_deg", "height_m"))
    with np.errstate(invalid="ignore"):
        return (np.abs(lon) <= 360.0) & (np.abs(lat) <= 90.0) & ~(np.abs(height) > 1e5)
