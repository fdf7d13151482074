"""Where a product comes from, as it is told inside the product itself, or beside those that have no room for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Final

from furrowmap.core.values.clock import decimal_year, iso_utc
from furrowmap.core.values.json_text import json_text

BESIDE: Final = "provenance.json"


@dataclass(frozen=True)
class Origin:
    """Where a product comes from.

    Attributes:
        title: what it shows.
        session: name of the session; empty where there is none.
        inputs: name and SHA-256 of each file that went into it.
        span_s: UTC of the first and the last measurement; None where unknown.
        parameters: what it was made with, such as the statistic.
    """

    title: str
    session: str = ""
    inputs: Sequence[tuple[str, str]] = ()
    span_s: tuple[float, float] | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)

    @property
    def measured_epoch(self) -> str | None:
        """When the first measurement was made, as a decimal year; None where unknown."""
        return f"{decimal_year(self.span_s[0]):.3f}" if self.span_s is not None else None

    @property
    def told(self) -> dict[str, str]:
        """Names, in capitals, and texts: title, software, session, times and epoch, parameters, inputs."""
        told = {"TITLE": self.title, "SOFTWARE": f"furrowmap {version('furrowmap')}"}
        if self.session:
            told["SESSION"] = self.session
        if self.span_s is not None:
            told["TIME_START"], told["TIME_END"] = map(iso_utc, self.span_s)
            told["MEASURED_EPOCH"] = str(self.measured_epoch)
        told |= {key.upper(): value for key, value in self.parameters.items()}
        return told | {
            f"INPUT_{number}": f"{name} sha256:{digest}" for number, (name, digest) in enumerate(self.inputs, 1)
        }

    @property
    def text(self) -> str:
        """The same, a line each."""
        return "\n".join(f"{name}: {text}" for name, text in self.told.items())

    def tell_beside(self, folder: Path) -> None:
        """Write `provenance.json` beside the files in a folder, whose names it lists."""
        names = sorted({BESIDE, *(path.name for path in folder.iterdir())})
        (folder / BESIDE).write_text(json_text({**self.told, "products": names}), encoding="utf-8")
