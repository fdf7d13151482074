"""The layers of a LAZ chunk of point formats 6 and 7, each a stream of bytes of its own.

Content and contexts follow Isenburg's published source of LASzip 3 (items of version 3). Columns have one value for
each point of the chunk. The first point is stored uncompressed, so each layer begins with the second.

All functions take the output, the start of their layer in it, a uint16 `table` of :data:`TABLE_SIZE` for the models and
an int64 `memory` of :data:`MEMORY_SIZE` for preceding values, and return the end of the layer.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.exporters.cloud import layers
from furrowmap.exporters.cloud.arithmetic import (
    coder_at,
    encode,
    encode_integer,
    ends_of,
    finish,
    inlined,
    integers_size,
    kernel,
    model_size,
    wrapped,
    write_bits,
)

MAX_POINT_BYTES: Final = 80
"""Upper bound of all layers of a point without its extra bytes."""
MAX_EXTRA_BYTES: Final = 2
MAX_END_BYTES: Final = 64
"""Upper bound of the ends of all layers."""
RECORD: Final = struct.Struct("<3iHBxBx2xHd")
"""A record of point format 6; flags, user data and scan angle are 0."""


@dataclass(frozen=True)
class ChunkColumns:
    """The points of a chunk as columns; all arrays have n > 0 elements and may be changed in place.

    Attributes:
        x, y, z: steps of the coordinates' scale.
        returns: return number, and number of returns of the pulse times 16.
        gps_time: adjusted standard GPS time.
        rgb: (3, n); None in point format 6.
        extra: (bytes, n) of the dimensions beyond those of LAS.
    """

    x: NDArray[np.int32]
    y: NDArray[np.int32]
    z: NDArray[np.int32]
    intensity: NDArray[np.uint16]
    returns: NDArray[np.uint8]
    classification: NDArray[np.uint8]
    point_source_id: NDArray[np.uint16]
    gps_time: NDArray[np.float64]
    rgb: NDArray[np.uint16] | None
    extra: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.x)


def compress_points(points: ChunkColumns) -> bytes:
    """The chunk of points: the first point uncompressed, their number, the layers' lengths, and the layers.

    Layers of columns with a single value are empty.
    """
    n = len(points)
    extra = points.extra
    out = np.empty(n * (MAX_POINT_BYTES + MAX_EXTRA_BYTES * len(extra)) + MAX_END_BYTES * (10 + len(extra)), np.uint8)
    table, memory = np.empty(layers.TABLE_SIZE, np.uint16), np.empty(layers.MEMORY_SIZE, np.int64)
    z_context = np.empty(n, np.uint8)
    x = points.x
    y = points.y
    z = points.z
    returns = points.returns
    time = points.gps_time
    ends = [0]

    def layer(column: NDArray[Any], encode: Callable[..., int], *columns: NDArray[Any]) -> None:
        ends.append(encode(out, ends[-1], table, *columns) if differs(column) else ends[-1])

    for places in (x, y):
        layers.predict(places, returns, time, memory)
    ends.append(layers.encode_places(out, 0, table, x, y, returns, points.point_source_id, time, z_context))
    ends.append(layers.encode_heights(out, ends[-1], table, memory, z, returns, z_context))
    layer(points.classification, layers.encode_classes, points.classification, returns)
    ends.append(ends[-1])  # flags
    layer(points.intensity, layers.encode_intensities, memory, points.intensity, returns, time)
    ends += [ends[-1]] * 2  # scan angle, user data
    layer(points.point_source_id, layers.encode_sources, points.point_source_id)
    layer(time, layers.encode_times, memory, time, time.view(np.int64))
    if points.rgb is not None:
        red, green, blue = points.rgb
        coloured = differs(red) or differs(green) or differs(blue)
        ends.append(layers.encode_colours(out, ends[-1], table, red, green, blue) if coloured else ends[-1])
    for values in extra:
        layer(values, layers.encode_bytes, values)
    lengths = np.diff(ends).astype("<u4").tobytes()
    fields = (x, y, z, points.intensity, returns, points.classification, points.point_source_id, time)
    colour = b"" if points.rgb is None else points.rgb[:, 0].astype("<u2").tobytes()
    first = RECORD.pack(*(column[0] for column in fields)) + colour + extra[:, 0].tobytes()
    return b"".join([first, struct.pack("<I", n), lengths, out[: ends[-1]].data])


def differs(column: NDArray[Any]) -> bool:
    """Whether not all values are the same."""
    return bool(column[0] != column[-1] or (column != column[0]).any())


# Kind of a return (0 to 5) by number of returns (rows) and return number (columns).
RETURN_KINDS: Final = np.array(
    [
        int(kind)
        for row in (
            "0123453445555555",
            "1013333333333333",
            "2124444444433333",
            "3345444444444444",
            "4344544444444444",
            "5344454444444444",
            "3344445444444444",
            "4344444544444444",
            "4344444454444444",
            "5344444445444444",
            "5344444444544444",
            "5334444444455444",
            "5334444444455544",
            "5334444444445554",
            "5334444444444555",
            "5334444444444455",
        )
        for kind in row
    ],
    np.int64,
)
# Numbers that kernels pass to each other are int64: numba would compile the called one again for every literal.
ZERO, ONE, EIGHT, BITS_16, BITS_32 = (np.int64(number) for number in (0, 1, 8, 16, 32))
POINT_CHANGES: Final = np.int64(128)
"""Symbols of what differs between a point and the one before."""
RETURN_NUMBERS: Final = np.int64(16)
JUMPS: Final = np.int64(13)
"""Differences of return numbers within a pulse that are neither 0, 1 nor −1."""
BYTES: Final = np.int64(256)
CHANGES_SIZE: Final = model_size(POINT_CHANGES)
NUMBERS_SIZE: Final = model_size(RETURN_NUMBERS)
BYTES_SIZE: Final = model_size(BYTES)
X_CONTEXTS: Final = np.int64(2)
Y_CONTEXTS: Final = np.int64(22)
Z_CONTEXTS: Final = np.int64(20)
COUNTS_AT, NUMBERS_AT, JUMPS_AT, X_AT, Y_AT, PLACES_END = ends_of(
    8 * CHANGES_SIZE,
    16 * NUMBERS_SIZE,
    16 * NUMBERS_SIZE,
    model_size(JUMPS),
    integers_size(BITS_32, X_CONTEXTS),
    integers_size(BITS_32, Y_CONTEXTS),
)[1:]
Z_END: Final = integers_size(BITS_32, Z_CONTEXTS)
CLASSES_END: Final = 64 * BYTES_SIZE
INTENSITY_CONTEXTS: Final = np.int64(4)
INTENSITY_END: Final = integers_size(BITS_16, INTENSITY_CONTEXTS)
SOURCE_END: Final = integers_size(BITS_16, ONE)
COLOUR_CHANGES: Final = np.int64(128)
"""Symbols of which bytes of a colour differ from the point before (six bits), and whether it is other than grey."""
RED_LOW, RED_HIGH, GREEN_LOW, GREEN_HIGH, BLUE_LOW, BLUE_HIGH, COLOURS_END = (
    model_size(COLOUR_CHANGES) + i * BYTES_SIZE for i in range(7)
)
SEQUENCES: Final = 4
MAX_MULTIPLE: Final = 500
"""Greatest multiple of the step with a symbol."""
MIN_MULTIPLE: Final = -10
OTHER_SEQUENCE: Final = MAX_MULTIPLE - MIN_MULTIPLE + 1
"""The symbol of a new sequence; those of the other three follow."""
MULTIPLES: Final = np.int64(OTHER_SEQUENCE + SEQUENCES)
FIRSTS: Final = np.int64(1 + SEQUENCES)
"""Symbols without a step: 0 for this sequence, 1 for a new one, then the other three."""
REST_CONTEXTS: Final = np.select(
    [(m := np.arange(MIN_MULTIPLE, MAX_MULTIPLE + 1)) == MIN_MULTIPLE, m < 0, m == 0, m == 1, m < 10, m < MAX_MULTIPLE],
    [6, 5, 7, 1, 2, 3],
    4,
).astype(np.int64)
"""Context of the remainder by multiple from the least on."""
MAX_UNSTEADY: Final = 3
"""After more consecutive multiples of 0 or beyond the limits, the step becomes the last difference."""
T_CONTEXTS: Final = np.int64(9)
FIRSTS_AT, STEPS_AT, TIMES_END = ends_of(model_size(MULTIPLES), model_size(FIRSTS), integers_size(BITS_32, T_CONTEXTS))[
    1:
]
TABLE_SIZE: Final = max(PLACES_END, Z_END, CLASSES_END, INTENSITY_END, SOURCE_END, COLOURS_END, TIMES_END)

MEDIAN_SIZE: Final = 6
"""Numbers of a running median: see :func:`predict`."""
MEDIANS: Final = 12
MEMORY_SIZE: Final = MEDIANS * MEDIAN_SIZE


@kernel()
def predict(places, returns, time, memory):  # type: ignore[no-untyped-def]
    """Replace X or Y of all points but the first by the errors of their predictions.

    The step from the point before is predicted by a running median of the steps in its context: five of them are kept
    sorted, from a to e, and each new one replaces an end, the highest (`top` is -1) while steps are below the middle
    one, the lowest (`top` is 0) while they are above it. Masks, as a branch on `top` would mostly be guessed wrong.
    """
    memory[:] = 0
    memory[MEDIAN_SIZE - 1 :: MEDIAN_SIZE] = -1
    last = np.int64(places[0])
    context = 0
    a = b = c = d = e = ZERO
    top = -ONE
    for i in range(1, len(places)):
        usual = MEDIAN_SIZE * (2 * RETURN_KINDS[returns[i]] + (time[i] != time[i - 1]))
        if usual != context:
            memory[context] = a
            memory[context + 1] = b
            memory[context + 2] = c
            memory[context + 3] = d
            memory[context + 4] = e
            memory[context + 5] = top
            context = usual
            a = memory[context]
            b = memory[context + 1]
            c = memory[context + 2]
            d = memory[context + 3]
            e = memory[context + 4]
            top = memory[context + 5]
        step = wrapped(places[i] - last)
        last = np.int64(places[i])
        places[i] = wrapped(step - c)
        above = c + top
        a = b ^ ((a ^ b) & top)
        b = c ^ ((b ^ c) & top)
        c = d ^ ((c ^ d) & top)
        d = e ^ ((d ^ e) & top)
        a, b, c, d, e = min(a, step), max(a, min(b, step)), max(b, min(c, step)), max(c, min(d, step)), max(d, step)
        top = -np.int64(step <= above)


@inlined()
def return_place(returns):  # type: ignore[no-untyped-def]
    """Whether a return is its pulse's first (1), last (2), both (3) or neither (0)."""
    number = returns & 15
    count = returns >> 4
    return (number == 1) + 2 * (number >= count)


