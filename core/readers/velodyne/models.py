"""Velodyne's sensors: angles, heights and firing times of their lasers, and their product bytes.

Sources: VLP-16 User Manual 63-9243 Rev. E (packets: section 9.3, timing: 9.4, angles and vertical corrections: table
9-1), VLP-32C User Manual 63-9325 Rev. C (the same sections), HDL-32E application note 63-9277 Rev. D (packet structure
and timing). A test compares them with velodyne-decoder 3.1, which is the source of the heights of VLP-32C and HDL-32E.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import InputError

FloatArray = NDArray[np.float64]

PACKET_BYTES: Final = 1206
"""Length of a data packet's payload: 12 blocks of 100 bytes, the stamp, and two factory bytes."""
BLOCK_MARK: Final = b"\xff\xee"
"""First bytes of each block of a data packet."""

STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39
RETURN_WORDS: Final = {STRONGEST: "strongest", LAST: "last", DUAL: "dual"}


@dataclass(frozen=True)
class Model:
    """A sensor's geometry and timing.

    Attributes:
        name: the manufacturer's name.
        product: product byte of its packets (VLP-16 manual, table 9-2).
        resolution_m: distance per count.
        cycle_s: time between the firing sequences, in which all lasers fire once.
        laser_s: (n,) firing time of each laser in the sequence, in the order of the packet.
        elevation_deg: (n,) of each laser, in the same order.
        azimuth_deg: (n,) azimuth of each laser relative to that of the block.
        height_m: (n,) height of each beam's origin on the vertical axis above the sensor's origin.
    """

    name: str
    product: int
    resolution_m: float
    cycle_s: float
    laser_s: FloatArray
    elevation_deg: FloatArray
    azimuth_deg: FloatArray
    height_m: FloatArray

    @property
    def lasers(self) -> int:
        """Number of lasers."""
        return len(self.elevation_deg)

    def packet_s(self, mode: int) -> float:
        """Time from one packet to the next in a return mode."""
        return 12 * (32 // self.lasers) * self.cycle_s / (2 if mode == DUAL else 1)


def _down_up(low_deg: tuple[float, ...], high_deg: tuple[float, ...]) -> FloatArray:
    """Two fans of lasers that fire alternately."""
    return np.stack([low_deg, high_deg], axis=1).reshape(-1)


def _times(firings: int, apart_s: float) -> FloatArray:
    return np.arange(firings, dtype=np.float64) * apart_s


def _vlp16() -> Model:
    elevation_deg = _down_up((-15, -13, -11, -9, -7, -5, -3, -1), (1, 3, 5, 7, 9, 11, 13, 15))
    return Model(
        "VLP-16",
        0x22,
        0.002,
        55.296e-6,
        _times(16, 2.304e-6),
        elevation_deg,
        np.zeros(16),
        -41.91e-3 * np.tan(np.radians(elevation_deg)),
    )


def _puck_hi_res() -> Model:
    elevation_deg = _down_up(
        (-10, -8.667, -7.333, -6, -4.667, -3.333, -2, -0.667), (0.667, 2, 3.333, 4.667, 6, 7.333, 8.667, 10)
    )
    height_mm = _down_up((7.4, 6.5, 5.5, 4.6, 3.7, 2.7, 1.8, 0.9), (-0.9, -1.8, -2.7, -3.7, -4.6, -5.5, -6.5, -7.4))
    return Model(
        "Puck Hi-Res",
        0x24,
        0.002,
        55.296e-6,
        _times(16, 2.304e-6),
        elevation_deg,
        np.zeros(16),
        height_mm * 1e-3,
    )


def _vlp32c() -> Model:
    elevation_deg = np.array(
        (-25, -1, -1.667, -15.639, -11.31, 0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4,
         -4.667, 1.667, 1, -3.667, -3.333, 3.333, 2.333, -2.667, -3, 7, 4.667, -2.333, -2, 15, 10.333, -1.333)
    )  # fmt: skip
    azimuth_deg = np.array(
        (1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
         1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4)
    )  # fmt: skip
    return Model(
        "VLP-32C",
        0x28,
        0.004,
        55.296e-6,
        np.repeat(_times(16, 2.304e-6), 2),
        elevation_deg,
        azimuth_deg,
        -42.4e-3 * np.tan(np.radians(elevation_deg)),
    )


def _hdl32e() -> Model:
    low_deg = (-30.67, -29.33, -28, -26.67, -25.33, -24, -22.67, -21.33, -20, -18.67, -17.33, -16, -14.67, -13.33, -12,
               -10.67)  # fmt: skip
    high_deg = (-9.33, -8, -6.67, -5.33, -4, -2.67, -1.33, 0, 1.33, 2.67, 4, 5.33, 6.67, 8, 9.33, 10.67)
    elevation_deg = _down_up(low_deg, high_deg)
    return Model(
        "HDL-32E",
        0x21,
        0.002,
        46.08e-6,
        _times(32, 1.152e-6),
        elevation_deg,
        np.zeros(32),
        -28.96e-3 * np.tan(np.radians(elevation_deg)),
    )


MODELS: Final = (_vlp16(), _puck_hi_res(), _vlp32c(), _hdl32e())

_ALIASES: Final = {"Puck": "VLP-16", "Puck LITE": "VLP-16", "Ultra Puck": "VLP-32C", "VLP-16 Hi-Res": "Puck Hi-Res"}
OTHER_PRODUCTS: Final = {
    0x23: "VLP-32A or VLP-32B",
    0x31: "Velarray",
    0x63: "VLS-128 (Alpha Prime)",
    0xA1: "VLS-128 (Alpha Prime)",
}


def model_named(name: str) -> Model:
    """The model with this name, ignoring case and punctuation.

    Raises:
        InputError: if it is not supported.
    """
    by_name = {_plain(model.name): model for model in MODELS}
    by_name.update({_plain(alias): by_name[_plain(to)] for alias, to in _ALIASES.items()})
    found = by_name.get(_plain(name))
    if found is None:
        near = difflib.get_close_matches(_plain(name), by_name, 1)
        raise InputError(
            "unknown-model",
            name=name,
            models=", ".join(model.name for model in MODELS),
            by_name=by_name[near[0]].name if near else None,
        )
    return found


def model_of(product: int, where: str = "") -> Model:
    """The model with this product byte.

    Args:
        product: the byte.
        where: the location that an error names.

    Raises:
        InputError: if it is not supported.
    """
    for model in MODELS:
        if model.product == product:
            return model
    if product in OTHER_PRODUCTS:
        raise InputError(
            "unsupported-model",
            where=where or None,
            other_products=OTHER_PRODUCTS[product],
            product=product,
            models=", ".join(model.name for model in MODELS),
        )
    raise InputError(
        "model-unknown", where=where or None, product=product, models=", ".join(model.name for model in MODELS)
    )


def _plain(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum()).removeprefix("velodyne")
