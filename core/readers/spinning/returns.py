"""The kernel that decodes data packets into returns."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.spinning.model import ByteArray, Model
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.scan import Scan

_FASTEST: Final = 1.5 * 720_000.0
"""Largest turning rate in hundredths of a degree per second: that of 1200 rpm, with a margin for lost blocks."""


_STARTED, _AZIMUTH, _TIME, _COLUMN, _RATE, TURNED, TURNING, BAD_BLOCKS, CARRIED = range(9)
"""Indices into the state from batch to batch: the last firing and its column; the turning rate; hundredths of a degree
turned within packets, the duration of that in seconds, and blocks skipped because their mark is wrong, summed over all
packets. The last is its length."""


def decode_returns(
    data: ByteArray, offset: IntArray, t_s: FloatArray, returns_of: ByteArray, model: Model, carried: FloatArray
) -> tuple[Scan, IntArray, NDArray[np.bool_]]:
    """The returns of data packets, and where one scan ends and the next begins.

    Args:
        data: (k,) the bytes of the packets.
        offset: (m,) where in `data` each packet begins.
        t_s: (m,) UTC of the stamp of each packet.
        returns_of: (m,) returns that firings of each packet have, 1 to 3.
        carried: (:data:`CARRIED`,) state after the batch before, at first zeros; updated.

    Returns:
        All returns as one scan; (c,) index of the first return of each next scan; (c,) whether azimuth passed 0 there,
        else there was a pause.
    """
    layout = model.layout
    slots = len(offset) * layout.blocks * layout.units
    t_out = np.empty(slots)
    xyz = np.empty((slots, 3), np.float32)
    intensity = np.empty(slots, np.uint8)
    laser = np.empty(slots, np.uint8)
    column = np.empty(slots, np.uint16)
    return_number = np.empty(slots, np.uint8)
    returns = np.empty(slots, np.uint8)
    firings = len(offset) * model.groups(1) * model.firings_per_block
    cut_at = np.empty(firings, np.int64)
    cut_by_wrap = np.empty(firings, np.bool_)
    shape = np.array((layout.header, layout.azimuth, layout.block, layout.unit, layout.blocks, layout.marked))
    # A read-only array is another type to numba: the kernel would be compiled a second time.
    n, cuts = _decode(
        np.require(data, requirements=["C", "W"]), np.ascontiguousarray(offset), np.ascontiguousarray(t_s), returns_of,
        shape, model.packet_table, model.firings_per_block, model.first_firing_s, model.cycle_s, model.resolution_m,
        model.laser_table, model.laser_order, carried,
        t_out, xyz, intensity, laser, column, return_number, returns, cut_at, cut_by_wrap,
    )  # fmt: skip
    every = Scan(0, t_out, xyz, intensity, laser, column, return_number, returns, lasers=model.lasers)
    return every[:n], cut_at[:cuts], cut_by_wrap[:cuts]


@kernel()
def _decode(  # type: ignore[no-untyped-def]
    data, offset, t_s, returns_of, shape, packet_table, per_block, first_firing_s, cycle_s, resolution_m, lasers, order,
    state, t_out, xyz, intensity, laser, column, return_number, returns, cut_at, cut_by_wrap,
):  # fmt: skip
    """Returns of all packets in the order of firing; their number, and the number of scans that end among them.

    Azimuth is in hundredths of a degree. The azimuth of a firing is that of its block, extrapolated by the packet's
    mean turning rate (which averages the encoder's rounding over the blocks) to the firing time of each laser (VLP-16
    manual, section 9.5; PandarXT manual, appendix on absolute times). A sensor that reports only a sector fills its
    packets across the gap: the blocks after the leap are later by the time that turning through the gap takes.
    """
    header, azimuth_at, block_bytes, unit, blocks_n, marked = shape
    lasers_n = len(order)
    group_s = per_block * cycle_s
    max_step = np.ceil(_FASTEST * group_s)
    to_rad = np.pi / 18_000.0
    least = lasers[0, 1]
    for i in range(lasers_n):
        least = min(least, lasers[i, 1])
    shift = np.empty(lasers_n, np.int64)
    cos_ahead = np.empty(lasers_n)
    sin_ahead = np.empty(lasers_n)
    counts = np.empty(3, np.int64)
    bright = np.empty(3, np.uint8)
    n = 0
    cuts = 0
    for p in range(len(offset)):
        base = offset[p] + header
        echoes = np.int64(returns_of[p])
        table = packet_table[echoes - 1]
        blocks = table[0]
        size = table[1]
        start_s = t_s[p] + first_firing_s[echoes - 1]

        turned = np.int64(0)
        steps = 0
        at = base + azimuth_at
        before = (np.int64(data[at]) | np.int64(data[at + 1]) << 8) % 36_000
        if blocks == 1 and state[_STARTED] == 1.0 and 0.5 < (start_s - state[_TIME]) / group_s < 1.5:
            step = (before - np.int64(state[_AZIMUTH]) + 18_000) % 36_000 - 18_000
            if 0 <= step <= max_step:
                turned += step
                steps += 1
        for _ in range(1, blocks):
            at += size
            block = (np.int64(data[at]) | np.int64(data[at + 1]) << 8) % 36_000
            step = (block - before + 18_000) % 36_000 - 18_000
            if abs(step) <= max_step:
                turned += step
                steps += 1
            before = block
        rate = max(0.0, turned / (steps * group_s)) if steps else state[_RATE]
        state[_RATE] = rate
        state[TURNED] += turned
        state[TURNING] += steps * group_s
        hidden = steps == blocks - 2  # one leap, between the edges of the sector that the sensor reports
        hidden_s = 0.0
        for i in range(lasers_n):
            ahead = lasers[i, 1] + rate * lasers[i, 0] * to_rad
            cos_ahead[i] = np.cos(ahead) * lasers[i, 2]
            sin_ahead[i] = np.sin(ahead) * lasers[i, 2]
            # in columns, of lasers that look aside; of steps of 0.01 degrees at least
            shift[i] = np.int64(np.rint((lasers[i, 1] - least) / (max(rate * cycle_s, 1.0) * to_rad)))
        turn_s = 36_000.0 / rate if rate > 0.0 else 0.1
        at = base + azimuth_at
        before = (np.int64(data[at]) | np.int64(data[at + 1]) << 8) % 36_000
        for b in range(blocks):
            at = base + b * size
            if marked and (data[at] != 0xFF or data[at + 1] != 0xEE):
                state[BAD_BLOCKS] += blocks_n - b * blocks_n // blocks
                break
            block = (np.int64(data[at + azimuth_at]) | np.int64(data[at + azimuth_at + 1]) << 8) % 36_000
            leap = (block - before) % 36_000
            if hidden and max_step < leap < 36_000 - max_step and rate > 0.0:
                hidden_s = (np.rint(leap / (rate * cycle_s)) - per_block) * cycle_s
            before = block
            for f in range(per_block):
                azimuth = block + rate * cycle_s * f
                if azimuth >= 36_000.0:
                    azimuth -= 36_000.0
                fired_s = start_s + (b * per_block + f) * cycle_s + hidden_s
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
                col = np.int64(state[_COLUMN])
                from_ = at + f * lasers_n * unit
                for i in range(lasers_n):
                    slot = from_ + table[2 + i]
                    found = 0
                    for _ in range(echoes):
                        count = np.int64(data[slot]) | np.int64(data[slot + 1]) << 8
                        value = data[slot + 2]
                        slot += block_bytes
                        if count == 0:
                            continue
                        k = found  # by distance; of equal ones the last
                        while k > 0 and counts[k - 1] > count:
                            k -= 1
                        if k > 0 and counts[k - 1] == count:
                            bright[k - 1] = value
                            continue
                        for j in range(found, k, -1):
                            counts[j] = counts[j - 1]
                            bright[j] = bright[j - 1]
                        counts[k] = count
                        bright[k] = value
                        found += 1
                    if found == 0:
                        continue
                    ux = cos_a * cos_ahead[i] - sin_a * sin_ahead[i]
                    uy = -(sin_a * cos_ahead[i] + cos_a * sin_ahead[i])
                    for k in range(found):
                        range_m = counts[k] * resolution_m
                        t_out[n] = fired_s + lasers[i, 0]
                        xyz[n, 0] = range_m * ux
                        xyz[n, 1] = range_m * uy
                        xyz[n, 2] = range_m * lasers[i, 3] + lasers[i, 4]
                        intensity[n] = bright[k]
                        laser[n] = order[i]
                        column[n] = min(col + shift[i], 65_535)
                        return_number[n] = k + 1
                        returns[n] = found
                        n += 1
    return n, cuts
