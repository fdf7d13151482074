"""Integers in LAZ: the bit length of a prediction's error is one symbol, its highest bits are another.

Isenburg, "LASzip: lossless compression of LiDAR data" (PE&RS 79(2), 2013). A **coding of integers** in a
table (:mod:`~furrowmap.exporters.cloud.arithmetic`) has for each context a model of the bit length, then a model of the
bit that separates errors of 0 and 1, then for each greater bit length a model of the highest eight bits.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.exporters.cloud.arithmetic import (
    BIT_MODEL,
    HEAD,
    encode,
    encode_bit,
    inlined,
    model_size,
    write_bits,
)

DIRECT_BITS: Final = 8
"""Modelled bits of an error; lower ones are written uncompressed."""
MOST_BITS: Final = 32
CORRECTORS: Final = np.cumsum([0, BIT_MODEL, *(model_size(1 << min(k, DIRECT_BITS)) for k in range(1, MOST_BITS + 1))])
"""Offset of the model of errors of k bits from that of 0 bits; last, the end."""


def integers_size(bits: int, contexts: int) -> int:
    """Numbers that a coding of integers of `bits` bits takes in its table."""
    return contexts * model_size(bits + 1) + int(CORRECTORS[bits + 1])


@inlined()
def wrapped(value):  # type: ignore[no-untyped-def]
    """The int32 that the lowest 32 bits of a number are."""
    return ((value + 0x80000000) & 0xFFFFFFFF) - 0x80000000


@inlined()
def bit_length(value):  # type: ignore[no-untyped-def]
    """Bit length of a number from 0 to 2^32, by the exponent of its float."""
    return max((np.float64(value).view(np.int64) >> 52) - 1022, 0)


@inlined()
def encode_integer(out, coder, table, start, bits, contexts, context, error):  # type: ignore[no-untyped-def]
    """The coder after the error of an integer's prediction, and its bit length.

    The coding begins at `start` and is for integers of `bits` bits in `contexts` contexts.
    """
    half = 1 << (bits - 1)
    error = ((error + half) & ((1 << bits) - 1)) - half
    k = bit_length(error - 1 if error > 0 else -error)
    size = HEAD + 2 * (bits + 1)
    coder = encode(out, coder, table, start + context * size, bits + 1, k)
    correctors = start + contexts * size
    if k == 0:
        coder = encode_bit(out, coder, table, correctors, error)
    elif k < MOST_BITS:
        place = error - 1 if error > 0 else error + (1 << k) - 1
        rest = max(k - DIRECT_BITS, 0)
        coder = encode(out, coder, table, correctors + CORRECTORS[k], 1 << (k - rest), place >> rest)
        if rest:
            coder = write_bits(out, coder, rest, place & ((1 << rest) - 1))
    return coder, k
