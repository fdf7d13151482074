"""The response of a trial to its treatments, from tables of its parcels."""

import datetime as dt
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.crops.dose_columns import column_words
from furrowmap.core.crops.growth_between import Growth, growth_of
from furrowmap.core.crops.response_values import Response
from furrowmap.core.crops.trial import Trial, TrialPlan, analyse_trial
from furrowmap.core.crops.trial_tables import (
    MEASURE,
    MeasuredTable,
    day_of,
    read_measured,
    read_treatments,
    with_treatments,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice, UsageError
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.atomic import refuse_existing
from furrowmap.exporters.files.csv_cells import write_csv_table
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.exporters.files.workbooks import write_workbook
from furrowmap.exporters.reports.trial_charts import (
    ParcelValues,
    category_chart,
    residual_chart,
    response_chart,
    standalone,
)
from furrowmap.settings import ResponseSettings

RESPONSE_REPORT: Final = "response.json"


@dataclass(frozen=True)
class _Flight:
    """A trial on a day."""

    day: dt.date | None
    parcels: tuple[Parcel, ...]
    table: MeasuredTable
    trial: Trial
    notices: tuple[Notice, ...]


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
        tables: CSV or spreadsheet with the figures of parcels, such as parcels.csv or yields: one for each flight.
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
    flights = [
        _flight(Path(path), day, Path(treatments) if treatments is not None else None, settings)
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
    charts = _charts(last, measure, growth)
    account = {
        "measure": measure,
        "dose": last.trial.dose_name,
        "price_ratio": settings.ratio,
        "flights": [_account(flight) for flight in flights],
        "growth": [asdict(each) for each in growth],
        "warnings": list(dict.fromkeys(notice for flight in flights for notice in flight.notices)),
    }
    with staged_folder(folder) as staging:
        for name, chart in charts.items():
            (staging / name).write_text(standalone(chart, language_of_user()), encoding="utf-8")
        write_csv_table(staging / "trial.csv", list(dict.fromkeys(name for row in rows for name in row)), rows)
        write_workbook(staging / "trial.xlsx", _sheets(last, rows))
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


def _flight(path: Path, day: dt.date | None, treatments: Path | None, settings: ResponseSettings) -> _Flight:
    table = read_measured(path, settings.measure or MEASURE, settings.sites or ())
    notices = [*table.notices]
    parcels = table.parcels
    if treatments is not None:
        parcels, more = with_treatments(parcels, read_treatments(treatments, day))
        notices += more
    plan = TrialPlan(
        dose=settings.dose,
        model=settings.model if settings.model != "auto" else None,
        ratio=settings.ratio,
        factors=settings.factors or (),
        covariate=settings.covariate,
        blocks=not settings.without_blocks,
    )
    trial = analyse_trial(parcels, table.value, plan)
    return _Flight(day, parcels, table, trial, (*notices, *trial.notices))


def _account(flight: _Flight) -> dict[str, Any]:
    trial = flight.trial
    return {
        "day": flight.day.isoformat() if flight.day is not None else None,
        "parcels": len(flight.parcels),
        **(_response_account(trial.response) if trial.response is not None else {}),
        "sentences": [str(sentence) for sentence in trial.sentences],
        "parts": [{"by": part.by, "label": part.label, **_response_account(part.response)} for part in trial.parts],
        "differs": dict(trial.differs),
        "variance": asdict(trial.variance) if trial.variance is not None else None,
    }


def _response_account(found: Response) -> dict[str, Any]:
    values = asdict(replace(found, sentences=()))
    band = {name: values.pop(name) for name in ("dose", "band_low", "band_high")}
    for name in ("expected", "residual", "parcels"):
        values.pop(name)
    return {**values, "sentences": [str(sentence) for sentence in found.sentences], "band": band}


def _sheets(last: _Flight, rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The sheets of the spreadsheet."""
    sheets = {"parcels": rows}
    variance = last.trial.variance
    if variance is not None:
        sheets["treatments"] = [asdict(mean) for mean in variance.means]
        sheets["variance"] = [asdict(row) for row in variance.rows]
        if variance.cells:
            sheets["two-way"] = [asdict(each) for each in variance.cells]
    found = last.trial.response
    if found is not None and found.models:
        sheets["shapes"] = [
            {
                "shape": each.name,
                "weight": each.weight,
                "aicc": each.aicc,
                "r2": each.r2,
                "sigma": each.sigma,
                "lack_of_fit_p": each.lack_of_fit_p,
                **{
                    f"{name}_{end}": getattr(optimum, end)
                    for name, optimum in (("agronomic", each.agronomic), ("economic", each.economic))
                    if optimum is not None
                    for end in ("value", "low", "high")
                },
                "coefficients": ", ".join(f"{name} {value:.6g}" for name, value in each.coefficients.items()),
            }
            for each in found.models
        ]
        sheets["gains"] = [asdict(each) for each in found.gains]
    return sheets


def _rows(flights: Sequence[_Flight], measure: str, growth: Sequence[Growth]) -> list[dict[str, Any]]:
    """A row for each parcel of the last flight."""
    rates = {each.id: each for each in growth}
    earlier = [
        (f"{measure}_{flight.day}", dict(zip([e.id for e in flight.parcels], flight.table.value.tolist(), strict=True)))
        for flight in flights[:-1]
    ]
    last = flights[-1]
    rows = []
    found = last.trial.response
    for k, (each, value, sigma) in enumerate(
        zip(last.parcels, last.table.value.tolist(), last.table.sigma.tolist(), strict=True)
    ):
        row: dict[str, Any] = {"id": each.id, "block": each.block, **each.attributes, measure: value, "sigma": sigma}
        row |= {name: values.get(each.id) for name, values in earlier}
        if found is not None and found.models:
            row |= {"expected": float(found.expected[k]), "residual": float(found.residual[k])}
        if growth:
            own = rates.get(each.id)
            row["growth_m_day"] = own.rate_m_day if own is not None else None
            row["growth_sigma_m_day"] = own.sigma_m_day if own is not None else None
        rows.append(row)
    return rows


def _charts(last: _Flight, measure: str, growth: Sequence[Growth]) -> dict[str, str]:
    trial = last.trial
    blocks = [each.block or "" for each in last.parcels]
    points = ParcelValues(last.table.value, blocks, column_words(measure), Text("block"))
    charts: dict[str, str] = {}
    found = trial.response
    if found is not None and trial.dose is not None and trial.dose_name is not None:
        charts["response.svg"] = response_chart(trial.dose, points, found, column_words(trial.dose_name))
        if found.models:
            charts["residuals.svg"] = residual_chart(found.expected, found.residual, points)
    labels = [label or "" for label in trial.labels]
    if trial.variance is not None and trial.variance.means:
        first = trial.variance.means[0].factor
        means = [each for each in trial.variance.means if each.factor == first]
        named = [level or "" for level in trial.levels[first]]
        shown = [(each.treatment, each.mean, each.low, each.high) for each in means]
        letters = {each.treatment: each.letters for each in means}
        charts["treatments.svg"] = category_chart(named, points, _ordered(shown), letters)
    if len(set(blocks)) > 1:
        by_treatment = ParcelValues(last.table.value, labels, column_words(measure))
        charts["blocks.svg"] = category_chart(blocks, by_treatment, _means(blocks, last.table.value))
    if growth:
        rates = {each.id: each.rate_m_day for each in growth}
        rate = np.array([rates.get(each.id, np.nan) for each in last.parcels])
        named = labels if any(labels) else blocks
        charts["growth.svg"] = category_chart(
            named, ParcelValues(rate, blocks, Text("growth (m/day)"), Text("block")), _means(named, rate)
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
