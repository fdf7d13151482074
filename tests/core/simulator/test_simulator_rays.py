"""Beams against closed form: planes, boxes, walls, posts, noise and chance."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.simulator.machine_motion import mount_rotation
from furrowmap.core.simulator.rays import Firings, Met, Returns, Scene, cast, make_optics, make_scene
from furrowmap.core.simulator.recording import ELEVATION_DEG, VERTICAL_OFFSET_M, VLP16
from furrowmap.core.simulator.scenario import (
    Noise,
    Scenario,
    ScenarioDrive,
    ScenarioField,
    ScenarioImplement,
    ScenarioLidar,
    ScenarioSoil,
    Tractor,
)
from furrowmap.core.simulator.soil_over_time import ToolSweep, make_ground

FLAT = ScenarioSoil(
    slope_percent=0.0, undulation_m=0.0, clod_sigma_m=0.0, row_amplitude_m=0.0, straw_share=0.0, tilled_sigma_m=0.0
)
EXACT = Noise(range_m=0.0, dropout=0.0, dust=0.0)
HIDDEN = (-9.0, -8.9, -0.01, 0.01, -9.0, -8.9)
"""A box under the ground: an empty list would stand for the usual one."""
BARE = Scenario(
    field=ScenarioField(size_e_m=20.0, size_n_m=20.0),
    drive=ScenarioDrive(start_xy_m=(5.0, 5.0)),
    soil=FLAT,
    noise=EXACT,
    tractor=Tractor(body_boxes_m=()),
    implement=ScenarioImplement(boxes_m=(HIDDEN,)),
    lidar=ScenarioLidar(xyz_m=(0.0, 0.0, 2.0), rpy_deg=(0.0, 0.0, 0.0), laser_bias_m=0.0, max_range_m=60.0),
)


def scene_of(scenario: Scenario, sweeps: list[ToolSweep] | None = None) -> Scene:
    return make_scene(scenario, make_ground(scenario, sweeps or []))


def fired(scenario: Scenario, n: int = 720, scene: Scene | None = None, **changes: Any) -> Returns:
    """One turn of `n` firings from the middle of the ground."""
    return cast(
        scene or scene_of(scenario),
        make_optics(scenario, VLP16.beams, mount_rotation(scenario.lidar.rpy_deg)),
        turn(n, **changes),
    )


def turn(n: int, **changes: Any) -> Firings:
    still: dict[str, Any] = {
        "number": 0,
        "t_s": np.zeros(n),
        "azimuth_rad": np.arange(n) * (2.0 * np.pi / n),
        "turn_radps": np.zeros(n),
        "xyz_m": np.tile([10.0, 10.0, 0.0], (n, 1)),
        "rotation": np.tile(np.eye(3), (n, 1, 1)),
        "tool_m": np.zeros(n),
        "dusty": np.zeros(n),
    }
    return Firings(**(still | changes))


def points(returns: Returns, n: int, height_m: float = 2.0) -> NDArray[np.float64]:
    """(n, 16, 3) from the formulas of the manual, the sensor upright at (10, 10, height_m)."""
    r = returns.ticks[0] * 0.002
    azimuth, elevation = np.arange(n)[:, None] * (2.0 * np.pi / n), np.radians(ELEVATION_DEG)
    across = r * np.cos(elevation)
    up = r * np.sin(elevation) + VERTICAL_OFFSET_M
    return np.stack([10.0 + across * np.cos(azimuth), 10.0 - across * np.sin(azimuth), height_m + up], axis=-1)


def test_cast__level_ground_is_a_cone_a_laser() -> None:
    returns = fired(BARE)
    down = ELEVATION_DEG < 0
    expected = (2.0 + VERTICAL_OFFSET_M[down]) / np.sin(np.radians(-ELEVATION_DEG[down]))
    reached = expected < 60.0
    stated = returns.ticks[0][:, down] * 0.002
    assert np.abs(stated[:, reached] - expected[reached]).max() < 0.0011
    assert (stated[:, ~reached] == 0).all()
    assert (returns.ticks[0][:, ~down] == 0).all()
    assert (returns.met[0][:, down][:, reached] == Met.SOIL).all()


def test_cast__rough_sloping_ground_is_met_on_its_surface() -> None:
    scenario = msgspec.structs.replace(BARE, soil=ScenarioSoil(kind="ploughed", slope_percent=5.0, straw_share=0.0))
    scene = scene_of(scenario)
    at = points(fired(scenario, scene=scene), 720)
    met = fired(scenario, scene=scene).met[0] == Met.SOIL
    from furrowmap.core.simulator.soil_over_time import ground_height

    e, n, z = at[met].T
    below = z - ground_height(scene.ground, e, n, np.zeros(len(e)))
    assert met.sum() > 3000
    near = np.hypot(e - 10.0, n - 10.0) < 10.0
    assert np.abs(below[near]).max() < 0.002
    assert np.abs(below).max() < 0.01  # 2 mm of range, far away on a slope of clods


def test_cast__ground_is_of_the_moment_of_the_firing() -> None:
    way = np.arange(0.0, 8.0, 0.01)
    sweep = ToolSweep(100.0 + way, 8.0 + way, np.full(len(way), 2.0), np.zeros(len(way)), 100.0, 108.0)
    scenario = msgspec.structs.replace(BARE, soil=msgspec.structs.replace(FLAT, swell_m=0.2, ridge_m=0.0))
    scene = scene_of(scenario, [sweep])
    early = fired(scenario, scene=scene, t_s=np.full(720, 99.0))
    late = fired(scenario, scene=scene, t_s=np.full(720, 109.0))
    assert (early.met[0] != Met.TILLED).all()
    tilled = late.met[0] == Met.TILLED
    assert tilled.sum() > 100
    heights = points(late, 720)[..., 2][tilled]
    assert np.median(heights) == pytest.approx(0.2, abs=0.002)
    rows, cols = np.divmod(late.cell[0][tilled], scene.ground.before.shape[1])
    assert np.isfinite(scene.ground.first_s[rows, cols]).all()


def test_cast__wall_and_post_are_where_they_stand() -> None:
    wall, post = (13.0, 10.0, 90.0, 4.0, 0.2, 3.0, 5.0), (10.0, 7.0, 0.2, 3.0)
    scenario = msgspec.structs.replace(BARE, walls=(wall,), posts=(post,))
    returns = fired(scenario, 7200)
    at = points(returns, 7200)[returns.met[0] == Met.OBJECT]
    on_post = at[at[:, 1] < 7.5]
    on_wall = at[at[:, 0] > 12.0]
    assert len(on_post) + len(on_wall) == len(at)
    assert np.abs(np.hypot(on_post[:, 0] - 10.0, on_post[:, 1] - 7.0) - 0.2).max() < 0.002
    assert np.abs(on_wall[:, 0] - 12.9).max() < 0.002
    assert (on_wall[:, 1].min(), on_wall[:, 1].max()) == (pytest.approx(8.0, abs=0.01), pytest.approx(12.0, abs=0.01))
    assert len(on_post) > 500
    bright = returns.reflectivity[0][returns.met[0] == Met.OBJECT]
    assert abs(np.median(bright[at[:, 0] > 12.0]) - 65) <= 1


def test_cast__body_and_lifted_tool_stand_in_the_vehicle_frame() -> None:
    box = (-0.2, 0.2, -1.0, 1.0, 1.5, 1.9)
    scenario = msgspec.structs.replace(
        BARE,
        implement=ScenarioImplement(xy_m=(3.0, 0.0), boxes_m=(box,)),
        tractor=Tractor(body_boxes_m=((-3.0, -2.5, -1, 1, 1, 1.5),)),
    )
    scene = scene_of(scenario)
    for lift in (0.0, 0.45):
        returns = fired(scenario, 3600, scene, tool_m=np.full(3600, lift))
        at = points(returns, 3600)
        tool = at[returns.met[0] == Met.IMPLEMENT]
        assert len(tool) > 100
        assert tool[:, 0].min() == pytest.approx(12.8, abs=0.002)
        assert tool[:, 2].min() > 1.5 + lift - 0.002
        assert tool[:, 2].max() < 1.9 + lift + 0.002
        body = at[returns.met[0] == Met.BODY]
        assert body[:, 0].max() == pytest.approx(7.5, abs=0.002)


def test_cast__range_noise_is_as_stated_and_grows_at_grazing_angles() -> None:
    down = ELEVATION_DEG < -2
    exact = fired(BARE, 3600).ticks[0][:, down] * 0.002
    spread = {}
    for power in (0.0, 0.5):
        scenario = msgspec.structs.replace(BARE, noise=Noise(range_m=0.01, grazing=power, dropout=0.0, dust=0.0))
        spread[power] = (fired(scenario, 3600).ticks[0][:, down] * 0.002 - exact).std(axis=0)
    assert spread[0.0] == pytest.approx(0.01, rel=0.06)
    grown = np.sin(np.radians(-ELEVATION_DEG[down])) ** -0.5
    assert spread[0.5] == pytest.approx(0.01 * grown, rel=0.06)


def test_cast__loses_a_share_of_the_pulses_and_more_far_away() -> None:
    scenario = msgspec.structs.replace(BARE, noise=Noise(range_m=0.0, dropout=0.05, dust=0.0))
    returns = fired(scenario, 7200)
    lost = 1.0 - (returns.ticks[0] > 0).mean(axis=0)
    assert lost[ELEVATION_DEG == -15.0] == pytest.approx(0.05, abs=0.01)
    assert lost[ELEVATION_DEG == -3.0] > 0.8
    grazing = [float(lost[e == ELEVATION_DEG][0]) for e in (-15, -11, -7, -5)]
    assert grazing == sorted(grazing)


def test_cast__straw_stops_some_beams_above_the_soil() -> None:
    scenario = msgspec.structs.replace(BARE, soil=msgspec.structs.replace(FLAT, straw_share=0.05, straw_hit=0.5))
    returns = fired(scenario, 3600)
    heights = points(returns, 3600)[..., 2][returns.met[0] == Met.STRAW]
    assert 0.01 < len(heights) / (returns.met[0] > 0).sum() < 0.3
    assert heights.min() > -0.01
    assert heights.max() < 0.15


def test_cast__dust_hides_what_lies_behind_it_from_the_strongest_return() -> None:
    scenario = msgspec.structs.replace(
        BARE,
        noise=Noise(range_m=0.0, dropout=0.0, dust=0.3),
        implement=ScenarioImplement(xy_m=(3.0, 0.0), boxes_m=(HIDDEN,)),
    )
    clean = fired(scenario, 3600)
    assert (clean.met[0] != Met.DUST).all()
    dusty = fired(scenario, 3600, dusty=np.ones(3600))
    dust = dusty.met[0] == Met.DUST
    assert dust.sum() > 100
    assert (dusty.ticks[0] < clean.ticks[0])[dust & (clean.ticks[0] > 0)].all()
    # a second return only where a metre lies between
    two = dust & (dusty.met[1] == Met.SOIL)
    assert two.any()
    assert ((dusty.ticks[1].astype(int) - dusty.ticks[0])[two] * 0.002).min() > 0.99
    assert (dusty.ticks[1] == clean.ticks[1])[~dust | two].all()


def test_cast__chance_does_not_depend_on_the_batches() -> None:
    scenario = Scenario(field=ScenarioField(size_e_m=20.0, size_n_m=20.0), drive=ScenarioDrive(start_xy_m=(5.0, 5.0)))
    scene, optics = scene_of(scenario), make_optics(scenario, VLP16.beams, mount_rotation(scenario.lidar.rpy_deg))
    whole = cast(scene, optics, turn(400, dusty=np.ones(400)))
    half = {"t_s": np.zeros(200), "number": 200, "azimuth_rad": turn(400).azimuth_rad[200:], "dusty": np.ones(200)}
    second = cast(scene, optics, turn(200, **half))
    assert (second.ticks == whole.ticks[:, 200:]).all()
    assert (second.reflectivity == whole.reflectivity[:, 200:]).all()
    assert len(np.unique(whole.ticks[0])) > 1000
