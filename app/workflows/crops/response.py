"""The response of a trial to its treatments, from tables of its parcels."""

import datetime as dt
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.crops.growth import Growth, growth_of
from furrowmap.core.crops.response import (
    Response,
    Variance,
    analysis_of_variance,
    column_words,
    dose_name,
    dose_unit,
    fit_response,
    parcel_doses,
)
from furrowmap.core.crops.trial_tables import (
    MEASURE,
    TREATMENT,
    MeasuredTable,
    day_of,
    read_measured,
    read_treatments,
    with_treatments,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, UsageError
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.files.csv_cells import write_csv_table, write_workbook
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.exporters.reports.trial_charts import ParcelValues, category_chart, response_chart, standalone
from furrowmap.settings import ResponseSettings

RESPONSE_REPORT: Final = "response.json"


@dataclass(frozen=True)
class _Flight:
    """A trial on a day; the dose (n,) of a parcel is nan where unknown."""

    day: dt.date | None
    parcels: tuple[Parcel, ...]
    table: MeasuredTable
    dose: FloatArray | None
    response: Response | None
    variance: Variance | None


def response(
    tables: Sequence[str | Path],
    treatments: str | Path | None,
    out: str | Path,
    settings: ResponseSettings = ResponseSettings(),
    *,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Fit the response to a dose, analyse the variance by treatment, and the growth between flights.

    Args:
        tables: CSV or spreadsheet with the figures of parcels, such as parcels.csv: one for each flight.
        treatments: table with what each parcel was given; None if the tables hold it.
        out: folder for response.json, charts (SVG) and the table of parcels (CSV; a spreadsheet with openpyxl).

    Returns:
        The content of `response.json`.

    Raises:
        InputError: if a table cannot be read, or names a parcel that the others do not have.
        UsageError: if there are not as many days as tables.
        RefusedError: if the folder holds such a result.
    """
    folder = Path(out)
    days = _days(settings.days or (), len(tables))
    refuse_existing(folder / RESPONSE_REPORT, overwrite=overwrite)
    measure = settings.measure or MEASURE
    notices: list[Notice] = []
    flights = [
        _flight(Path(path), day, Path(treatments) if treatments is not None else None, settings, notices)
        for path, day in zip(tables, days, strict=True)
    ]
    growth: tuple[Growth, ...] = ()
    if len(flights) > 1:
        known = [([each.id for each in flight.parcels], flight.table) for flight in flights]
        heights = [dict(zip(ids, table.value.tolist(), strict=True)) for ids, table in known]
        sigmas = [dict(zip(ids, table.sigma.tolist(), strict=True)) for ids, table in known]
        growth = growth_of([flight.day for flight in flights if flight.day is not None], heights, sigmas)
    rows = _rows(flights, measure, growth)
    last = flights[-1]
    charts = _charts(last, measure, dose_name(last.parcels, settings.dose), growth)
    account = {
        "measure": measure,
        "dose": dose_name(last.parcels, settings.dose),
        "flights": [_account(flight) for flight in flights],
        "growth": [asdict(each) for each in growth],
        "warnings": list(dict.fromkeys(notices)),
    }
    with staged_folder(folder) as staging:
        for name, chart in charts.items():
            (staging / name).write_text(standalone(chart, language_of_user()), encoding="utf-8")
        write_csv_table(staging / "trial.csv", list(dict.fromkeys(name for row in rows for name in row)), rows)
        sheets = {"parcels": rows}
        if last.variance is not None:
            sheets["treatments"] = [asdict(mean) for mean in last.variance.means]
            sheets["variance"] = [asdict(row) for row in last.variance.rows]
        curve = last.response.curve if last.response is not None else None
        if curve is not None:
            names = ("lower", "rise", "gradient", "midpoint", "plateau")
            sheets["curve"] = [{"parameter": name, **asdict(getattr(curve, name))} for name in names]
        write_workbook(staging / "trial.xlsx", sheets)
        products = sorted(path.name for path in staging.iterdir())
        answer: dict[str, Any] = plain({**account, "products": [*products, RESPONSE_REPORT]})
        (staging / RESPONSE_REPORT).write_text(json_text(answer), encoding="utf-8")
    return answer


def _days(texts: Sequence[str], tables: int) -> list[dt.date | None]:
    if texts and len(texts) != tables:
        raise UsageError("response-days", tables=tables, texts=len(texts))
    if tables > 1 and len(set(texts)) != tables:
        raise UsageError("response-days.one-a-table", tables=tables)
    return [day_of(text) for text in texts] or [None] * tables


def _flight(
    path: Path, day: dt.date | None, treatments: Path | None, settings: ResponseSettings, notices: list[Notice]
) -> _Flight:
    measure = settings.measure or MEASURE
    table = read_measured(path, measure)
    notices += table.notices
    parcels = table.parcels
    if treatments is not None:
        parcels, more = with_treatments(parcels, read_treatments(treatments, day))
        notices += more
    name = dose_name(parcels, settings.dose)
    dose = parcel_doses(parcels, name) if name is not None else None
    found = None if dose is None else fit_response(dose, table.value, [each.block for each in parcels], dose_unit(name))
    return _Flight(day, parcels, table, dose, found, _variance(parcels, table, dose, notices))


def _variance(
    parcels: tuple[Parcel, ...], table: MeasuredTable, dose: FloatArray | None, notices: list[Notice]
) -> Variance | None:
    labels = _labels(parcels, dose)
    known = [k for k, label in enumerate(labels) if label is not None and math.isfinite(table.value[k])]
    if len({labels[k] for k in known}) < 2:
        return None
    blocks = [parcels[k].block or "" for k in known]
    try:
        return analysis_of_variance(table.value[known], [str(labels[k]) for k in known], blocks)
    except InputError as error:
        notices.append(Notice("variance-missing", what=error.what, remedy=error.remedy))
        return None


def _labels(parcels: Sequence[Parcel], dose: FloatArray | None) -> list[str | None]:
    """The treatment of each parcel by name; by its dose where the treatments have no names."""
    named = [each.attributes.get(TREATMENT) for each in parcels]
    if any(name is not None for name in named):
        return [None if name is None else f"{name:g}" if isinstance(name, float) else name for name in named]
    if dose is None:
        return [None] * len(parcels)
    return [f"{value:g}" if math.isfinite(value) else None for value in dose]


def _account(flight: _Flight) -> dict[str, Any]:
    found = flight.response
    curve: dict[str, Any] | None = None
    if found is not None and found.curve is not None:
        values = asdict(found.curve)
        band = {name: values.pop(name) for name in ("dose", "fitted", "band_low", "band_high")}
        offsets = dict(zip(found.blocks, values.pop("offsets").tolist(), strict=True))
        curve = {**values, "block_offsets": offsets, "band": band}
    return {
        "day": flight.day.isoformat() if flight.day is not None else None,
        "parcels": len(flight.parcels),
        "words": found.words if found is not None else "The parcels have no doses.",
        "p_no_response": found.p if found is not None else None,
        "plateau_shown": found is not None and found.plateau_shown,
        "curve": curve,
        "variance": asdict(flight.variance) if flight.variance is not None else None,
    }


def _rows(flights: Sequence[_Flight], measure: str, growth: Sequence[Growth]) -> list[dict[str, Any]]:
    """A row for each parcel of the last flight."""
    rates = {each.id: each for each in growth}
    earlier = [
        (f"{measure}_{flight.day}", dict(zip([e.id for e in flight.parcels], flight.table.value.tolist(), strict=True)))
        for flight in flights[:-1]
    ]
    last = flights[-1]
    rows = []
    for each, value, sigma in zip(last.parcels, last.table.value.tolist(), last.table.sigma.tolist(), strict=True):
        row: dict[str, Any] = {"id": each.id, "block": each.block, **each.attributes, measure: value, "sigma": sigma}
        row |= {name: values.get(each.id) for name, values in earlier}
        if growth:
            own = rates.get(each.id)
            row["growth_m_day"] = own.rate_m_day if own is not None else None
            row["growth_sigma_m_day"] = own.sigma_m_day if own is not None else None
        rows.append(row)
    return rows


def _charts(last: _Flight, measure: str, dose: str | None, growth: Sequence[Growth]) -> dict[str, str]:
    blocks = [each.block or "" for each in last.parcels]
    points = ParcelValues(last.table.value, blocks, column_words(measure), "block")
    charts: dict[str, str] = {}
    if last.response is not None and last.dose is not None and dose is not None:
        charts["response.svg"] = response_chart(last.dose, points, last.response, column_words(dose))
    labels = [label or "" for label in _labels(last.parcels, last.dose)]
    if last.variance is not None:
        means = [(each.treatment, each.mean, each.low, each.high) for each in last.variance.means]
        charts["treatments.svg"] = category_chart(labels, points, _ordered(means))
    if len(set(blocks)) > 1:
        by_treatment = ParcelValues(last.table.value, labels, column_words(measure))
        charts["blocks.svg"] = category_chart(blocks, by_treatment, _means(blocks, last.table.value))
    if growth:
        rates = {each.id: each.rate_m_day for each in growth}
        rate = np.array([rates.get(each.id, np.nan) for each in last.parcels])
        named = labels if any(labels) else blocks
        charts["growth.svg"] = category_chart(
            named, ParcelValues(rate, blocks, "growth (m/day)", "block"), _means(named, rate)
        )
    return charts


def _means(names: Sequence[str], value: FloatArray) -> list[tuple[str, float, float, float]]:
    """Mean and standard error of each name."""
    found = []
    for name in dict.fromkeys(names):
        own = value[np.array([each == name for each in names], bool) & np.isfinite(value)]
        if len(own):
            half = float(own.std(ddof=1)) / len(own) ** 0.5 if len(own) > 1 else 0.0
            found.append((name, float(own.mean()), float(own.mean()) - half, float(own.mean()) + half))
    return _ordered(found)


def _ordered(means: list[tuple[str, float, float, float]]) -> list[tuple[str, float, float, float]]:
    """By the number in the name, where each name has one; else as they are."""
    numbers = ["".join(c for c in name if c.isdigit() or c == ".") for name, *_ in means]
    try:
        order = sorted(range(len(means)), key=lambda k: float(numbers[k]))
    except ValueError:
        return means
    return [means[k] for k in order]
