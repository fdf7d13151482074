"""`furrowmap response`: the response of a trial to its treatments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import Paths, command, files, option, output, overwrite, settings_options
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import printable
from furrowmap.settings import ResponseSettings


@command(
    "Analyse the response of a trial to its treatments.",
    "furrowmap response result/parcels.csv --treatments treatments.csv -o trial",
)
@files("tables", "TABLE...")
@output("DIR", "Output folder.", "Output folder", required=True)
@option("--treatments", "FILE", "CSV or spreadsheet with what each parcel or treatment was given.")
@settings_options(ResponseSettings)
@overwrite("Replace an earlier result in DIR.")
def response(
    console: Console,
    tables: Paths,
    output: Path,
    treatments: Path | None,
    settings: ResponseSettings,
    *,
    overwrite: bool,
) -> None:
    """Analyse figures of parcels by treatment. TABLE is the parcels.csv of a run, or any CSV or spreadsheet like it.

    Writes response.json, the table of parcels (trial.csv, trial.xlsx) and charts (SVG): the logistic response to the
    dose with its 95 % band and the rate beyond which nothing is gained, means by treatment and block, and, with
    several tables, growth.
    """
    account = furrowmap.response(tables, treatments, output, settings, overwrite=overwrite)
    console.warn_of(account)
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], output: Path) -> str:
    lines = []
    for flight in account["flights"]:
        curve = flight["curve"]
        rows = [("", printable(flight["words"]))]
        if curve is not None:
            rows += [(name, _interval(curve[name])) for name in ("lower", "rise", "gradient", "midpoint", "plateau")]
        variance = flight["variance"]
        if variance is not None:
            rows += [
                (f"F of {row['source']}", f"{row['f']:.2f} (p = {row['p']:.2g}, {row['freedom']} degrees of freedom)")
                for row in variance["rows"]
                if row["f"] is not None
            ]
        lines += [f"{flight['parcels']} parcels{', ' + flight['day'] if flight['day'] else ''}", table(rows)]
    return "\n".join([*lines, f"Written to {printable(str(output))}: {', '.join(account['products'])}"])


def _interval(value: dict[str, float | None]) -> str:
    ends = [f"{end:.4g}" if end is not None else "open" for end in (value["low"], value["high"])]
    return f"{value['value']:.4g} (95 %: {ends[0]} to {ends[1]})"
