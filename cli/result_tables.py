"""Tables of results for the terminal: `duration_s: 59.8` becomes "duration  59.8 s"."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from furrowmap.core.runtime.errors import printable

MAX_PARCELS: Final = 60
"""Parcels that the terminal shows."""
_UNIT_BY_SUFFIX: Final = {
    "m2": "m²", "m3": "m³", "mps": "m/s", "hz": "Hz", "rpm": "rpm", "deg": "°", "mm": "mm", "m": "m", "s": "s",
    "percent": "%",
}  # fmt: skip


def figures(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values as rows. A nested table becomes one line, or one line per item if it nests further."""
    return [_figure(name, value) for name, value in values.items()]


def table(rows: Iterable[tuple[str, str]]) -> str:
    """Two indented columns; further lines of a value are aligned with its first."""
    rows = list(rows)
    width = max((len(name) for name, _ in rows), default=0)
    lines = []
    for name, value in rows:
        first, *more = value.splitlines() or [""]
        lines.append(f"  {name:<{width}}  {first}".rstrip())
        lines.extend(f"  {'':<{width}}  {line}" for line in more)
    return "\n".join(lines)


def aligned(lines: Sequence[Sequence[str]], left: int = 0) -> str:
    """Cells in columns, the first `left` of them aligned to the left."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )


def parcel_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str], whole: str) -> str:
    """Some columns of a table of parcels under their names; where rows are left out, the file `whole` is named."""
    cells = [["" if row[name] is None else f"{row[name]:.4g}" for name in columns] for row in rows]
    lines = [["id", *columns], *([printable(str(row["id"])), *own] for row, own in zip(rows, cells, strict=True))]
    text = aligned(lines[: 1 + MAX_PARCELS])
    return f"{text}\n… {len(rows) - MAX_PARCELS} more in {whole}" if len(rows) > MAX_PARCELS else text


def _figure(name: str, value: Any) -> tuple[str, str]:
    if name.endswith("unix_s") and isinstance(value, float):
        from furrowmap.core.values.clock import iso_utc  # imports numpy, which --help must not wait for

        return printable(name.removesuffix("_unix_s").replace("_", " ")), iso_utc(value)
    stem, _, suffix = name.rpartition("_")
    unit = _UNIT_BY_SUFFIX.get(suffix, "") if stem and _is_number(value) else ""
    label = (stem if unit else name).replace("_", " ")
    gap = "" if unit in ("", "°") else " "
    return printable(label), f"{_text(value)}{gap}{unit}"


def _text(value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    if isinstance(value, float):
        return f"{value:,.10g}"
    if isinstance(value, Mapping | list | tuple) and not value:
        return "none"
    if isinstance(value, Mapping):
        if all(isinstance(item, Mapping) for item in value.values()):
            return "\n".join(f"{printable(str(name))}: {_text(item)}" for name, item in value.items())
        nested = any(isinstance(item, Mapping | list | tuple) for item in value.values())
        return ("\n" if nested else ", ").join(" ".join(_figure(str(name), item)) for name, item in value.items())
    if isinstance(value, list | tuple):
        nested = any(isinstance(item, list | tuple) for item in value)
        return ("; " if nested else ", ").join(_text(item) for item in value)
    return printable(str(value))


def _is_number(value: Any) -> bool:
    numbers = value if isinstance(value, list | tuple) else [value]
    return bool(numbers) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in numbers)


def written(account: Mapping[str, Any], folder: Path) -> str:
    """The folder of the products in an account, and their sizes."""
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    return f"{printable(str(folder))}:\n{table(files)}"


def surveyed(account: Mapping[str, Any], folder: Path) -> str:
    """The figures of clouds in an account, their CRS and ground classification, and the products."""
    shown = {**account["figures"], "crs": account["crs"], "ground": account["parameters"]["ground"]}
    return f"{table(figures(shown))}\n{written(account, folder)}"


def file_size(path: Path) -> str:
    """The size of a file, with its unit."""
    size = path.stat().st_size
    return f"{size / 1e6:,.1f} MB" if size >= 1e5 else f"{size / 1e3:,.1f} kB"
