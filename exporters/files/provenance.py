"""Provenance of products, written into their metadata or into a file beside them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.values.clock import decimal_year, iso_utc

PROVENANCE_FILE: Final = "provenance.json"


@dataclass(frozen=True)
class Origin:
    """Provenance of a product: name and SHA-256 of each input, UTC of the first and last measurement, parameters."""

    title: str
    session: str = ""
    inputs: Sequence[tuple[str, str]] = ()
    span_s: tuple[float, float] | None = None
    parameters: Mapping[str, object] = field(default_factory=dict)

    @property
    def measured_epoch(self) -> str | None:
        """Time of the first measurement as a decimal year; None where unknown."""
        return f"{decimal_year(self.span_s[0]):.3f}" if self.span_s is not None else None

    @property
    def metadata(self) -> dict[str, str]:
        """Names, in capitals, and texts: title, software, session, times and epoch, parameters, inputs.

        Each text is one line with escapes for control characters, which GDAL would drop.
        """
        known = {"TITLE": self.title, "SOFTWARE": f"furrowmap {version('furrowmap')}"}
        if self.session:
            known["SESSION"] = self.session
        if self.span_s is not None:
            known["TIME_START"], known["TIME_END"] = map(iso_utc, self.span_s)
            known["MEASURED_EPOCH"] = str(self.measured_epoch)
        known |= {key.upper(): str(value) for key, value in self.parameters.items() if value is not None}
        known |= {f"INPUT_{number}": f"{name} sha256:{digest}" for number, (name, digest) in enumerate(self.inputs, 1)}
        return {name: printable(text) for name, text in known.items()}

    @property
    def text(self) -> str:
        """The metadata, one a line."""
        return "\n".join(f"{name}: {text}" for name, text in self.metadata.items())

    def write_beside(self, folder: Path) -> None:
        """Write `provenance.json` into a folder, with the names of the files there."""
        names = sorted({PROVENANCE_FILE, *(path.name for path in folder.iterdir())})
        (folder / PROVENANCE_FILE).write_text(json_text({**self.metadata, "products": names}), encoding="utf-8")
