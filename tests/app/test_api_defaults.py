"""Defaults of the Python API, which follows semantic versioning: to change one breaks the scripts of others."""

from __future__ import annotations

import inspect
from dataclasses import asdict, is_dataclass
from typing import Any

import pytest

import furrowmap

FLAGS = {
    "calibrate": {"write"},
    "add_to_farm_map": {"same_crs"},
    **{name: {"overwrite"} for name in ("calibrate_mount", "colour", "solve_gnss")},
    "check_pairs": {"overwrite"},
    "batch": {"dry_run", "overwrite"},
    "run": {"overwrite", "resume"},
    "farm_traffic": {"overwrite"},
    "field_history": {"overwrite"},
    "write_report_page": {"pdf"},
    "share": {"overwrite", "qfield"},
    "tie": {"overwrite"},
    **{
        name: {"overwrite"}
        for name in ("canopy", "check", "clean", "evaluate_gnss", "export", "features", "fields", "growth", "mosaic")
    },
    **{
        name: {"overwrite"}
        for name in ("parcels", "plots", "propose_session", "response", "save_machine", "season", "simulate", "surface")
    },
}
"""What a function does only if asked to."""
TEXTS = {
    "product": "dsm",
    "host": "0.0.0.0",  # the page is for tablets in the local network
    "schema": "furrowmap",
    "layers": (),
    "board_on": "body",
    "board_rpy_deg": (0.0, 0.0, 0.0),
}
SETTINGS: dict[str, dict[str, Any]] = {
    "check": {"targets": "none", "target_shape": "disc", "diameter_m": 0.3},
    "clean": {"cleaning": {"box": None, "without": frozenset(), "every": 1, "outliers": "none", "drop_noise": False,
                           "ground": "none", "voxel_m": None}},
    "evaluate_gnss": {"antenna_offset_m": (0.0, 0.0, 0.0), "fixed_reference_only": False},
    "features": {"ground": "auto", "every": 1},
    "solve_gnss": {"static": False, "mask_deg": 15.0},
    "growth": {"net_inset_m": (0.0, 0.0)},
    "farm_traffic": {"cell_m": 0.1},
    "mosaic": {"mean": False},
    "parcels": {"net_inset_m": (0.0, 0.0), "method": "canopy-top", "soil": "surface", "compare": False},
    "response": {"model": "auto", "without_blocks": False},
    "season": {"content": (), "spacing_m": 0.0, "most_rows": 5_000_000},
    "tie": {"reference_sigma_m": 0.0},
    "surface": {"statistic": "median", "ground": "auto", "outliers": "none", "every": 1, "fill_m": 0.0},
}  # fmt: skip
"""What is not None in the settings of a function."""


def defaults(name: str) -> dict[str, Any]:
    parameters = inspect.signature(getattr(furrowmap, name)).parameters.values()
    return {one.name: one.default for one in parameters if one.default is not one.empty and not callable(one.default)}


FUNCTIONS = [
    name for name in furrowmap.__all__ if inspect.isfunction(getattr(furrowmap, name)) and name != "using_threads"
]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_defaults__change_nothing_that_was_not_asked_for(name: str) -> None:
    found = defaults(name)
    assert {key for key, value in found.items() if value is False} == FLAGS.get(name, set())
    assert [key for key, value in found.items() if value is True] == []
    assert {key: value for key, value in found.items() if isinstance(value, str | tuple)}.items() <= TEXTS.items()
    settings = [value for value in found.values() if is_dataclass(value) and not isinstance(value, type)]
    stated = {key: value for one in settings for key, value in asdict(one).items() if value is not None}
    assert stated == SETTINGS.get({"check_pairs": "check"}.get(name, name), {})
