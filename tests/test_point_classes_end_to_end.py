"""The classes of a run's points against what the simulated beams met."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

import furrowmap
from furrowmap.core.simulator import recording
from furrowmap.core.simulator.rays import Met
from furrowmap.core.simulator.scenario import Scenario, ScenarioDrive, ScenarioField, ScenarioImplement
from furrowmap.core.simulator.simulate import simulate
from furrowmap.core.values.scan import PointClass

SCENARIO = Scenario(
    name="classes",
    title="One pass past a hut and a post",
    seed=11,
    walls=((16.0, 17.0, 20.0, 5.0, 3.0, 2.5, 5),),
    posts=((9.0, 5.5, 0.15, 2.0),),
    field=ScenarioField(size_e_m=34.0, size_n_m=24.0),
    drive=ScenarioDrive(passes=1, pass_m=(6.0,), start_xy_m=(8.0, 10.0), lead_in_m=2.5, run_out_m=2.0),
    implement=ScenarioImplement(shape="plow"),
)


@dataclass(frozen=True)
class Classified:
    """A cloud in the order of time.

    Attributes:
        classes: (n,) of its points.
        met: (n,) what the beams met.
        report: of the run.
    """

    classes: NDArray[np.uint8]
    met: NDArray[np.uint8]
    report: dict[str, Any]

    def share(self, met: Met, *classes: PointClass) -> float:
        """Of the returns from something, those that have one of the classes."""
        return float(np.isin(self.classes[self.met == met], classes).mean())


@pytest.fixture(scope="module")
def classified(tmp_path_factory: pytest.TempPathFactory) -> Classified:
    """A pass with a plough, placed by its true trajectory."""
    folder: Path = tmp_path_factory.mktemp("classes")
    noted: list[tuple[int, NDArray[np.uint8]]] = []
    cast = recording.cast

    def listening(*asked: Any) -> Any:
        returns = cast(*asked)
        noted.append((asked[2].number, returns.met[0][returns.met[0] > 0]))
        return returns

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "cast", listening)
        simulate(SCENARIO, folder / "drive")
    met = np.concatenate([part for _, part in sorted(noted, key=lambda of: of[0])])
    session = folder / "drive" / "session.toml"
    session.write_text(session.read_text() + '\n[trajectory]\nfiles = ["truth/trajectory.csv"]\n')
    report = furrowmap.run(session, folder / "result").report
    cloud = laspy.read(folder / "result" / "cloud.copc.laz")
    order = np.argsort(np.asarray(cloud.gps_time), kind="stable")
    return Classified(np.asarray(cloud.classification)[order], met, report)


def test_classes__the_machine_is_told_from_the_land(classified: Classified) -> None:
    assert len(classified.classes) == len(classified.met)
    assert classified.share(Met.BODY, PointClass.VEHICLE) > 0.99
    assert classified.share(Met.IMPLEMENT, PointClass.IMPLEMENT) > 0.97
    # A plough is open: between its bodies there is soil.
    most = {Met.SOIL: 0.004, Met.TILLED: 0.03, Met.STRAW: 0.002, Met.OBJECT: 0.0}
    for met, share in most.items():
        assert classified.share(met, PointClass.VEHICLE, PointClass.IMPLEMENT) <= share, met.name


def test_classes__soil_is_ground_and_what_stands_is_not(classified: Classified) -> None:
    for met in (Met.SOIL, Met.TILLED):
        assert classified.share(met, PointClass.GROUND) > 0.98, met.name
        assert classified.share(met, PointClass.NOISE) < 0.01, met.name
    # The foot of a wall is as near the ground as a clod.
    assert classified.share(Met.OBJECT, PointClass.OTHER) > 0.85
    assert classified.share(Met.DUST, PointClass.GROUND) < 0.2


def test_classes__are_counted_in_the_report(classified: Classified) -> None:
    counts = classified.report["figures"]["points_by_class"]
    for kind in PointClass:
        assert counts[kind.name.lower()] == np.count_nonzero(classified.classes == kind)
    assert sum(counts.values()) == len(classified.classes)
