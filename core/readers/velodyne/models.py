"""Velodyne's sensors: angles, heights and firing times of their lasers, and their product bytes.

Sources: VLP-16 User Manual 63-9243 Rev. E (packets: section 9.3, timing: 9.4, angles and vertical corrections: table
9-1), VLP-32C User Manual 63-9325 Rev. C (the same sections), HDL-32E application note 63-9277 Rev. D (packet structure
and timing). A test compares them with velodyne-decoder 3.1, which is the source of the heights of VLP-32C and HDL-32E.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError

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

    @cached_property
    def laser_table(self) -> FloatArray:
        """(n, 5) firing time, azimuth (rad), cosine and sine of the elevation, and height of each laser."""
        elevation, azimuth = np.radians(self.elevation_deg), np.radians(self.azimuth_deg)
        columns = [self.laser_s, azimuth, np.cos(elevation), np.sin(elevation), self.height_m]
        return np.ascontiguousarray(np.stack(columns, axis=1))

    @cached_property
    def laser_order(self) -> NDArray[np.uint8]:
        """(n,) rank of each laser by elevation."""
        order = np.empty(self.lasers, np.uint8)
        order[np.argsort(self.elevation_deg, kind="stable")] = np.arange(self.lasers, dtype=np.uint8)
        return order

    def packet_s(self, mode: int) -> float:
        """Time from one packet to the next in a return mode."""
        return 12 * (32 // self.lasers) * self.cycle_s / (2 if mode == DUAL else 1)


def _alternate(low_deg: tuple[float, ...], high_deg: tuple[float, ...]) -> FloatArray:
    """Two fans of lasers that fire alternately."""
    return np.stack([low_deg, high_deg], axis=1).reshape(-1)


_HI_RES_LOW_DEG: Final = (-10, -8.667, -7.333, -6, -4.667, -3.333, -2, -0.667)
_HI_RES_HIGH_DEG: Final = (0.667, 2, 3.333, 4.667, 6, 7.333, 8.667, 10)
_HI_RES_HEIGHT_MM: Final = (7.4, 6.5, 5.5, 4.6, 3.7, 2.7, 1.8, 0.9), (-0.9, -1.8, -2.7, -3.7, -4.6, -5.5, -6.5, -7.4)
_VLP16_DEG: Final = _alternate((-15, -13, -11, -9, -7, -5, -3, -1), (1, 3, 5, 7, 9, 11, 13, 15))
_VLP32C_DEG: Final = np.array(
    (-25, -1, -1.667, -15.639, -11.31, 0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4,
     -4.667, 1.667, 1, -3.667, -3.333, 3.333, 2.333, -2.667, -3, 7, 4.667, -2.333, -2, 15, 10.333, -1.333)
)  # fmt: skip
_VLP32C_AZIMUTH_DEG: Final = np.array(
    (1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
     1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4)
)  # fmt: skip
_HDL32E_DEG: Final = _alternate(
    (-30.67, -29.33, -28, -26.67, -25.33, -24, -22.67, -21.33, -20, -18.67, -17.33, -16, -14.67, -13.33, -12, -10.67),
    (-9.33, -8, -6.67, -5.33, -4, -2.67, -1.33, 0, 1.33, 2.67, 4, 5.33, 6.67, 8, 9.33, 10.67),
)
_PUCK_TIMES_S: Final = np.arange(16, dtype=np.float64) * 2.304e-6


def _beam_height_m(axis_m: float, elevation_deg: FloatArray) -> FloatArray:
    """Heights of the origins of beams that meet the vertical axis from an optical centre beside it."""
    return -axis_m * np.tan(np.radians(elevation_deg))


MODELS: Final = (
    Model(
        "VLP-16",
        0x22,
        0.002,
        55.296e-6,
        _PUCK_TIMES_S,
        _VLP16_DEG,
        np.zeros(16),
        _beam_height_m(41.91e-3, _VLP16_DEG),
    ),
    Model(
        "Puck Hi-Res",
        0x24,
        0.002,
        55.296e-6,
        _PUCK_TIMES_S,
        _alternate(_HI_RES_LOW_DEG, _HI_RES_HIGH_DEG),
        np.zeros(16),
        _alternate(*_HI_RES_HEIGHT_MM) * 1e-3,
    ),
    Model(
        "VLP-32C",
        0x28,
        0.004,
        55.296e-6,
        np.repeat(_PUCK_TIMES_S, 2),
        _VLP32C_DEG,
        _VLP32C_AZIMUTH_DEG,
        _beam_height_m(42.4e-3, _VLP32C_DEG),
    ),
    Model(
        "HDL-32E",
        0x21,
        0.002,
        46.08e-6,
        np.arange(32, dtype=np.float64) * 1.152e-6,
        _HDL32E_DEG,
        np.zeros(32),
        _beam_height_m(28.96e-3, _HDL32E_DEG),
    ),
)

_OTHER_NAMES: Final = {
    "Puck": "VLP-16",
    "Puck LITE": "VLP-16",
    "Ultra Puck": "VLP-32C",
    "VLP-16 Hi-Res": "Puck Hi-Res",
}
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
    by_name.update({_plain(alias): by_name[_plain(to)] for alias, to in _OTHER_NAMES.items()})
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

    Raises:
        InputError: if it is not supported.
    """
    for model in MODELS:
        if model.product == product:
            return model
    stated = {"where": where or None, "product": product, "models": ", ".join(model.name for model in MODELS)}
    if product in OTHER_PRODUCTS:
        raise InputError("unsupported-model", other_products=OTHER_PRODUCTS[product], **stated)
    raise InputError("model-unknown", **stated)


def _plain(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum()).removeprefix("velodyne")
