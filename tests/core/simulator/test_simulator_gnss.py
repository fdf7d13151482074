"""The receiver's sentences, read by pynmeagps, and its errors."""

from __future__ import annotations

import datetime as dt
import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pynmeagps import NMEAReader
from pyproj import Proj, Transformer
from scipy.spatial.transform import Rotation

from furrowmap.core.simulator.machine_motion import SimulatedMotion
from furrowmap.core.simulator.noise import gauss_markov
from furrowmap.core.simulator.scenario import Receiver
from furrowmap.core.simulator.simulate import Simulated
from furrowmap.core.simulator.simulated_receiver import degrees_minutes, receive, sentence
from furrowmap.core.simulator.site import SimulatedSite


def parsed(file: Path) -> dict[str, list[Any]]:
    """Every message of a log by its kind; a wrong checksum would raise."""
    found: dict[str, list[Any]] = {}
    for _, message in NMEAReader(io.BytesIO(file.read_bytes()), quitonerror=2):
        found.setdefault(message.msgID, []).append(message)
    return found


def unix_s(messages: list[Any]) -> NDArray[np.float64]:
    """RMC messages' times."""
    stamps = [dt.datetime.combine(m.date, m.time, dt.UTC).timestamp() for m in messages]
    return np.array(stamps)


def true_antenna(simulated: Simulated, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """From the truth's files alone."""
    truth = pd.read_csv(simulated.folder / "truth" / "trajectory.csv")
    at = {name: np.interp(t_s, truth.time_unix_s, truth[name]) for name in truth.columns[1:]}
    turn = Rotation.from_euler(
        "ZYX", np.column_stack([90.0 - at["heading_deg"], -at["pitch_deg"], at["roll_deg"]]), degrees=True
    )
    lever = turn.apply(np.array(simulated.scenario.antenna.xyz_m))
    return np.column_stack([at["e_m"], at["n_m"], at["h_m"]]) + lever


def test_log__is_whole_and_crosses_midnight(short_drive: Simulated) -> None:
    log = parsed(short_drive.folder / "reference.nmea")
    assert set(log) == {"GGA", "RMC", "GST", "VTG"}
    assert len({len(messages) for messages in log.values()}) == 1
    t = unix_s(log["RMC"])
    assert t[0] == dt.datetime(2025, 12, 31, 23, 59, 56, 300_000, tzinfo=dt.UTC).timestamp()
    assert np.diff(t) == pytest.approx(0.1, abs=1e-6)
    assert log["RMC"][-1].date == dt.date(2026, 1, 1)


@pytest.mark.parametrize(("name", "bound_m"), [("gnss.nmea", 0.15), ("reference.nmea", 0.025)])
def test_log__tells_the_antenna(short_drive: Simulated, name: str, bound_m: float) -> None:
    log = parsed(short_drive.folder / name)
    e, n = Transformer.from_crs("EPSG:6668", "EPSG:6677", always_xy=True).transform(
        [m.lon for m in log["GGA"]], [m.lat for m in log["GGA"]]
    )
    h = np.array([m.alt + m.sep for m in log["GGA"]])
    error = np.column_stack([e, n, h]) - true_antenna(short_drive, unix_s(log["RMC"]))
    fixed = np.array([m.quality for m in log["GGA"]]) == 4
    assert np.abs(error[fixed]).max() < bound_m
    stated = short_drive.figures["gnss"][name]
    assert error.mean(axis=0) == pytest.approx(stated["mean_error_m"], abs=2e-3)
    assert stated["epochs"] == len(error)


def test_log__outage_and_float(short_drive: Simulated) -> None:
    log = parsed(short_drive.folder / "gnss.nmea")
    since = unix_s(log["RMC"]) - short_drive.figures["t0_unix_s"]
    assert np.diff(since).max() == pytest.approx(0.6, abs=1e-3)
    assert not ((since >= 3.0) & (since < 3.5)).any()
    quality = np.array([m.quality for m in log["GGA"]])
    assert (quality[(since >= 4.0) & (since < 4.6)] == 5).all()
    assert (quality[(since < 4.0) | (since >= 4.6)] == 4).all()
    sigma = np.array([m.stdLat for m in log["GST"]])
    assert sigma[quality == 5].min() > 0.1 > sigma[quality == 4].max()
    assert {m.posMode for m in log["RMC"]} == {"R", "F"}


def test_log__course_is_true_and_missing_at_a_stand(short_drive: Simulated) -> None:
    log = parsed(short_drive.folder / "reference.nmea")
    speed = np.array([m.spd for m in log["RMC"]]) * 1852.0 / 3600.0
    course = [m.cog for m in log["RMC"]]
    assert course[0] == ""
    driving = speed > 1.0
    true_of_grid = Proj("EPSG:6677").get_factors(140.02, 36.87).meridian_convergence
    # sway carries the antenna to the sides, but to both
    mean = np.mean([c for c, fast in zip(course, driving, strict=True) if fast])
    assert mean == pytest.approx(81.0 + true_of_grid, abs=1.5)
    assert speed.max() == pytest.approx(1.3, abs=0.2)


def still(seconds: float) -> tuple[SimulatedSite, SimulatedMotion]:
    t = np.arange(-0.5, seconds + 1.0, 0.5)
    z = np.zeros(len(t))
    site = SimulatedSite("EPSG:6677", 16642.0, 96548.0, 271.4, 41.3, 1_781_143_199_000_000)
    return site, SimulatedMotion(t, np.zeros((len(t), 3)), z, z, z, z, z)


def test_receive__errors_are_as_stated() -> None:
    site, motion = still(40_000.0)
    fixes = receive(
        Receiver(
            white_m=0.004, gm_m=0.01, tau_s=20.0, white_h_m=0.006, gm_h_m=0.03, tau_h_s=20.0, bias_h_m=0.0, rate_hz=1
        ),
        (0.0, 0.0, 0.0), site, motion, 40_000.0, 3, "x",
    )  # fmt: skip
    e, _, h = fixes.error_m.T
    assert e.std() == pytest.approx(np.hypot(0.004, 0.01), rel=0.05)
    assert h.std() == pytest.approx(np.hypot(0.006, 0.03), rel=0.05)
    lagged = np.mean(e[20:] * e[:-20])
    assert lagged == pytest.approx(0.01**2 * np.exp(-1.0), rel=0.2)


def test_gauss_markov__does_not_depend_on_the_rate() -> None:
    for step_s in (0.1, 1.0):
        noise = gauss_markov(np.random.default_rng(1), 200_000, step_s, 2.0, 10.0)
        lag = round(10.0 / step_s)
        assert noise.std() == pytest.approx(2.0, rel=0.1)
        assert np.mean(noise[lag:] * noise[:-lag]) == pytest.approx(4.0 * np.exp(-1.0), rel=0.2)


@given(st.floats(-180.0, 180.0, allow_nan=False), st.sampled_from([4, 8]))
def test_degrees_minutes__is_the_angle(degrees: float, decimals: int) -> None:
    text, letter = degrees_minutes(degrees, 3, decimals, "EW").split(",")
    minutes = float(text[3:])
    assert 0.0 <= minutes < 60.0
    assert len(text) == 3 + 3 + decimals
    value = (int(text[:3]) + minutes / 60.0) * (1 if letter == "E" else -1)
    assert value == pytest.approx(degrees, abs=0.6 * 10.0**-decimals / 60.0)


def test_sentence__has_the_checksum_of_the_standard() -> None:
    assert sentence("GPGLL,5057.970,N,00146.110,E,142451,A") == "$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n"
