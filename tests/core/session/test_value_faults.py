"""Faults of values: what msgspec refuses has one, what it takes has none."""

from __future__ import annotations

import datetime as dt
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta
from msgspec.inspect import type_info

from furrowmap.core.session.value_faults import value_faults


class Inner(msgspec.Struct, frozen=True):
    """A table in a table."""

    place: tuple[float, float] | None = None
    count: Annotated[int, Meta(ge=1, le=9)] = 1
    mode: Literal["on", "off"] = "on"
    names: tuple[str, ...] = ()
    begin: Annotated[dt.datetime, Meta(tz=True)] | None = None


class Outer(msgspec.Struct, frozen=True):
    """A file."""

    title: str
    inner: Inner | None = None
    shares: dict[str, Annotated[float, Meta(gt=0.0, lt=1.0)]] = {}
    deep: bool = False


VALUES = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(-2, 10),
        st.floats(-2.0, 2.0).filter(lambda value: not value.is_integer()),  # msgspec takes 1.0 for a whole number
        st.sampled_from(["on", "a"]),
        st.dates(),
        st.just(dt.datetime(2026, 6, 11, tzinfo=dt.UTC)),
        st.just(dt.datetime(2026, 6, 11)),  # noqa: DTZ001 - a local time of TOML
    ),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)
TABLES = st.fixed_dictionaries(
    {},
    optional={
        "title": VALUES,
        "inner": VALUES
        | st.fixed_dictionaries({}, optional=dict.fromkeys(("place", "count", "mode", "names", "begin"), VALUES)),
        "shares": VALUES | st.dictionaries(st.sampled_from("ab"), VALUES, max_size=2),
        "deep": VALUES,
    },
)


@given(TABLES)
def test_what_msgspec_refuses__has_a_fault(table: dict[str, object]) -> None:
    try:
        msgspec.convert(table, Outer)
    except msgspec.ValidationError:
        assert list(value_faults(type_info(Outer), table))
    else:
        assert not list(value_faults(type_info(Outer), table))


@pytest.mark.parametrize(
    ("table", "path", "fault"),
    [
        ({}, "title", ""),
        ({"title": 3}, "title", "must be text in double quotes, not a whole number"),
        ({"title": "", "deep": 1}, "deep", "must be true or false, not a whole number"),
        (
            {"title": "", "inner": {"place": [1.0, "2"]}},
            "inner.place[1]",
            "must be a number, not text in double quotes",
        ),
        ({"title": "", "inner": {"place": [1.0]}}, "inner.place", "must be a list of 2 numbers, but has 1"),
        ({"title": "", "inner": {"count": 0}}, "inner.count", "must be >= 1"),
        ({"title": "", "inner": {"mode": "no"}}, "inner.mode", "must be 'off' or 'on', not 'no'"),
        (
            {"title": "", "inner": {"names": ["a", True]}},
            "inner.names[1]",
            "must be text in double quotes, not true or false",
        ),
        ({"title": "", "shares": {"a": 1.5}}, "shares.a", "must be < 1.0"),
        (
            {"title": "", "inner": {"begin": dt.date(2026, 6, 11)}},
            "inner.begin",
            "must be a date and time with its offset from UTC, not a date alone",
        ),
    ],
)
def test_fault__says_where_and_what(table: dict[str, object], path: str, fault: str) -> None:
    found = next(value_faults(type_info(Outer), table))
    assert (found.path, str(found.fault or "")) == (path, fault)