@kernel()
def encode_places(out, at, table, x, y, returns, source, time, z_context):  # type: ignore[no-untyped-def]
    """Changes, returns, and the errors of X and Y; also sets the context of each point's Z."""
    table[:PLACES_END] = 0
    coder = coder_at(at)
    time_differs = False
    for i in range(1, len(x)):
        last_number = returns[i - 1] & 15
        last_count = returns[i - 1] >> 4
        number = returns[i] & 15
        count = returns[i] >> 4
        context = return_place(returns[i - 1]) + 4 * time_differs
        time_differs = time[i] != time[i - 1]
        jump = (number - last_number) & 15
        change = (jump if jump < 2 else 2 if jump == 15 else 3) | (count != last_count) << 2 | time_differs << 4
        change |= (source[i] != source[i - 1]) << 5
        coder = encode(out, coder, table, context * CHANGES_SIZE, POINT_CHANGES, change)
        if count != last_count:
            coder = encode(out, coder, table, COUNTS_AT + last_count * NUMBERS_SIZE, RETURN_NUMBERS, np.int64(count))
        if change & 3 == 3:
            if time_differs:
                coder = encode(
                    out, coder, table, NUMBERS_AT + last_number * NUMBERS_SIZE, RETURN_NUMBERS, np.int64(number)
                )
            else:
                coder = encode(out, coder, table, JUMPS_AT, JUMPS, jump - 2)

        single = np.int64(count == 1)
        coder, x_bits = encode_integer(out, coder, table, X_AT, BITS_32, X_CONTEXTS, single, np.int64(x[i]))
        context = min(x_bits & ~1, 20) + single
        coder, y_bits = encode_integer(out, coder, table, Y_AT, BITS_32, Y_CONTEXTS, context, np.int64(y[i]))
        z_context[i] = min(((x_bits + y_bits) >> 1) & ~1, 18) + single
    return finish(out, coder)


