"""Sessions from the structs of the session itself: each table and key with valid, boundary and wrong values.

A session begins as one that is valid. Then keys are added with values that their types allow, and some are made wrong.
A key that is new in the structs joins by itself.
"""

from __future__ import annotations

import copy
import datetime as dt
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final

from msgspec import inspect

from furrowmap.core.session.session_file import FURTHER
from furrowmap.core.values.session import EXAMPLES, Session
from tests.fuzz_sessions.material import Stock, toml_of

FILE: Final = re.compile(r"[\w*/]+\.[a-z]\w{1,4}")
"""What the example of a key looks like that names a file."""
FURTHER_FILES: Final = {"parcels.soil"}
"""Keys that may name a file, although their examples do not."""
WORDS: Final = {
    "crs.map": (
        "EPSG:6677",
        "EPSG:25832",
        "EPSG:32654",
        "EPSG:4326",
        "EPSG:3857",
        "EPSG:2443",
        "utm",
        "auto",
        "EPSG:0",
    ),
    "crs.heights": ("ellipsoidal", "EGM2008", "EGM96", "JPGEO2024", "DHHN2016", "EPSG:3855"),
    "crs.coordinates": ("as-recorded", "current-epoch", "itrf2020@2026.4", "JGD2011", "ETRS89", "itrf2014@x"),
    "imu.class": ("industrial", "tactical", "consumer", "VN-200", "navigation", "mems"),
    "lidar.model": ("VLP-16", "HDL-32E", "VLS-128", "OS1-32", "PandarXT-32", "VLP-16 Hi-Res", "Puck"),
    "camera.model": ("OPENCV", "SIMPLE_PINHOLE", "PINHOLE", "OPENCV_FISHEYE", "RADIAL", "FULL_OPENCV"),
    "field.time_zone": ("Asia/Tokyo", "UTC", "Europe/Copenhagen", "Etc/GMT+12", "../UTC", "/etc/localtime"),
    "implement.kind": ("rotary tiller", "mower", "plough", "sprayer", "roller", "seeder"),
    "recording.date": ("2026-06-11", "2026-05-23", "0001-01-01", "9999-12-31"),
    "run.fixes": ("fixed", "float", "dgps", "single", "none"),
    "parcels.method": ("christiansen2017", "canopy-top", "other"),
    "parcels.soil": ("plane", "surface", "soil.tif", "cloud.las"),
}
"""Texts that mean something to a key, right or wrong, besides its example."""
HOSTILE: Final = (
    "", " ", ".", "..", "/", "~", "*", "**", "**/*", "[", "?", "\\", "../outside/canary.nmea", "../outside",
    "{outside}/canary.nmea", "{outside}/canary.csv", "file://{outside}/canary.geojson", "{outside}/*",
    "../../**/canary*", "/vsicurl/http://127.0.0.1:9/a.geojson", "/vsizip/{outside}/canary.zip", "/vsimem/a",
    "/vsistdin/",
    "http://127.0.0.1:9/a.nmea", "https://127.0.0.1:9/a", "s3://a/b", "ftp://127.0.0.1:9/a",
    "GPKG:{outside}/canary.gpkg",
    "<OGRVRTDataSource/>", "MEM:::DATAPOINTER=1", "PG:host=127.0.0.1", "WFS:http://127.0.0.1:9", "/dev/zero",
    "/dev/stdin",
    "/dev/full", "/proc/self/mem", "/proc/self/environ", "a\0b", "a\nb", "a\rb", "\x1b[2J\x1b]0;x\x07", "\u202egnp.x",
    "圃場", "e\u0301", "\ud7ff", "\U0001f69c", "\ufeff", "x" * 300, "x/" * 600 + "x", "圃" * 100, "con", "nul.tif",
    "C:\\x",
    "\\\\host\\x", "-rf", "--help", "%s%n%d", "{0.__class__}", "${HOME}", "$(touch x)", "`touch x`",
    "'; DROP TABLE x; --",
    "<script>alert(1)</script>", "=cmd|'/c calc'!A0", "{{7*7}}", "session.toml", "./session.toml", "a/../session.toml",
    "report.json", "out/report.json", "+proj=merc +nadgrids={outside}/canary.gsb", "+init=epsg:4326", "EPSG:99999999",
    "EPSG:6677+5773", "urn:ogc:def:crs:EPSG::6677", "PROJCS[", "1e400", "nan", "None", "null", "true",
)  # fmt: skip
NEARLY_RIGHT: Final = 0.07
"""Share of sessions that are right but for one thing, which is not seen at once."""
SMALL: Final = (
    0.0,
    -0.0,
    1e-300,
    1e-9,
    -1e-3,
    0.01,
    0.5,
    -0.5,
    1.0,
    -1.0,
    3.0,
    -9.0,
    14.999,
    45.0,
    90.0,
    -90.0,
    180.0,
    359.0,
)
NUMBERS: Final = (
    0, 1, -1, 2, 7, 16, 255, 65536, 2**31 - 1, 2**31, 2**53 + 1, 2**63 - 1, -(2**63), 0.0, -0.0, 0.1, -0.1, 1e-300,
    5e-324,
    -1e-12, 1e-3, 0.5, 1.5, 15.0, 15.000001, -15.0, 89.9999, 90.0, 180.0, 360.0, -360.0, 361.0, 1e3, 1e5, 1e6, 1e9,
    1e15,
    1.7e308, -1.7e308, math.nan, -math.nan, math.inf, -math.inf, 100.0, 100.5, 3600.0, 86400.0, 604800.0, 1781190000.0,
)  # fmt: skip
OTHERS: Final[tuple[Any, ...]] = (
    True, False, "text", "1.0", [], {}, [[]], [{}], [0.0], [0.0, 0.0], [0.0, 0.0, 0.0], [1, 2, 3, 4], ["a"], ["a", "a"],
    [["a"]], {"a": 1}, {"a": {"a": {}}}, dt.date(2026, 6, 11), dt.datetime(2026, 6, 11, 15),  # noqa: DTZ001 (TOML has such)
    dt.time(15, 0),
    dt.datetime(2026, 6, 11, 15, 0, 0, tzinfo=dt.UTC), dt.datetime(1, 1, 1, tzinfo=dt.UTC), 0, 1.5, "",
)  # fmt: skip
"""Values of every type."""


