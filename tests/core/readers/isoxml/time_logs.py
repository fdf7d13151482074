"""Time logs made for the tests: a packer of its own, straight from the standard's annex D."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

HEADER = '<?xml version="1.0"?><TIM A="" D="4"><PTN {position}/>{values}</TIM>'
FORMATS = {"A": "i", "B": "i", "C": "i", "D": "B", "E": "H", "F": "H", "G": "B", "H": "I", "I": "H"}


@dataclass(frozen=True)
class Record:
    """One record: milliseconds of the day, day, raw attributes of PTN by letter, and raw values by channel."""

    ms: int
    day: int
    position: Mapping[str, int]
    values: Mapping[int, int] = field(default_factory=dict)

    def pack(self) -> bytes:
        out = struct.pack("<IH", self.ms, self.day)
        for letter in sorted(self.position):
            out += struct.pack("<" + FORMATS[letter], self.position[letter])
        out += struct.pack("<B", len(self.values))
        return out + b"".join(struct.pack("<Bi", channel, value) for channel, value in self.values.items())


def header(
    channels: Sequence[tuple[int, str]],
    letters: str = "ABD",
    fixed: Mapping[str, str] | None = None,
    constants: Mapping[int, object] | None = None,
) -> bytes:
    """A header; `fixed` are attributes of PTN, `constants` values of channels that it states for all records."""
    stated = dict.fromkeys(letters, "") | dict(fixed or {})
    position = " ".join(f'{letter}="{stated[letter]}"' for letter in sorted(stated))
    whole = constants or {}
    values = "".join(
        f'<DLV A="{ddi:04X}" B="{whole.get(k, "")}" C="{element}"/>' for k, (ddi, element) in enumerate(channels)
    )
    return HEADER.format(position=position, values=values).encode()


def task_data(folder: Path, body: str, logs: Mapping[str, tuple[bytes, bytes]]) -> Path:
    """A TASKDATA folder of tasks in XML and time logs by name."""
    folder.mkdir(parents=True, exist_ok=True)
    text = f'<ISO11783_TaskData VersionMajor="4" VersionMinor="3" DataTransferOrigin="2">{body}</ISO11783_TaskData>'
    (folder / "TASKDATA.XML").write_text(text, encoding="utf-8")
    for name, (head, records) in logs.items():
        (folder / f"{name}.xml").write_bytes(head)
        (folder / f"{name}.bin").write_bytes(records)
    return folder
