"""The first value of a file that does not fit the type of its key: where it is, what is wanted, and what is there."""

import datetime as dt
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from msgspec import inspect as types

_WANTED_VALUES: Final[Mapping[type[types.Type], tuple[tuple[type, ...], str]]] = {
    types.StrType: ((str,), "text in double quotes"),
    types.IntType: ((int,), "a whole number"),
    types.FloatType: ((float, int), "a number"),
    types.BoolType: ((bool,), "true or false"),
    types.VarTupleType: ((list,), "a list in square brackets"),
    types.TupleType: ((list,), "a list in square brackets"),
    types.DictType: ((dict,), "a table"),
    types.StructType: ((dict,), "a table"),
}
"""The types of TOML's values that each type of a key takes, and how a message names it."""
_THERE: Final = (
    (bool, "true or false"),
    (str, "text in double quotes"),
    (int, "a whole number"),
    (float, "a number"),
    (list, "a list in square brackets"),
    (dict, "a table"),
    (dt.datetime, "a date and time"),
    (dt.date, "a date alone"),
)
"""How a message names a value that is there; the first type that it has counts."""
_MOMENT: Final = "a date and time with its offset from UTC"
_NUMBER_BOUNDS: Final[Sequence[tuple[str, str, Callable[[float, float], bool]]]] = (
    ("ge", ">=", operator.ge),
    ("gt", ">", operator.gt),
    ("le", "<=", operator.le),
    ("lt", "<", operator.lt),
)


@dataclass(frozen=True)
class ValueFault:
    """What is wrong with a value.

    Attributes:
        path: its key with the tables around it, such as `lidar.xyz_m[2]`.
        fault: what it must be, and what it is; empty for a required key that is missing.
    """

    path: str
    fault: str


def value_faults(kind: types.Type, value: Any, path: str = "") -> Iterator[ValueFault]:
    """The faults of a value of TOML, tables and lists included, in the order of the file; missing keys come last."""
    if isinstance(kind, types.UnionType):
        kind = next(one for one in kind.types if not isinstance(one, types.NoneType))  # None is a key that is missing
    if isinstance(kind, types.LiteralType):
        if value not in kind.values:
            yield ValueFault(path, f"must be {' or '.join(map(repr, kind.values))}, not {value!r}")
        return
    if isinstance(kind, types.DateTimeType):
        yield from _moment_fault(value, path)
        return
    classes, words = _WANTED_VALUES[type(kind)]
    fits = isinstance(value, classes) and (bool in classes or not isinstance(value, bool))
    if not fits:
        yield ValueFault(path, f"must be {words}, not {_named(value)}")
    elif isinstance(kind, types.StructType):
        yield from _table_faults(kind, value, path)
    elif isinstance(kind, types.DictType):
        for key, item in value.items():
            yield from value_faults(kind.value_type, item, f"{path}.{key}")
    elif isinstance(kind, types.VarTupleType):
        for number, item in enumerate(value):
            yield from value_faults(kind.item_type, item, f"{path}[{number}]")
    elif isinstance(kind, types.TupleType):
        if len(value) != len(kind.item_types):
            yield ValueFault(path, f"must be a list of {len(kind.item_types)} numbers, but has {len(value)}")
            return
        for number, (item_kind, item) in enumerate(zip(kind.item_types, value, strict=True)):
            yield from value_faults(item_kind, item, f"{path}[{number}]")
    elif isinstance(kind, types.IntType | types.FloatType):
        for name, sign, holds in _NUMBER_BOUNDS:
            limit = getattr(kind, name)
            if limit is not None and not holds(value, limit):
                yield ValueFault(path, f"must be {sign} {limit}")


def _table_faults(kind: types.StructType, table: Mapping[str, Any], path: str) -> Iterator[ValueFault]:
    known = {field.encode_name: field for field in kind.fields}
    for name, value in table.items():
        if name in known:
            yield from value_faults(known[name].type, value, f"{path}.{name}" if path else name)
    for name, field in known.items():
        if field.required and name not in table:
            yield ValueFault(f"{path}.{name}" if path else name, "")


def _moment_fault(value: Any, path: str) -> Iterator[ValueFault]:
    moment = value
    if isinstance(value, str):
        try:
            moment = dt.datetime.fromisoformat(value)
        except ValueError:
            moment = None
    if not isinstance(moment, dt.datetime) or moment.tzinfo is None:
        alone = type(value) is dt.date
        yield ValueFault(path, f"must be {_MOMENT}" + (f", not {_named(value)}" if alone else ""))


def _named(value: object) -> str:
    return next((words for kind, words in _THERE if isinstance(value, kind)), "a time of day")
