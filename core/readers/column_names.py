"""What the name of a column means: the usual words, units and ways of writing of other programs.

`Longitude [deg]`, `LON_DEG` and `long` are `lon_deg`; `Height (m)` is `h_m`; `GPS Time` is `time_gps_s`. Capitals and
separators do not matter. If no unit stands in the name, longitudes and latitudes are in degrees, places and their
standard deviations in metres, and times in seconds; angular rates, forces, other angles and ranges must have one, as
several units of each are usual. `altitude` and `elevation` are heights; `linear acceleration` is no specific force, as
many devices give it without gravity.
"""

import re
import unicodedata
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Final

from pyproj import CRS

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice

FOOT_M: Final = 0.3048
_US_FOOT_M: Final = 1200.0 / 3937.0
ELLIPSOIDAL_H: Final = "h_ellipsoidal_m"
SEA_LEVEL_H: Final = "h_orthometric_m"
_NAME_WORDS: Final = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+\d*|[A-Z]+\d*|\d+|[^\W\d_A-Za-z]+")
_IN_BRACKETS: Final = re.compile(r"[(\[{]([^)\]}]*)[)\]}]")
_UNITS_AS_WRITTEN: Final = (
    (
        re.compile(
            r"(?<![a-z])(?:(?:u\.?s\.?[\s_-]*)?survey|u\.?s\.?|s)[\s_-]*(?:feet|foot|ft)(?![a-z])|(?<![a-z])ft[\s_-]*us(?![a-z])",
            re.IGNORECASE,
        ),
        " us ft ",
    ),
    (re.compile(r"(?<=[(\[{])\s*in\.?\s*(?=[)\]}])", re.IGNORECASE), "inch"),
    (re.compile(r"(?:°|deg(?:rees?)?)\s*(?:/|per\s+)\s*s(?:ec(?:onds?)?)?\b", re.IGNORECASE), " dps "),
    (re.compile(r"rad(?:ians?)?\s*(?:/|per\s+)\s*s(?:ec(?:onds?)?)?\b", re.IGNORECASE), " radps "),
    (re.compile(r"\bm\s*/\s*s\s*(?:\^?\s*2|/\s*s)", re.IGNORECASE), " mps2 "),
    (re.compile(r"°"), " deg "),
)
_SAME_WORDS: Final = {
    "latitude": "lat", "latitud": "lat", "breitengrad": "lat", "緯度": "lat", "longitude": "lon", "long": "lon",
    "lng": "lon", "longitud": "lon", "langengrad": "lon", "laengengrad": "lon", "経度": "lon",
    "easting": "e", "east": "e", "rechtswert": "e", "ostwert": "e", "ost": "e", "est": "e", "este": "e", "oost": "e",
    "northing": "n", "north": "n", "hochwert": "n", "nordwert": "n", "nord": "n", "norte": "n", "noord": "n",
    "東距": "e", "北距": "n", "標高": "h", "hauteur": "h", "altura": "h", "altitud": "h", "cota": "h", "quota": "h",
    "height": "h", "hgt": "h", "altitude": "h", "alt": "h", "elevation": "h", "elev": "h", "hohe": "h", "hoehe": "h",
    "ell": "ellipsoidal", "ellipsoid": "ellipsoidal", "ellh": "ellipsoidal h", "楕円体高": "ellipsoidal h",
    "msl": "orthometric", "amsl": "orthometric", "geoid": "orthometric",
    "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
    "metre": "m", "metres": "m", "meter": "m",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "feet": "ft", "foot": "ft", "fuss": "ft", "pied": "ft", "pieds": "ft", "pie": "ft", "pies": "ft", "フィート": "ft",
    "meters": "m", "metro": "m", "metros": "m", "メートル": "m", "yard": "yd", "yards": "yd", "ヤード": "yd",
    "inches": "inch", "zoll": "inch", "インチ": "inch", "decimetre": "dm", "decimetres": "dm",
    "mile": "mi", "miles": "mi", "chains": "chain", "links": "link", "fathoms": "fathom",
    "centimetre": "cm", "centimetres": "cm", "millimetre": "mm", "millimetres": "mm",
    "timestamp": "time", "datetime": "time", "gpstime": "gps time", "gpst": "gps time", "gpstow": "gps tow",
    "unixtime": "unix time", "posix": "unix", "epoch": "unix",
    "gyr": "gyro", "gyroscope": "gyro", "rate": "gyro", "accel": "force", "acc": "force", "acceleration": "force",
    "accelerometer": "force", "gyrox": "gyro x", "gyroy": "gyro y", "gyroz": "gyro z",
    "accx": "force x", "accy": "force y", "accz": "force z",
    "sd": "sigma", "std": "sigma", "stdev": "sigma", "stddev": "sigma",
    "sde": "sigma e", "sdn": "sigma n", "sdu": "sigma h", "sdh": "sigma h",
    "distance": "range", "dist": "range", "hdg": "heading",
}  # fmt: skip
_NO_UNIT: Final = frozenset({"-", "–", "--"})
_MOTION_UNITS: Final = frozenset({"dps", "radps", "mps2", "g", "mg", "deg s", "rad s", "m s2"})
_SAME_LENGTH: Final = 1e-5
"""Both feet count as one: `ft` is written for either."""
_LENGTHS_M: Final = {
    "m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": FOOT_M, "us ft": _US_FOOT_M,
    "inch": FOOT_M / 12.0, "yd": 3.0 * FOOT_M, "fathom": 6.0 * FOOT_M,
    "link": 0.66 * FOOT_M, "chain": 66.0 * FOOT_M, "mi": 5280.0 * FOOT_M,
}  # fmt: skip
_PLAIN_UNITS: Final = frozenset({"deg", "rad", "s", "ms", "us", "ns", *_LENGTHS_M})


