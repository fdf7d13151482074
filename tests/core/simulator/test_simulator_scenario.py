"""Scenarios: what a file may say, and what is filled in."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.simulator.scenario import (
    SOILS,
    TOOL_BOXES,
    Scenario,
    ScenarioImplement,
    ScenarioLidar,
    ScenarioSoil,
    as_toml,
    demo_scenario,
    load_scenario,
    scenario_from,
)


@pytest.mark.parametrize("name", ["tractor_loop", "tractor_fishtail"])
def test_load_scenario__samples_of_another_simulator(shared_data: Path, name: str) -> None:
    scenario = load_scenario(shared_data / name / "scenario.toml")
    assert scenario.name == name
    assert scenario.drive.passes == len(scenario.drive.lanes_m) == 3
    assert scenario.lidar.true_rpy_deg == scenario.lidar.rpy_deg
    assert scenario.gnss.rtk.bias_h_m == 0.0
    assert scenario_from(as_toml(scenario), "again") == scenario


def test_demo_scenario__is_three_passes() -> None:
    assert demo_scenario().drive.passes == 3


def test_road_scenario__is_asphalt_that_the_tool_leaves_as_it_was() -> None:
    road = demo_scenario("road")
    assert (road.soil.kind, road.soil.worked, road.drive.passes) == ("asphalt", "same", 1)
    assert road.soil.swell_m == road.soil.ridge_m == road.implement.jitter_m == 0.0


@pytest.mark.parametrize("kind", SOILS)
def test_soil__kind_sets_what_is_not_stated(kind: str) -> None:
    scenario = scenario_from(f'[soil]\nkind = "{kind}"\nrow_spacing_m = 0.5\n', "s.toml")
    assert scenario.soil.clod_sigma_m == SOILS[kind]["sigma"]
    assert scenario.soil.clod_corr_m == SOILS[kind]["corr"]
    assert scenario.soil.row_spacing_m == 0.5


def test_soil__is_rougher_the_deeper_it_was_worked() -> None:
    rough = {kind: ScenarioSoil(kind=kind).clod_sigma_m for kind in ("rolled", "stubble", "tilled", "ploughed")}
    assert list(rough.values()) == sorted(rough.values())


def test_implement__leaves_what_it_usually_leaves() -> None:
    assert Scenario(implement=ScenarioImplement(shape="plow")).soil.tilled_sigma_m == SOILS["ploughed"]["sigma"]
    assert Scenario(implement=ScenarioImplement(shape="plow")).soil.furrow_m > 0.0
    assert Scenario(implement=ScenarioImplement(shape="mower")).soil.worked == "same"


def test_implement__body_is_as_wide_as_it_works() -> None:
    widest = max(box[3] for box in ScenarioImplement(width_m=3.4).boxes_m)
    assert widest == pytest.approx(2.0 * max(box[3] for box in ScenarioImplement(width_m=1.7).boxes_m))


def test_scenario__without_any_key_is_complete_but_for_the_ground() -> None:
    stated = {line.split(" = ")[0] for line in as_toml(Scenario()).splitlines()}
    assert {"size_e_m", "size_n_m", "boundary_uv_m", "start_xy_m"}.isdisjoint(stated)
    assert {"seed", "swell_m", "true_rpy_deg", "white_m", "clod_sigma_m"} <= stated


def test_lidar__true_mounting_may_differ() -> None:
    lidar = ScenarioLidar(rpy_deg=(0.0, 40.0, 180.0), true_rpy_deg=(0.3, 40.5, 179.0))
    assert lidar.true_rpy_deg == (0.3, 40.5, 179.0)
    assert lidar.true_xyz_m == lidar.xyz_m


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[soil]\nslope_percnt = 1.0", "soil.slope_percnt"),
        ("[gnss.clas]\nwhite = 1.0", "gnss.clas.white"),
        ("sed = 3", "sed"),
    ],
)
def test_load_scenario__unknown_key_names_the_nearest(text: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        scenario_from(text, "s.toml")
    assert error.value.what == f"s.toml: unknown key `{words}`."
    assert "Did you mean" in error.value.remedy


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[soil]\nkind = 'wet'", "[soil.kind]"),
        ("[soil]\nswell_m = 'high'", "[soil.swell_m]"),
        ("[drive]\npasses = 3\npass_m = [5.0, 6.0]", "2 entries for 3 passes"),
        ("[drive]\npasses = 18446744073709551616", "[drive.passes]"),
        ("[drive]\nstops = [[4, 1.0, 2.0]]", "on none of the 3 passes"),
        ("[implement]\nlift_m = 0.1", "never leave the ground"),
        ("[lidar]\nrpm = 700", "[lidar.rpm]"),
        ("t0 = '2026-06-11T01:23:40'", "no UTC offset"),
        ("t0 = 'soon'", "soon"),
        ("[soil", "TOML"),
    ],
)
def test_load_scenario__refuses_what_cannot_be(text: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        scenario_from(text, "s.toml")
    assert error.value.what.startswith("s.toml: ")
    assert words in error.value.what
    assert all(error.value.lines)


def test_load_scenario__missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_scenario(tmp_path / "nothing.toml")


def test_as_toml__is_loaded_as_the_same_scenario() -> None:
    scenario = scenario_from(
        'title = "圃場 \\"3\\""\n[lidar]\nrpm_wander = 1e-5\n[drive]\nstops = [[0, 1.0, 2.0]]', "s"
    )
    again = scenario_from(as_toml(scenario), "again")
    assert again.title == '圃場 "3"'
    assert again.lidar == scenario.lidar
    assert again.drive.stops == ((0, 1.0, 2.0),)
    assert math.isnan(again.field.size_e_m)


def test_scenario__an_earlier_drive_says_where_it_began() -> None:
    with pytest.raises(InputError, match=r"drive\.start_xy_m"):
        scenario_from("[[earlier]]\nseed = 2\n", "s")


@pytest.mark.parametrize(
    ("shape", "length_m", "width_m", "height_m"),
    [("tiller", 1.12, 1.74, 1.06), ("mower", 1.2, 1.7, 0.52), ("plow", 1.6, 1.3, 1.05), ("roller", 0.55, 1.7, 0.85)],
)
def test_implements__have_the_extent_of_machines(shape: str, length_m: float, width_m: float, height_m: float) -> None:
    boxes = np.array(TOOL_BOXES[shape]).reshape(-1, 3, 2)
    assert (boxes[..., 0] < boxes[..., 1]).all()
    extent = boxes[..., 1].max(axis=0) - boxes[..., 0].min(axis=0)
    assert extent == pytest.approx([length_m, width_m, height_m])