@dataclass
class SessionText:
    """A session as it is to be written.

    Attributes:
        data: its tables.
        edits: changes of the text, each a share of its length and what is put in there; None cuts it off there.
        wrong: number of things that were made wrong.
    """

    data: dict[str, Any]
    edits: list[tuple[float, str | None]] = field(default_factory=list)
    wrong: int = 0

    def text(self) -> str:
        """The text."""
        text = toml_of(self.data)
        for share, put in self.edits:
            at = round(share * len(text))
            text = text[:at] if put is None else text[:at] + put + text[at:]
        return text


def fields_of(struct: type) -> dict[str, inspect.Field]:
    """The fields of a table by the name of their key."""
    kind = inspect.type_info(struct)
    assert isinstance(kind, inspect.StructType)
    return {one.encode_name: one for one in kind.fields if one.name not in FURTHER.values()}


def inner(kind: inspect.Type) -> inspect.Type:
    """The type of a key that may be left out."""
    if isinstance(kind, inspect.UnionType):
        return next(one for one in kind.types if not isinstance(one, inspect.NoneType))
    return inner(kind.type) if isinstance(kind, inspect.Metadata) else kind


TABLES: Final = {
    name: fields_of(kind.cls)
    for name, one in fields_of(Session).items()
    if isinstance(kind := inner(one.type), inspect.StructType)
}
"""The keys of each table."""
KEYS: Final = [(table, key) for table, keys in TABLES.items() for key in keys]


def session_of(stock: Stock, chance: Random) -> SessionText:
    """A random session."""
    base = chance.choice([*stock.bases.values(), {"furrowmap": 1}])
    made = SessionText(copy.deepcopy(dict(base)))
    near = chance.random() < NEARLY_RIGHT
    for _ in range(chance.choice((0, 1)) if near else min(int(chance.expovariate(0.35)), 25)):
        table, key = _there(made, chance) if near else chance.choice(KEYS)
        _put(made.data, chance, table, key, valid(f"{table}.{key}", TABLES[table][key].type, stock, chance))
    made.wrong = 1 if near else chance.choices((0, 1, 2, 3, 8, 25), (20, 40, 15, 10, 10, 5))[0]
    for _ in range(made.wrong):
        (_nearly if near else chance.choices(WRONGS, WEIGHTS)[0])(made, stock, chance)
    return made


def _there(made: SessionText, chance: Random) -> tuple[str, str]:
    """A key of a table that the session has."""
    there = [each for each in KEYS if isinstance(made.data.get(each[0]), dict)]
    return chance.choice(there or KEYS)


def _nearly(made: SessionText, stock: Stock, chance: Random) -> None:
    """A number that may be right, or another file of the right kind: what is refused late, if at all."""
    numbers = [each for each in KEYS if isinstance(inner(TABLES[each[0]][each[1]].type), inspect.FloatType)]
    files = [each for each in KEYS if names_files(".".join(each))]
    vectors = [each for each in KEYS if isinstance(inner(TABLES[each[0]][each[1]].type), inspect.TupleType)]
    kind = chance.choice((numbers, files, vectors))
    table, key = chance.choice([each for each in kind if isinstance(made.data.get(each[0]), dict)] or kind)
    if kind is files:
        value = valid(f"{table}.{key}", TABLES[table][key].type, stock, chance)
    elif kind is numbers:
        value = chance.choice([*SMALL, _number(f"{table}.{key}", inner(TABLES[table][key].type), chance)])
    else:
        value = _of_list(made, table, key)
        value[chance.randrange(len(value))] = chance.choice(SMALL)
    _put(made.data, chance, table, key, value)