def _vocabulary() -> dict[frozenset[str], tuple[str, dict[str, str]]]:
    """Quantities by their words: the name without a unit in the column ("" if it needs one), and names by units."""
    found: dict[frozenset[str], tuple[str, dict[str, str]]] = {}

    def add(words: str, units: dict[str, str], unstated: str = "") -> None:
        found[frozenset(words.split())] = (unstated, units)

    for word in ("lat", "lon"):
        add(word, {"deg": f"{word}_deg"}, f"{word}_deg")
    for words, name in (
        *((word, f"{word}_m") for word in "enh"),
        *((word, word) for word in "xyz"),
        *((f"x {word}", f"{word}_m") for word in "en"),
        *((f"y {word}", f"{word}_m") for word in "en"),
        *((f"sigma {word}", f"sigma_{word}_m") for word in "enh"),
        ("ellipsoidal h", ELLIPSOIDAL_H),
        ("orthometric h", SEA_LEVEL_H),
    ):
        add(words, {"m": name}, name)
    for words, name in (
        *((word, f"{word}_deg") for word in ("roll", "pitch", "yaw", "heading")),
        *((f"sigma {word}", f"sigma_{word}_deg") for word in ("roll", "pitch", "heading")),
        *((f"heading {kind}", f"heading_{kind}_deg") for kind in ("true", "grid", "magnetic")),
    ):
        add(words, {"deg": name})
    add("angle", {"deg": "angle_deg", "rad": "angle_rad"})
    add("range", {"m": "range_m", "mm": "range_mm"})
    for words in ("intensity", "state", "confidence"):
        add(words, {}, words)
    add("common share", {}, "common_share")
    add("sigma", {"s": "sigma_s"})
    add("t", {"s": "t_s"})
    for words in ("file", "filename", "file name", "image", "image name", "image file"):
        add(words, {}, "file")
    for words in ("unix time", "unix"):
        add(words, {"s": "time_unix_s"}, "time_unix_s")
    for words in ("gps time", "gps tow", "gps sow", "tow", "sow"):
        add(words, {"s": "time_gps_s"}, "time_gps_s")
    add("gps", {"s": "time_gps_s"})
    for words in ("time", "utc time"):
        add(words, {}, "time")
    for axis, words in product("xyz", ("gyro", "angular gyro", "angular velocity")):
        units = {"dps": "dps", "deg s": "dps", "radps": "radps", "rad s": "radps"}
        add(f"{words} {axis}", {unit: f"gyro_{axis}_{name}" for unit, name in units.items()})
    for axis, words in product("xyz", ("force", "specific force")):
        units = {"mps2": "mps2", "m s2": "mps2", "g": "g", "mg": "mg"}
        add(f"{words} {axis}", {unit: f"force_{axis}_{name}" for unit, name in units.items()})
    return found


_VOCABULARY: Final = _vocabulary()
MAX_NAMES_BY_MEANING: Final = 1000
"""Columns of a file whose names are read by what they mean; further ones need the name itself."""


@cache
def _words_and_unit(name: str) -> tuple[frozenset[str], str]:
    """The words of a name but its unit, and the unit: the last words, or what stands in brackets."""
    text = _without_accents(name.strip())
    for pattern, unit in _UNITS_AS_WRITTEN:
        text = pattern.sub(unit, text)
    inside = " ".join(_IN_BRACKETS.findall(text))
    outside, bracket = (_plain_words(part) for part in (_IN_BRACKETS.sub(" ", text), inside))
    words = [*outside, *bracket]
    known = _PLAIN_UNITS | (_MOTION_UNITS if {"gyro", "force", "velocity"} & set(words) else frozenset())
    for last in (2, 1):
        unit = " ".join(words[-last:])
        if len(words) > last and unit in known:
            return frozenset(words[:-last]), unit
    return frozenset(words), ""


def _without_accents(text: str) -> str:
    """A text in compatible letters; marks of kana stay."""
    apart = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return unicodedata.normalize("NFKC", "".join(letter for letter in apart if not "\u0300" <= letter <= "\u036f"))