@kernel()
def encode_heights(out, at, table, memory, z, returns, z_context):  # type: ignore[no-untyped-def]
    """Z, predicted by the last return with as many returns left in its pulse."""
    table[:Z_END] = 0
    memory[:8] = z[0]
    coder = coder_at(at)
    for i in range(1, len(z)):
        left = min(abs((returns[i] >> 4) - (returns[i] & 15)), 7)
        coder, _ = encode_integer(
            out, coder, table, ZERO, BITS_32, Z_CONTEXTS, np.int64(z_context[i]), z[i] - memory[left]
        )
        memory[left] = z[i]
    return finish(out, coder)


@kernel()
def encode_classes(out, at, table, classes, returns):  # type: ignore[no-untyped-def]
    """Classes, in contexts by the preceding class."""
    table[:CLASSES_END] = 0
    coder = coder_at(at)
    for i in range(1, len(classes)):
        context = 2 * (classes[i - 1] & 31) + (return_place(returns[i]) == 3)
        coder = encode(out, coder, table, context * BYTES_SIZE, BYTES, np.int64(classes[i]))
    return finish(out, coder)


@kernel()
def encode_intensities(out, at, table, memory, intensity, returns, time):  # type: ignore[no-untyped-def]
    """Intensities, predicted by the last return in the same place of its pulse."""
    table[:INTENSITY_END] = 0
    memory[:8] = intensity[0]
    coder = coder_at(at)
    for i in range(1, len(intensity)):
        place = return_place(returns[i])
        like = 2 * place + (time[i] != time[i - 1])
        error = intensity[i] - memory[like]
        coder, _ = encode_integer(out, coder, table, ZERO, BITS_16, INTENSITY_CONTEXTS, place, error)
        memory[like] = intensity[i]
    return finish(out, coder)


