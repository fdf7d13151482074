"""The VLP-16: geometry and timing (VLP-16 User Manual 63-9243 Rev. E, chapter 9 and appendix)."""

from __future__ import annotations

from typing import Final

import numpy as np

VLP16_LASERS: Final = 16
ELEVATION_DEG: Final = np.array(
    [-15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0]
)
"""Of the lasers in the order in which they fire and stand in a packet."""
VERTICAL_OFFSET_M: Final = 1e-3 * np.array(
    [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2]
)
"""Height of each beam's origin on the axis above the sensor's origin."""
LASER_S: Final = 2.304e-6
"""From one laser to the next."""
FIRING_S: Final = 55.296e-6
"""From one firing of all lasers to the next."""
BLOCKS_PER_PACKET: Final = 12
"""Blocks in a packet, each of two firings of all lasers."""
RANGE_STEP_M: Final = 0.002
AZIMUTH_STEP_DEG: Final = 0.01
RETURN_MODE: Final = {"strongest": 0x37, "last": 0x38, "dual": 0x39}
PRODUCT_ID: Final = 0x22
DATA_PORT: Final = 2368
POSITION_PORT: Final = 8308