def _plain_words(text: str) -> list[str]:
    words = (found.casefold() for found in _NAME_WORDS.findall(text))
    return [word for found in words for word in _SAME_WORDS.get(found, found).split()]


@cache
def standard_name(name: str) -> str | None:
    """The name that furrowmap gives what a column holds, such as `lat_deg`; None for any other column, or unit."""
    words, unit = _words_and_unit(name)
    unstated, units = _VOCABULARY.get(words, ("", {}))
    return (units.get(unit) if unit else unstated) or None


def with_units(names: Sequence[str], cells: Sequence[str]) -> list[str] | None:
    """The names with the units that the row below them has; None if that row holds anything else."""
    units = [cell.strip().strip("()[]{}").strip() for cell in cells]
    stating = [unit for unit in units if unit and unit not in _NO_UNIT]
    if not stating or len(units) > len(names) or not all(map(_is_unit, stating)):
        return None
    units += [""] * (len(names) - len(units))
    stated = [not unit or unit in _NO_UNIT or states_unit(name) for name, unit in zip(names, units, strict=True)]
    return [
        name if is_stated else f"{name} [{unit}]" for name, unit, is_stated in zip(names, units, stated, strict=True)
    ]


def _is_unit(text: str) -> bool:
    """Whether a cell has a unit and nothing else."""
    return states_unit(f"quantity [{text}]") or states_unit(f"gyro [{text}]")


def states_unit(name: str) -> bool:
    """Whether a unit stands in a name."""
    return _words_and_unit(name)[1] != ""


def length_unit_m(name: str) -> float | None:
    """The unit of length that a name states, in metres; None without one."""
    return _LENGTHS_M.get(_words_and_unit(name)[1])


def in_units(crs: CRS | None, xy: FloatArray, units_m: Sequence[float | None]) -> tuple[FloatArray, list[Notice]]:
    """Eastings and northings (n, 2) in the unit of a CRS, from those of their columns; None is that of the CRS."""
    own_m = crs.axis_info[0].unit_conversion_factor if crs is not None and crs.is_projected else 1.0
    shares = [1.0 if unit_m is None else unit_m / own_m for unit_m in units_m]
    other = next((k for k, share in enumerate(shares) if abs(share - 1.0) > _SAME_LENGTH), None)
    if other is None:
        return xy, []
    unit_m = units_m[other]
    return xy * shares, [Notice("eastings-in-other-unit", unit_m=unit_m, own_m=own_m, is_foot=unit_m == FOOT_M)]


def without_unit(name: str) -> str | None:
    """The standard name of a length in another unit than its own, such as `h_m` of `Height (ft)`; None of others."""
    words, unit = _words_and_unit(name)
    return _VOCABULARY.get(words, ("", {}))[1].get("m") if unit in _LENGTHS_M else None


def standard_names(names: Sequence[str]) -> list[str]:
    """The columns by the names that furrowmap gives them, as they are written where they have none.

    A column that is written so goes before one that only means the same, which keeps its own name.
    """
    there = set(names)
    meant = [standard_name(name) for name in names[:MAX_NAMES_BY_MEANING]]
    known = [
        name if standard is None or standard in there else standard
        for name, standard in zip(names, meant, strict=False)
    ]
    return [*known, *names[MAX_NAMES_BY_MEANING:]]


def expected_once(names: Sequence[str], used: Sequence[str], path: Path) -> dict[str, str]:
    """The name that furrowmap gives each column by that in the file; InputError if several mean one that is used."""
    found = dict(zip(names, standard_names(names), strict=True))
    for name in dict.fromkeys(used):
        same = [own for own, standard in found.items() if standard == name]
        if len(same) > 1:
            raise ambiguous(path, name, same)
    return found


def column_of(accepted: Iterable[str], names: Sequence[str], path: Path) -> str | None:
    """The column of a file that has one of some accepted names, the preferred one first, or means one of them.

    InputError if several columns mean the first of them that any does, so that the choice would be chance.
    """
    wanted = list(accepted)
    exact = next((name for name in wanted if name in names), None)
    if exact is not None:
        return exact
    for name in wanted:
        same = [other for other in dict.fromkeys(names[:MAX_NAMES_BY_MEANING]) if means(other, name)]
        if len(same) > 1:
            raise ambiguous(path, name, same)
        if same:
            return same[0]
    return None


def means(written: str, name: str) -> bool:
    """Whether a column means what a name does, or is only spelled otherwise: in capitals, or with other separators."""
    standard = standard_name(name)
    if standard is not None:
        return standard_name(written) == standard
    return _spelling(written) == _spelling(name) != ""


@cache
def _spelling(name: str) -> str:
    return "".join(_plain_words(_without_accents(name)))


def ambiguous(path: Path, name: str, columns: Sequence[str]) -> InputError:
    """The error of several columns that mean the same."""
    return InputError(
        "column-twice.same-meaning", path=path, name=name, columns=", ".join(f"`{one}`" for one in columns)
    )