@kernel()
def encode_sources(out, at, table, source):  # type: ignore[no-untyped-def]
    """Point source numbers, where they differ."""
    table[:SOURCE_END] = 0
    coder = coder_at(at)
    for i in range(1, len(source)):
        if source[i] != source[i - 1]:
            coder, _ = encode_integer(out, coder, table, ZERO, BITS_16, ONE, ZERO, np.int64(source[i]) - source[i - 1])
    return finish(out, coder)


@kernel()
def encode_bytes(out, at, table, values):  # type: ignore[no-untyped-def]
    """One byte of the extra dimensions."""
    table[:BYTES_SIZE] = 0
    coder = coder_at(at)
    for i in range(1, len(values)):
        coder = encode(out, coder, table, ZERO, BYTES, (np.int64(values[i]) - values[i - 1]) & 255)
    return finish(out, coder)


@inlined()
def encode_byte(out, coder, table, model, value, guess):  # type: ignore[no-untyped-def]
    """The coder after a byte, coded as the error of a prediction."""
    return encode(out, coder, table, model, BYTES, (value - min(max(guess, 0), 255)) & 255)


@inlined()
def half(value):  # type: ignore[no-untyped-def]
    """Half of a number, rounded towards 0."""
    return (value + (value < 0)) >> 1


