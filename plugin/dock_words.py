# SPDX-License-Identifier: GPL-2.0-or-later
"""Texts of furrowmap, which name options of its command line and keys of session files, in the words of dialogs.

People who use QGIS see a form and the toolbox: there `[antenna] xyz_m` is 'GNSS antenna', and `--cell` is 'Cell'.
"""

from __future__ import annotations

import re
from functools import cache, partial

from qgis.PyQt.QtCore import QCoreApplication

from .processing.description import ALGORITHMS

tr = partial(QCoreApplication.translate, "DockWords")

_SESSION_KEYS = re.compile(
    r"`?\[+(\w+)\]+ (\w+)(?: = [^`。]*(?=`))?`?"
    r"(?:( and | or | und | oder |、| と |と| か | または )`?(\w+)`?(?![\w\]]))?"
)
_COMMAND_WORDS = re.compile(r"`furrowmap ([a-z]+(?: [a-z]+)?)((?: [^`]*)?)`")
_PIP_INSTALL = re.compile(
    r"(?:furrowmap のチェックアウト内で )?`?pip install ['\"]?\.\[(\w+)\]['\"]?`?"
    r"((?: または | or | oder )\"\.\[\w+\]\")?"
    r"(?: in the checkout of furrowmap| im Checkout von furrowmap| を実行する(?=か)| を実行してください)?"
)
_OUTPUT_OPTION = re.compile(r" with -o\b|\b[Mm]it -o\b|`?(?<![\w-])-o`? で")
_ANY_OPTION = re.compile(r"`?(?<![\w-])--([a-z][a-z-]+)")
_EXTRA_NAME = re.compile(r"pip install ['\"]?\.\[(\w+)\]")


def in_dock_words(text: str) -> str:
    """A text with the labels of the form and of the toolbox in place of keys, options and commands."""
    if not any(sign in text for sign in ("[", "`", "--", "-o", "pip ")):
        return text
    text = _PIP_INSTALL.sub(_part, text)
    text = _COMMAND_WORDS.sub(_command, text)
    text = _OUTPUT_OPTION.sub(_output, text)
    text = _SESSION_KEYS.sub(_keys, text)
    return _ANY_OPTION.sub(_option, text)


def _output(found: re.Match[str]) -> str:
    """The place of the output instead of the option, at the begin of a sentence, within one, or before the place."""
    words = tr(" under 'Results'")
    if found[0].casefold() == "mit -o":
        return words[1].upper() + words[2:] if found[0][0] == "M" else words[1:]
    return words if found[0].startswith(" ") else tr("'Results': ")


def extra_words() -> dict[str, str]:
    """What each extra of furrowmap is for."""
    return {
        "photo": tr("Images of cameras (OpenCV, Pillow)"),
        "trials": tr("Statistics of trials and spreadsheets"),
        "parquet": tr("GeoParquet"),
        "bags": tr("ROS bags"),
        "csf": tr("Ground by a cloth (CSF)"),
        "postgis": tr("Farm maps in PostGIS"),
        "remote": tr("Recordings in cloud storage"),
    }


def missing_extra(text: str) -> str:
    """The extra of furrowmap that a text asks to install; "" for none."""
    found = _EXTRA_NAME.search(text)
    return found[1] if found else ""


def session_words() -> dict[tuple[str, str], str]:
    """The labels of the form, by table and key of the session file."""
    place, turn = tr("x, y, z"), tr("roll, pitch, yaw")
    sensors = {"lidar": tr("Scanner"), "imu": tr("IMU"), "camera": tr("Camera")}
    return {
        ("antenna", "xyz_m"): tr("'GNSS antenna', x, y, z"),
        **{(table, "xyz_m"): f"'{label}', {place}" for table, label in sensors.items()},
        **{(table, "rpy_deg"): f"'{label}', {turn}" for table, label in sensors.items()},
        ("implement", "width_m"): tr("'Implement', width"),
        ("implement", "xy_m"): tr("'Implement', x, y"),
        ("implement", "working_depth_m"): tr("'Implement', depth"),
        ("implement", "kind"): tr("'Implement', kind"),
        ("field", "boundary"): tr("'Field', boundary"),
        ("recording", "lidar"): tr("'Session', recordings"),
        ("recording", "gnss"): tr("'Session', recordings"),
        ("crs", "map"): tr("'Session', CRS"),
        ("camera", "table"): tr("'Camera', images"),
        ("parcels", "file"): tr("'Parcels', file"),
        ("parcels", "treatments"): tr("'Parcels', treatments"),
    }


def _part(found: re.Match[str]) -> str:
    part = extra_words().get(found[1], found[1])
    return tr("'{part}' in Settings › Options › furrowmap").format(part=part)


def _keys(found: re.Match[str]) -> str:
    words = session_words()
    table, key, between, further = found.groups()
    if (table, key) not in words:
        return found[0]
    if further is None:
        return words[table, key]
    second = words.get((table, further))
    if second is None:
        return f"{words[table, key]}{between}{further}"
    same = second.partition(", ")[0] == words[table, key].partition(", ")[0]
    return f"{words[table, key]}{between}{second.partition(', ')[2] if same else second}"


def _command(found: re.Match[str]) -> str:
    titles = {algorithm.command: algorithm.title for algorithm in ALGORITHMS}
    words = found[1].split()
    title = titles.get(" ".join(words)) or titles.get(words[0])
    return f"'{QCoreApplication.translate('Algorithms', title)}'" if title else found[0]


def _option(found: re.Match[str]) -> str:
    label = _labels().get(f"--{found[1]}")
    return f"'{QCoreApplication.translate('Algorithms', label)}'" if label else found[0]


@cache
def _labels() -> dict[str, str]:
    """The label of each option in the toolbox."""
    parameters = [parameter for algorithm in ALGORITHMS for parameter in algorithm.parameters]
    return {parameter.option: parameter.label for parameter in reversed(parameters)}
