"""How often intervals of optima hold the truth, and the right shape is chosen: `python benchmarks/response_curve.py`.

Trials of five curved shapes and of a straight line, in three designs; yields in t/ha, doses in kg/ha. A trial without
a response has no interval. A shape can be told where one has nine tenths of the weight.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np
from scipy import special

from furrowmap.core.crops.dose_response import fit_response
from furrowmap.core.crops.response_values import Estimate, ResponseQuestion

RATES: Final = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
RATIO: Final = 0.006
BLOCK_SIGMA: Final = 0.3
TOLD: Final = 0.9
SHAPES: Final[dict[str, Callable[[np.ndarray], np.ndarray]]] = {
    "quadratic": lambda x: 4.0 + 0.035 * x - 0.0000777 * x**2,
    "quadratic-plateau": lambda x: 4.0 + 4.0 * (1.0 - (1.0 - np.minimum(x / 190.0, 1.0)) ** 2),
    "linear-plateau": lambda x: 4.0 + 4.0 * np.minimum(x / 140.0, 1.0),
    "mitscherlich": lambda x: 4.0 + 4.2 * (1.0 - np.exp(-0.014 * x)),
    "logistic": lambda x: 3.6 + 4.4 * special.expit(0.035 * (x - 100.0)),
    "linear": lambda x: 4.0 + 0.0133 * x,
}
DESIGNS: Final = {
    "4 blocks of 7 rates, 0.3 t/ha": (4, 0.3),
    "3 blocks of 7 rates, 0.6 t/ha": (3, 0.6),
    "8 blocks of 7 rates, 0.15 t/ha": (8, 0.15),
}


def trial(rng: np.random.Generator, shape: str, blocks: int, sigma: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Doses, yields and blocks of one trial."""
    dose = np.tile(RATES, blocks)
    block = np.repeat(np.arange(blocks), len(RATES))
    offset = rng.normal(0.0, BLOCK_SIGMA, blocks)[block]
    return dose, SHAPES[shape](dose) + offset + rng.normal(0.0, sigma, len(dose)), [str(k) for k in block]


def true_optimum(shape: str) -> float:
    """The dose that pays, within those of the trial."""
    dose = np.linspace(RATES[0], RATES[-1], 30001)
    return float(dose[np.argmax(SHAPES[shape](dose) - RATIO * dose)])


def holds(found: Estimate, truth: float) -> bool:
    return found.low - 1e-6 <= truth <= found.high + 1e-6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000, help="of each shape and design")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--design", type=int, help="only this one, from 0")
    given = parser.parse_args()
    print(
        "| design | shape | optimum held by the average, by the chosen shape, by the true one | width | "
        "chosen right, where told (of trials) | outside | no response | chosen |"
    )
    for number, (design, (blocks, sigma)) in enumerate(DESIGNS.items()):
        if given.design not in (None, number):
            continue
        for shape in SHAPES:
            rng = np.random.default_rng(given.seed)
            truth = true_optimum(shape)
            held = Counter[str]()
            chosen = Counter[str]()
            told = Counter[bool]()
            widths = []
            for _ in range(given.trials):
                found = fit_response(*trial(rng, shape, blocks, sigma), ResponseQuestion(ratio=RATIO))
                if found.economic is None:
                    held["none"] += 1
                    continue
                first = found.models[0]
                true = next(each for each in found.models if each.name == shape)
                for name, one in (("average", found.economic), ("chosen", first.economic), ("true", true.economic)):
                    assert one is not None
                    held[name] += holds(one, truth)
                held["outside"] += found.economic.low < RATES[0] or found.economic.high > RATES[-1]
                widths.append(found.economic.high - found.economic.low)
                chosen[first.name] += 1
                if first.weight >= TOLD:
                    told[first.name == shape] += 1
            tried = max(given.trials - held["none"], 1)
            shares = ", ".join(f"{100 * held[name] / tried:.1f} %" for name in ("average", "chosen", "true"))
            right = (
                f"{100 * chosen[shape] / tried:.0f} %, {100 * told[True] / max(told.total(), 1):.0f} % ({told.total()})"
            )
            names = ", ".join(f"{name} {count}" for name, count in chosen.most_common())
            print(
                f"| {design} | {shape} | {shares} | {np.median(widths):.0f} | {right} | {held['outside']} | "
                f"{held['none']} | {names} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