@kernel()
def encode_colours(out, at, table, red, green, blue):  # type: ignore[no-untyped-def]
    """Bytes of red, green and blue; green and blue are predicted to change as red does."""
    table[:COLOURS_END] = 0
    coder = coder_at(at)
    for i in range(1, len(red)):
        r = np.int64(red[i])
        g = np.int64(green[i])
        b = np.int64(blue[i])
        last_r = np.int64(red[i - 1])
        last_g = np.int64(green[i - 1])
        last_b = np.int64(blue[i - 1])
        low_r = r & 255
        low_g = g & 255
        low_b = b & 255
        high_r = r >> 8
        high_g = g >> 8
        high_b = b >> 8
        was_low_r = last_r & 255
        was_low_g = last_g & 255
        was_low_b = last_b & 255
        was_high_r = last_r >> 8
        was_high_g = last_g >> 8
        was_high_b = last_b >> 8
        change = (low_r != was_low_r) | (high_r != was_high_r) << 1
        change |= (low_g != was_low_g) << 2 | (high_g != was_high_g) << 3
        change |= (low_b != was_low_b) << 4 | (high_b != was_high_b) << 5
        coloured = (r != g) | (r != b)
        coder = encode(out, coder, table, ZERO, COLOUR_CHANGES, change | coloured << 6)
        if low_r != was_low_r:
            coder = encode_byte(out, coder, table, RED_LOW, low_r, was_low_r)
        if high_r != was_high_r:
            coder = encode_byte(out, coder, table, RED_HIGH, high_r, was_high_r)
        if coloured:
            step_low = low_r - was_low_r
            step_high = high_r - was_high_r
            if low_g != was_low_g:
                coder = encode_byte(out, coder, table, GREEN_LOW, low_g, was_low_g + step_low)
            if low_b != was_low_b:
                step_low = half(step_low + low_g - was_low_g)
                coder = encode_byte(out, coder, table, BLUE_LOW, low_b, was_low_b + step_low)
            if high_g != was_high_g:
                coder = encode_byte(out, coder, table, GREEN_HIGH, high_g, was_high_g + step_high)
            if high_b != was_high_b:
                step_high = half(step_high + high_g - was_high_g)
                coder = encode_byte(out, coder, table, BLUE_HIGH, high_b, was_high_b + step_high)
    return finish(out, coder)


@inlined()
def is_int32(value):  # type: ignore[no-untyped-def]
    """Whether a number fits into 32 bits."""
    return (value >= -0x80000000) & (value <= 0x7FFFFFFF)


@kernel()
def encode_times(out, at, table, memory, time, bits):  # type: ignore[no-untyped-def]
    """Times, where they differ, as differences of their bits, which are `bits` as int64.

    Up to four sequences of times are followed, each with a step: the next difference is coded as a multiple of the step
    and a remainder.
    """
    table[:TIMES_END] = 0
    memory[: 3 * SEQUENCES] = 0
    last = memory[:4]
    step = memory[4:8]
    unsteady = memory[8:12]
    last[0] = bits[0]
    now = 0
    newest = 0
    coder = coder_at(at)
    for i in range(1, len(bits)):
        if time[i] == time[i - 1]:
            continue
        value = bits[i]
        first = step[now] == 0
        begins = False
        if not is_int32(value - last[now]):
            other = 1
            while other < SEQUENCES and not is_int32(value - last[(now + other) & 3]):
                other += 1
            other &= 3
            begins = other == 0
            change = other + (1 if first else OTHER_SEQUENCE)
            coder = encode(out, coder, table, FIRSTS_AT if first else ZERO, FIRSTS if first else MULTIPLES, change)
            now = (now + other) & 3
            first = step[now] == 0
        difference = value - last[now]
        multiple = symbol = context = ZERO
        error = difference
        if begins:
            context = EIGHT
            error = (value >> 32) - (last[now] >> 32)
        elif not first:
            # In single precision, as every decoder has it.
            ratio = np.float32(difference) / np.float32(step[now])
            ratio += np.float32(0.5) if ratio >= 0 else np.float32(-0.5)
            multiple = np.int64(max(min(ratio, np.float32(MAX_MULTIPLE)), np.float32(MIN_MULTIPLE)))
            symbol = multiple if multiple >= 0 else MAX_MULTIPLE - multiple
            context = REST_CONTEXTS[np.uint64(multiple - MIN_MULTIPLE)]
            error = difference - multiple * step[now]
        if not begins:
            coder = encode(out, coder, table, FIRSTS_AT if first else ZERO, FIRSTS if first else MULTIPLES, symbol)
        # Once for all cases, because it is inlined: to compile it three times took a second.
        coder, _ = encode_integer(out, coder, table, STEPS_AT, BITS_32, T_CONTEXTS, context, error)
        if begins:
            for half_bits in range(0, 32, 16):
                coder = write_bits(out, coder, BITS_16, (value >> half_bits) & 0xFFFF)
            now = newest = (newest + 1) & 3
        last[now] = value
        if begins or first:
            step[now] = 0 if begins else difference
            unsteady[now] = 0
        elif multiple == 1:
            unsteady[now] = 0
        elif multiple in (0, MAX_MULTIPLE, MIN_MULTIPLE):
            unsteady[now] += 1
            if unsteady[now] > MAX_UNSTEADY:
                step[now] = difference
                unsteady[now] = 0
    return finish(out, coder)
