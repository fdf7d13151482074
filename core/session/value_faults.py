"""The first value of a file that does not fit the type of its key: where it is, what is wanted, and what is there."""

import datetime as dt
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from msgspec import inspect as types

from furrowmap.core.runtime.languages.texts import Text

_WANTED_VALUES: Final[Mapping[type[types.Type], tuple[tuple[type, ...], Text]]] = {
    types.StrType: ((str,), Text("text in double quotes")),
    types.IntType: ((int,), Text("a whole number")),
    types.FloatType: ((float, int), Text("a number")),
    types.BoolType: ((bool,), Text("true or false")),
    types.VarTupleType: ((list,), Text("a list in square brackets")),
    types.TupleType: ((list,), Text("a list in square brackets")),
    types.DictType: ((dict,), Text("a table")),
    types.StructType: ((dict,), Text("a table")),
}
"""The types of TOML's values that each type of a key takes, and how a message names it."""
_THERE: Final = (
    (bool, Text("true or false")),
    (str, Text("text in double quotes")),
    (int, Text("a whole number")),
    (float, Text("a number")),
    (list, Text("a list in square brackets")),
    (dict, Text("a table")),
    (dt.datetime, Text("a date and time")),
    (dt.date, Text("a date alone")),
)
"""How a message names a value that is there; the first type that it has counts."""
_MOMENT: Final = Text("a date and time with its offset from UTC")
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
        fault: what it must be, and what it is; None for a required key that is missing.
    """

    path: str
    fault: Text | None


def value_faults(kind: types.Type, value: Any, path: str = "") -> Iterator[ValueFault]:
    """The faults of a value of TOML, tables and lists included, in the order of the file; missing keys come last."""
    if isinstance(kind, types.UnionType):
        kind = next(one for one in kind.types if not isinstance(one, types.NoneType))  # None is a key that is missing
    if isinstance(kind, types.LiteralType):
        if value not in kind.values:
            yield ValueFault(
                path, Text("must be {wanted:or}, not {there}", wanted=tuple(map(repr, kind.values)), there=repr(value))
            )
        return
    if isinstance(kind, types.DateTimeType):
        yield from _moment_fault(value, path)
        return
    classes, words = _WANTED_VALUES[type(kind)]
    fits = isinstance(value, classes) and (bool in classes or not isinstance(value, bool))
    if not fits:
        yield ValueFault(path, Text("must be {wanted:or}, not {there}", wanted=words, there=_named(value)))
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
            yield ValueFault(
                path,
                Text(
                    "must be a list of {count} numbers, but has {there}", count=len(kind.item_types), there=len(value)
                ),
            )
            return
        for number, (item_kind, item) in enumerate(zip(kind.item_types, value, strict=True)):
            yield from value_faults(item_kind, item, f"{path}[{number}]")
    elif isinstance(kind, types.IntType | types.FloatType):
        for name, sign, holds in _NUMBER_BOUNDS:
            limit = getattr(kind, name)
            if limit is not None and not holds(value, limit):
                yield ValueFault(path, Text("must be {sign} {limit}", sign=sign, limit=limit))


def _table_faults(kind: types.StructType, table: Mapping[str, Any], path: str) -> Iterator[ValueFault]:
    known = {field.encode_name: field for field in kind.fields}
    for name, value in table.items():
        if name in known:
            yield from value_faults(known[name].type, value, f"{path}.{name}" if path else name)
    for name, field in known.items():
        if field.required and name not in table:
            yield ValueFault(f"{path}.{name}" if path else name, None)


def _moment_fault(value: Any, path: str) -> Iterator[ValueFault]:
    moment = value
    if isinstance(value, str):
        try:
            moment = dt.datetime.fromisoformat(value)
        except ValueError:
            moment = None
    if not isinstance(moment, dt.datetime) or moment.tzinfo is None:
        there = _named(value) if type(value) is dt.date else None
        yield ValueFault(path, Text("must be {wanted}{there:, not {there}|}", wanted=_MOMENT, there=there))


def _named(value: object) -> Text:
    return next((words for kind, words in _THERE if isinstance(value, kind)), Text("a time of day"))