def _put(data: dict[str, Any], chance: Random, table: str, key: str, value: object) -> None:
    """Set a key of a table, or of one of several; a table that is new gets the keys that it needs, by examples."""
    found = data.setdefault(table, {})
    if isinstance(found, list):
        found = chance.choice(found) if found else {}
    if isinstance(found, dict):
        for name, one in TABLES[table].items():
            if one.required and name not in found:
                found[name] = example(f"{table}.{name}")
        found[key] = value


def example(key: str) -> Any:
    """The example of a key; 0 for one without."""
    return tomllib.loads(f"x = {EXAMPLES.get(key, '0')}")["x"]


def names_files(key: str) -> bool:
    """Whether a key names files."""
    return FILE.search(EXAMPLES.get(key, "").strip('[]"')) is not None or key in FURTHER_FILES


def valid(key: str, kind: inspect.Type, stock: Stock, chance: Random) -> Any:
    """A value that the type of a key allows, most often one that makes sense."""
    kind = inner(kind)
    if isinstance(kind, inspect.StructType):
        return {
            name: valid(f"{key}.{name}", one.type, stock, chance)
            for name, one in fields_of(kind.cls).items()
            if one.required or chance.random() < 0.4
        }
    if isinstance(kind, inspect.LiteralType):
        return chance.choice(kind.values)
    if isinstance(kind, inspect.BoolType):
        return chance.random() < 0.5
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        return _number(key, kind, chance)
    if isinstance(kind, inspect.StrType):
        if names_files(key) and chance.random() < 0.9:
            return chance.choice(stock.of(key)).name
        return chance.choice([*WORDS.get(key, ()), str(example(key))])
    if isinstance(kind, inspect.DateTimeType):
        hour = dt.datetime(2026, 6, 11, 14, 59, 58, tzinfo=dt.UTC)
        return hour + dt.timedelta(seconds=chance.choice((-3600, -1, 0, 0.5, 1, 1.5, 3, 3600)))
    if isinstance(kind, inspect.TupleType):
        given = example(key)
        if isinstance(given, list) and chance.random() < 0.7:
            return given
        return [valid(key, one, stock, chance) for one in kind.item_types]
    if isinstance(kind, inspect.VarTupleType):
        return [valid(key, kind.item_type, stock, chance) for _ in range(chance.choice((1, 1, 1, 2, 3)))]
    return example(key)


def _number(key: str, kind: inspect.Type, chance: Random) -> int | float:
    """A number inside the limits, or at one."""
    assert isinstance(kind, inspect.IntType | inspect.FloatType)
    low = kind.ge if kind.ge is not None else kind.gt
    high = kind.le if kind.le is not None else kind.lt
    given = example(key)
    whole = isinstance(kind, inspect.IntType)
    usual = [given] if isinstance(given, int | float) else []
    limits = [limit for limit in (kind.ge, kind.le) if limit is not None]
    drawn = chance.uniform(-3.0 if low is None else low, 3.0 if high is None else high)
    number = chance.choice([*usual, *usual, *limits, drawn])
    return round(number) if whole else float(number)


def _any_key(made: SessionText, chance: Random) -> tuple[str, str]:
    """A key that is there, most often, else any."""
    there = [(table, key) for table, key in KEYS if isinstance(made.data.get(table), dict) and key in made.data[table]]
    return chance.choice(there if there and chance.random() < 0.7 else KEYS)


def _wrong_value(made: SessionText, stock: Stock, chance: Random) -> None:
    """A value of another type, or beyond a limit."""
    table, key = _any_key(made, chance)
    kind = inner(TABLES[table][key].type)
    if isinstance(kind, inspect.TupleType | inspect.VarTupleType) and chance.random() < 0.6:
        value = _of_list(made, table, key)
        change = chance.randrange(4)
        if change == 0 or not value:
            value = [*value, chance.choice((*NUMBERS, *OTHERS))]
        elif change == 1:
            value = value[:-1]
        elif change == 2:
            value = value * chance.choice((2, 50))
        else:
            value[chance.randrange(len(value))] = chance.choice(NUMBERS)
    elif isinstance(kind, inspect.IntType | inspect.FloatType) and chance.random() < 0.7:
        limits = [limit for limit in (kind.ge, kind.gt, kind.le, kind.lt) if limit is not None]
        near = [limit + step for limit in limits for step in (0.0, 1e-9, -1e-9, 1.0, -1.0)]
        value = chance.choice([*NUMBERS, *near])
    else:
        value = chance.choice((*OTHERS, *NUMBERS))
    _put(made.data, chance, table, key, value)


