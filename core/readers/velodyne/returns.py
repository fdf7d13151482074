"""The kernel that decodes Velodyne data packets into returns."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from furrowmap.core.readers.velodyne.models import DUAL, LAST, STRONGEST, Model
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.values.scan import Scan

ByteArray = NDArray[np.uint8]

MAX_AZIMUTH_STEP: Final = 120
"""Largest azimuth step from one block to the next (0.8 degrees at 1200 rpm)."""


_STARTED, _AZIMUTH, _TIME, _COLUMN, TURNED, TURNING, BAD_BLOCKS, CARRIED = range(8)
"""Indices into the state from batch to batch: the last firing and its column; hundredths of a degree turned within
packets, the duration of that in seconds, and blocks skipped because their mark is wrong, summed over all packets. The
last is its length."""


def decode_returns(
    data: ByteArray, offset: IntArray, t_s: FloatArray, model: Model, carried: FloatArray
) -> tuple[Scan, IntArray, NDArray[np.bool_]]:
    """The returns of data packets, and where one scan ends and the next begins.

    Args:
        data: (k,) the bytes of the packets.
        offset: (m,) where in `data` each packet begins.
        t_s: (m,) UTC of the first firing of each packet.
        carried: (:data:`CARRIED`,) state after the batch before, at first zeros; updated.

    Returns:
        All returns as one scan; (c,) index of the first return of each next scan; (c,) whether azimuth passed 0 there,
        else there was a pause.
    """
    slots = len(offset) * 384
    t_out = np.empty(slots)
    xyz = np.empty((slots, 3), np.float32)
    intensity = np.empty(slots, np.uint8)
    laser = np.empty(slots, np.uint8)
    column = np.empty(slots, np.uint16)
    return_number = np.empty(slots, np.uint8)
    returns = np.empty(slots, np.uint8)
    cut_at = np.empty(len(offset) * 24, np.int64)
    cut_by_wrap = np.empty(len(offset) * 24, np.bool_)
    # A read-only array is another type to numba: the kernel would be compiled a second time.
    n, cuts = _decode(
        np.require(data, requirements=["C", "W"]), np.ascontiguousarray(offset), np.ascontiguousarray(t_s),
        model.cycle_s, model.resolution_m, model.laser_table, model.laser_order, carried,
        t_out, xyz, intensity, laser, column, return_number, returns, cut_at, cut_by_wrap,
    )  # fmt: skip
    scan = Scan(0, t_out[:n], xyz[:n], intensity[:n], laser[:n], column[:n], return_number[:n], returns[:n])
    return scan, cut_at[:cuts], cut_by_wrap[:cuts]


@njit(cache=True, nogil=True)
def _decode(  # type: ignore[no-untyped-def]
    data, offset, t_s, cycle_s, resolution_m, lasers, order, state,
    t_out, xyz, intensity, laser, column, return_number, returns, cut_at, cut_by_wrap,
):  # fmt: skip
    """Returns of all packets in the order of firing; their number, and the number of scans that end among them.

    Azimuth is in hundredths of a degree. The azimuth of a firing is that of its block, extrapolated by the packet's
    mean turning rate (which averages the encoder's rounding over 11 blocks) to the firing time of each laser (VLP-16
    manual, section 9.5). A sensor that reports only a sector fills its packets across the gap: the blocks after the
    leap are later by the time that turning through the gap takes.
    """
    lasers_n = len(order)
    per_block = 32 // lasers_n
    to_rad = np.pi / 18_000.0
    cos_ahead = np.empty(lasers_n)
    sin_ahead = np.empty(lasers_n)
    n = 0
    cuts = 0
    for p in range(len(offset)):
        base = offset[p]
        mode = data[base + 1204]
        same = data[base + 2] == data[base + 102] and data[base + 3] == data[base + 103]
        dual = mode == DUAL or (mode != STRONGEST and mode != LAST and same)
        blocks = 6 if dual else 12
        size = 200 if dual else 100

        turned = np.int64(0)
        steps = 0
        before = (np.int64(data[base + 2]) | np.int64(data[base + 3]) << 8) % 36_000
        for b in range(1, blocks):
            block = (np.int64(data[base + b * size + 2]) | np.int64(data[base + b * size + 3]) << 8) % 36_000
            step = (block - before + 18_000) % 36_000 - 18_000
            if abs(step) <= MAX_AZIMUTH_STEP:
                turned += step
                steps += 1
            before = block
        rate = max(0.0, turned / (steps * per_block * cycle_s)) if steps else 0.0
        state[TURNED] += turned
        state[TURNING] += steps * per_block * cycle_s
        hidden = steps == blocks - 2  # one leap, between the edges of the sector that the sensor reports
        hidden_s = 0.0
        for i in range(lasers_n):
            ahead = lasers[i, 1] + rate * lasers[i, 0] * to_rad
            cos_ahead[i] = np.cos(ahead) * lasers[i, 2]
            sin_ahead[i] = np.sin(ahead) * lasers[i, 2]
        turn_s = 36_000.0 / rate if rate > 0.0 else 0.1
        before = (np.int64(data[base + 2]) | np.int64(data[base + 3]) << 8) % 36_000
        for b in range(blocks):
            at = base + b * size
            if data[at] != 0xFF or data[at + 1] != 0xEE:
                state[BAD_BLOCKS] += 12 - (2 * b if dual else b)
                break
            block = (np.int64(data[at + 2]) | np.int64(data[at + 3]) << 8) % 36_000
            leap = (block - before) % 36_000
            if hidden and MAX_AZIMUTH_STEP < leap < 36_000 - MAX_AZIMUTH_STEP and rate > 0.0:
                hidden_s = (np.round(leap / (rate * cycle_s)) - per_block) * cycle_s
            before = block
            for f in range(per_block):
                azimuth = block + rate * cycle_s * f
                if azimuth >= 36_000.0:
                    azimuth -= 36_000.0
                fired_s = t_s[p] + (b * per_block + f) * cycle_s + hidden_s
                gap_s = fired_s - state[_TIME]
                fallen = state[_AZIMUTH] - azimuth
                pause = gap_s >= turn_s or gap_s < -turn_s
                wrap = fallen > (18_000.0 if gap_s < 0.25 * turn_s else 50.0)
                if state[_STARTED] == 0.0:
                    state[_STARTED] = 1.0
                    state[_COLUMN] = 0.0
                elif pause or wrap or state[_COLUMN] >= 65_535.0:
                    cut_at[cuts] = n
                    cut_by_wrap[cuts] = wrap and not pause
                    cuts += 1
                    state[_COLUMN] = 0.0
                else:
                    state[_COLUMN] += 1.0
                state[_AZIMUTH] = azimuth
                state[_TIME] = fired_s
                cos_a = np.cos(azimuth * to_rad)
                sin_a = np.sin(azimuth * to_rad)
                col = np.uint16(state[_COLUMN])
                slot = at + 4 + f * lasers_n * 3
                for i in range(lasers_n):
                    near = np.int64(data[slot]) | np.int64(data[slot + 1]) << 8
                    bright = data[slot + 2]
                    far = np.int64(0)
                    bright_far = bright
                    if dual:
                        other = np.int64(data[slot + 100]) | np.int64(data[slot + 101]) << 8
                        bright_other = data[slot + 102]
                        if near == 0 or near == other:
                            near = other
                            bright = bright_other
                        elif other > near:
                            far = other
                            bright_far = bright_other
                        elif other != 0:
                            far = near
                            bright_far = bright
                            near = other
                            bright = bright_other
                    slot += 3
                    if near == 0:
                        continue
                    ux = cos_a * cos_ahead[i] - sin_a * sin_ahead[i]
                    uy = -(sin_a * cos_ahead[i] + cos_a * sin_ahead[i])
                    range_m = near * resolution_m
                    t_out[n] = fired_s + lasers[i, 0]
                    xyz[n, 0] = range_m * ux
                    xyz[n, 1] = range_m * uy
                    xyz[n, 2] = range_m * lasers[i, 3] + lasers[i, 4]
                    intensity[n] = bright
                    laser[n] = order[i]
                    column[n] = col
                    return_number[n] = 1
                    returns[n] = 1
                    n += 1
                    if far == 0:
                        continue
                    returns[n - 1] = 2
                    range_m = far * resolution_m
                    t_out[n] = t_out[n - 1]
                    xyz[n, 0] = range_m * ux
                    xyz[n, 1] = range_m * uy
                    xyz[n, 2] = range_m * lasers[i, 3] + lasers[i, 4]
                    intensity[n] = bright_far
                    laser[n] = order[i]
                    column[n] = col
                    return_number[n] = 2
                    returns[n] = 2
                    n += 1
    return n, cuts
