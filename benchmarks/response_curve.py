"""How often the logistic's stated 95 % intervals hold the truth: ``python benchmarks/response_curve.py``."""

from __future__ import annotations

import argparse
from typing import Final

import numpy as np

from furrowmap.core.crops.response import fit_logistic, p_of_no_response

TRUTH: Final = {"lower": 0.340, "rise": 0.240, "gradient": 0.028, "midpoint": 85.0}
"""Metres, metres, ha/kg, kg/ha: winter wheat after Christiansen et al. 2017."""
PLATEAU: Final = 85.0 + np.log(19.0) / 0.028
RATES: Final = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
SIGMA_M: Final = 0.015
BLOCK_SIGMA_M: Final = 0.01
DESIGNS: Final = {
    "4 blocks of 5 of 7 rates": (4, 5),
    "4 blocks of 7 rates": (4, 7),
    "4 blocks of 21, each rate three times": (4, 21),
}


def trial(rng: np.random.Generator, blocks: int, parcels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Doses, heights and blocks of one trial."""
    several = np.resize(RATES, max(parcels, len(RATES)))
    doses = np.concatenate([rng.permutation(several)[:parcels] for _ in range(blocks)])
    block = np.repeat(np.arange(blocks), parcels)
    offset = rng.normal(0.0, BLOCK_SIGMA_M, blocks)
    truth = TRUTH["lower"] + TRUTH["rise"] / (1.0 + np.exp(-TRUTH["gradient"] * (doses - TRUTH["midpoint"])))
    return doses, truth + (offset - offset.mean())[block] + rng.normal(0.0, SIGMA_M, len(doses)), block


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    names = (*TRUTH, "plateau")
    print(f"{given.trials} trials; intervals that hold the truth (and, of these, open ones)")
    print("| design |", " | ".join(names), "| band at 100 kg/ha |")
    for design, (blocks, parcels) in DESIGNS.items():
        rng = np.random.default_rng(given.seed)
        held, opened, band = dict.fromkeys(names, 0), dict.fromkeys(names, 0), 0
        for _ in range(given.trials):
            dose, height, block = trial(rng, blocks, parcels)
            curve = fit_logistic(dose, height, block)
            for name in names:
                found, truth = getattr(curve, name), TRUTH.get(name, PLATEAU)
                held[name] += found.holds(truth)
                opened[name] += not np.isfinite([found.low, found.high]).all()
            truth = TRUTH["lower"] + TRUTH["rise"] / (1.0 + np.exp(-TRUTH["gradient"] * (100.0 - TRUTH["midpoint"])))
            low, high = (np.interp(100.0, curve.dose, side) for side in (curve.band_low, curve.band_high))
            band += low <= truth <= high
        cells = [f"{held[name]} ({opened[name]})" for name in names]
        print(f"| {design} |", " | ".join(cells), f"| {band} |", flush=True)
    rng = np.random.default_rng(given.seed)
    wrong = 0
    for _ in range(given.trials // 4):
        dose, _, block = trial(rng, 4, 7)
        wrong += p_of_no_response(dose, rng.normal(0.45, SIGMA_M, len(dose)), block, trials=499) <= 0.05
    print(f"trials without an effect in which a curve was found: {wrong} of {given.trials // 4}")


if __name__ == "__main__":
    main()
