"""The layer of times of a LAZ chunk: differences of the times' bits as integers.

Like :mod:`~furrowmap.exporters.cloud.layers`. Up to four sequences of times are followed, each with a step: the next
difference is coded as a multiple of the step and a remainder.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.exporters.cloud.arithmetic import (
    coder_at,
    encode,
    ends_of,
    finish,
    inlined,
    kernel,
    model_size,
    write_bits,
)
from furrowmap.exporters.cloud.integers import encode_integer, integers_size

SEQUENCES: Final = 4
MOST: Final = 500
"""Greatest multiple of the step with a symbol."""
LEAST: Final = -10
OTHER: Final = MOST - LEAST + 1
"""The symbol of a new sequence; those of the other three follow."""
MULTIPLES: Final = OTHER + SEQUENCES
FIRSTS: Final = 1 + SEQUENCES
"""Symbols without a step: 0 for this sequence, 1 for a new one, then the other three."""
UNSTEADY: Final = 3
"""After more consecutive multiples of 0 or beyond the limits, the step becomes the last difference."""
CONTEXTS: Final = 9
FIRSTS_AT, INTEGERS_AT, TIMES_END = ends_of(model_size(MULTIPLES), model_size(FIRSTS), integers_size(32, CONTEXTS))[1:]


@inlined()
def is_int32(value):  # type: ignore[no-untyped-def]
    """Whether a number fits into 32 bits."""
    return (value >= -0x80000000) & (value <= 0x7FFFFFFF)


@inlined()
def rest_context(multiple):  # type: ignore[no-untyped-def]
    """The context of the remainder."""
    if multiple > 0:
        return 1 if multiple == 1 else 2 if multiple < 10 else 3 if multiple < MOST else 4
    return 7 if multiple == 0 else 5 if multiple > LEAST else 6


@kernel()
def encode_times(out, at, table, memory, time, bits):  # type: ignore[no-untyped-def]
    """Times, where they differ; `bits` are the same numbers as int64."""
    table[:TIMES_END] = 0
    memory[: 3 * SEQUENCES] = 0
    last, step, unsteady = memory[:4], memory[4:8], memory[8:12]
    last[0] = bits[0]
    now, newest = 0, 0
    coder = coder_at(at)
    for i in range(1, len(bits)):
        if time[i] == time[i - 1]:
            continue
        value = bits[i]
        if not is_int32(value - last[now]):
            other = 1
            while other < SEQUENCES and not is_int32(value - last[(now + other) & 3]):
                other += 1
            other &= 3
            if step[now] == 0:
                coder = encode(out, coder, table, FIRSTS_AT, FIRSTS, 1 + other)
            else:
                coder = encode(out, coder, table, 0, MULTIPLES, OTHER + other)
            if other == 0:
                error = (value >> 32) - (last[now] >> 32)
                coder, _ = encode_integer(out, coder, table, INTEGERS_AT, 32, CONTEXTS, 8, error)
                coder = write_bits(out, coder, 16, value & 0xFFFF)
                coder = write_bits(out, coder, 16, (value >> 16) & 0xFFFF)
                now = newest = (newest + 1) & 3
                last[now], step[now], unsteady[now] = value, 0, 0
                continue
            now = (now + other) & 3
        difference = value - last[now]
        last[now] = value
        if step[now] == 0:
            coder = encode(out, coder, table, FIRSTS_AT, FIRSTS, 0)
            coder, _ = encode_integer(out, coder, table, INTEGERS_AT, 32, CONTEXTS, 0, difference)
            step[now], unsteady[now] = difference, 0
            continue
        # In single precision, as every decoder has it.
        ratio = np.float32(difference) / np.float32(step[now])
        ratio += np.float32(0.5) if ratio >= 0 else np.float32(-0.5)
        multiple = np.int64(max(min(ratio, np.float32(MOST)), np.float32(LEAST)))
        symbol = multiple if multiple >= 0 else MOST - multiple
        coder = encode(out, coder, table, 0, MULTIPLES, symbol)
        error = difference - multiple * step[now]
        coder, _ = encode_integer(out, coder, table, INTEGERS_AT, 32, CONTEXTS, rest_context(multiple), error)
        if multiple == 1:
            unsteady[now] = 0
        elif multiple in (0, MOST, LEAST):
            unsteady[now] += 1
            if unsteady[now] > UNSTEADY:
                step[now], unsteady[now] = difference, 0
    return finish(out, coder)