def _of_list(made: SessionText, table: str, key: str) -> list[Any]:
    found = made.data.get(table)
    value = found.get(key) if isinstance(found, dict) else None
    given = value if isinstance(value, list) else example(f"{table}.{key}")
    return list(given) if isinstance(given, list) else [given]


def _wrong_text(made: SessionText, stock: Stock, chance: Random) -> None:
    """A hostile text where a text is expected."""
    texts = [(table, key) for table, key in KEYS if _takes_text(TABLES[table][key].type)]
    there = [each for each in texts if isinstance(made.data.get(each[0]), dict) and each[1] in made.data[each[0]]]
    table, key = chance.choice(there if there and chance.random() < 0.6 else texts)
    text: Any = chance.choice(HOSTILE)
    if isinstance(inner(TABLES[table][key].type), inspect.VarTupleType):
        text = [text] if chance.random() < 0.7 else [*_of_list(made, table, key), text]
    _put(made.data, chance, table, key, text)


def _takes_text(kind: inspect.Type) -> bool:
    kind = inner(kind)
    return isinstance(kind.item_type if isinstance(kind, inspect.VarTupleType) else kind, inspect.StrType)


def _wrong_role(made: SessionText, stock: Stock, chance: Random) -> None:
    """A file of another kind."""
    table, key = chance.choice([each for each in KEYS if names_files(".".join(each))])
    name = chance.choice(stock.material).name
    several = isinstance(inner(TABLES[table][key].type), inspect.VarTupleType)
    _put(made.data, chance, table, key, [name] if several else name)


def _unknown_key(made: SessionText, stock: Stock, chance: Random) -> None:
    table, key = chance.choice(KEYS)
    name = chance.choice((key + "s", key[:-1] or "k", key.upper(), *HOSTILE[:12], "__class__", *FURTHER.values()))
    found = made.data if chance.random() < 0.3 else made.data.setdefault(table, {})
    if isinstance(found, dict):
        found[name] = chance.choice((*OTHERS, *NUMBERS))


def _without(made: SessionText, stock: Stock, chance: Random) -> None:
    """A key or a table less."""
    name = chance.choice([*made.data, "name"])
    found = made.data.get(name)
    if isinstance(found, dict) and found and chance.random() < 0.7:
        del found[chance.choice([*found])]
    else:
        made.data.pop(name, None)


def _wrong_table(made: SessionText, stock: Stock, chance: Random) -> None:
    """A table several times, none, or a value in its place."""
    name = chance.choice([*TABLES])
    found = made.data.get(name)
    one = found if isinstance(found, dict) else {}
    other = {key: valid(f"{name}.{key}", each.type, stock, chance) for key, each in TABLES[name].items()}
    some = {key: value for key, value in other.items() if chance.random() < 0.3}
    made.data[name] = chance.choice(
        ([one, some], [one, one | some], [one] * 6, [], {}, [one], [[one]], chance.choice(OTHERS), some)
    )


def _edit(made: SessionText, stock: Stock, chance: Random) -> None:
    """Something put into the text, or its end cut off."""
    put = chance.choice(
        (None, "\0", "\r", "\r\n", "=", "[", "]]", '"', "'''", "\ufeff", "\udcff", "# comment", "\n[recording]\n",
         "\nfurrowmap = 1\n", "\nname = 1\n", "[" * 3000, "\na." * 300, "9" * 5000, "\n[[lidar]]\n", "\n[crs.map]\n")
    )  # fmt: skip
    made.edits.append((chance.choice((0.0, 1.0, chance.random())), put))


WRONGS: Final[tuple[Callable[[SessionText, Stock, Random], None], ...]] = (
    _wrong_value, _wrong_text, _wrong_role, _unknown_key, _without, _wrong_table, _edit,
)  # fmt: skip
WEIGHTS: Final = (30, 25, 20, 5, 8, 6, 6)


def names_in(data: object) -> Iterator[str]:
    """All texts in a session, among them those that name files."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, Mapping):
        for one in data.values():
            yield from names_in(one)
    elif isinstance(data, list | tuple):
        for one in data:
            yield from names_in(one)


def smaller(made: SessionText) -> Iterator[SessionText]:
    """The session with one thing less: an edit, a table, a key."""
    for k in range(len(made.edits)):
        yield SessionText(made.data, made.edits[:k] + made.edits[k + 1 :], made.wrong)
    for name, found in made.data.items():
        if name != "furrowmap":
            yield SessionText({key: one for key, one in made.data.items() if key != name}, made.edits, made.wrong)
        if isinstance(found, dict):
            for key in found:
                less = {other: one for other, one in found.items() if other != key}
                yield SessionText(made.data | {name: less}, made.edits, made.wrong)
