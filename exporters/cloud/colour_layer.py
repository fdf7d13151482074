"""The layer of colours of a LAZ chunk: their bytes, green and blue predicted to change as red does.

Like :mod:`~furrowmap.exporters.cloud.layers`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.exporters.cloud.arithmetic import coder_at, encode, finish, inlined, kernel, model_size

CHANGES: Final = 128
"""Symbols of which bytes differ from the point before (six bits), and whether the colour is other than grey."""
BYTES: Final = 256
BYTES_SIZE: Final = model_size(BYTES)
RED_LOW, RED_HIGH, GREEN_LOW, GREEN_HIGH, BLUE_LOW, BLUE_HIGH, COLOURS_END = (
    model_size(CHANGES) + i * BYTES_SIZE for i in range(7)
)


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
    """Red, green and blue."""
    table[:COLOURS_END] = 0
    coder = coder_at(at)
    for i in range(1, len(red)):
        r, g, b = np.int64(red[i]), np.int64(green[i]), np.int64(blue[i])
        last_r, last_g, last_b = np.int64(red[i - 1]), np.int64(green[i - 1]), np.int64(blue[i - 1])
        low_r, low_g, low_b = r & 255, g & 255, b & 255
        high_r, high_g, high_b = r >> 8, g >> 8, b >> 8
        was_low_r, was_low_g, was_low_b = last_r & 255, last_g & 255, last_b & 255
        was_high_r, was_high_g, was_high_b = last_r >> 8, last_g >> 8, last_b >> 8
        change = (low_r != was_low_r) | (high_r != was_high_r) << 1
        change |= (low_g != was_low_g) << 2 | (high_g != was_high_g) << 3
        change |= (low_b != was_low_b) << 4 | (high_b != was_high_b) << 5
        coloured = (r != g) | (r != b)
        coder = encode(out, coder, table, 0, CHANGES, change | coloured << 6)
        if low_r != was_low_r:
            coder = encode_byte(out, coder, table, RED_LOW, low_r, was_low_r)
        if high_r != was_high_r:
            coder = encode_byte(out, coder, table, RED_HIGH, high_r, was_high_r)
        if coloured:
            step_low, step_high = low_r - was_low_r, high_r - was_high_r
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
