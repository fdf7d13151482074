"""Adaptive arithmetic coding of symbols and integers in LAZ, in inlined kernels.

Said, "Introduction to arithmetic coding: theory and practice" (HP Labs report HPL-2004-76, 2004): 32-bit intervals,
adaptive models of symbols. Isenburg, "LASzip: lossless compression of
LiDAR data" (PE&RS 79(2), 2013) fixes constants and the coding of integers; his published source decides what the
papers leave open.

A **coder** is a tuple (base, length, at): the interval, and the offset of its next byte in the output; base and length
are below 2^32. A **table** is a uint16 array of models, initially zeros. A **model** of n symbols takes ``2 n + 3``
numbers: symbols until the next update (0 in an unused model), symbols between updates, symbols counted; n cumulative
probabilities in units of 2^-15; n counts.

An integer is coded as the error of its prediction: its bit length is one symbol, its highest bits are another. A
**coding of integers** in a table has for each context a model of the bit length, then a model of the bit that separates
errors of 0 and 1, then for each greater bit length a model of the highest eight bits.
"""

from functools import partial
from itertools import accumulate
from typing import Final

import numba
import numpy as np

kernel: Final = partial(numba.njit, cache=True, nogil=True, no_cfunc_wrapper=True, _nrt=False)
"""Compiles without reference counting, which would take three quarters of the time: kernels may not create arrays."""
inlined: Final = partial(kernel, forceinline=True)

LENGTH_BITS: Final = 15
"""Precision of a symbol's probability."""
BIT_LENGTH_BITS: Final = 13
"""Precision of a single bit's probability."""
MIN_LENGTH: Final = 1 << 24
"""Shorter intervals output their first byte."""
HEAD: Final = 3
"""Numbers of a model before its probabilities."""
BIT_MODEL: Final = 5
"""Numbers of a model of a bit: bits until its update, bits between updates, bits, zeros, their probability."""
MAX_BITS_BETWEEN: Final = 64
MAX_RAW_BITS: Final = 19


def model_size(symbols: int | np.int64) -> np.int64:
    """Numbers that a model takes in its table."""
    return np.int64(HEAD + 2 * symbols)


def ends_of(*sizes: np.int64) -> list[np.int64]:
    """Offsets of consecutive models in a table; last, the end."""
    return [np.int64(0), *accumulate(sizes)]


@kernel()
def carry(out, at):  # type: ignore[no-untyped-def]
    """Add the overflow of the base to the bytes before."""
    i = at - 1
    while out[i] == 255:
        out[i] = 0
        i -= 1
    out[i] += 1


@inlined()
def bit_length(value):  # type: ignore[no-untyped-def]
    """Bit length of a number of 0 or more; LLVM makes one instruction of the loop."""
    left = np.uint64(value)
    bits = 0
    while left:
        left >>= np.uint64(1)
        bits += 1
    return bits


@inlined()
def settled(out, base, length, at):  # type: ignore[no-untyped-def]
    """The coder after its certain bytes have gone to the output."""
    if base >> 32:
        carry(out, at)
        base &= 0xFFFFFFFF
    # All bytes are written, in one instruction, and `at` moves on by the certain ones: no branches.
    out[np.uint64(at)] = base >> 24
    out[np.uint64(at + 1)] = base >> 16
    out[np.uint64(at + 2)] = base >> 8
    out[np.uint64(at + 3)] = base
    certain = (32 - bit_length(length)) & 24
    return (base << certain) & 0xFFFFFFFF, length << certain, at + (certain >> 3)


@inlined()
def coder_at(at):  # type: ignore[no-untyped-def]
    """A coder whose first byte goes to `at`."""
    return np.int64(0), np.int64(0xFFFFFFFF), np.int64(at)


@inlined()
def encode(out, coder, table, model, symbols, symbol):  # type: ignore[no-untyped-def]
    """The coder after a symbol below `symbols`; the model, which starts at `model`, has counted it."""
    base, length, at = coder
    head = np.uint64(model)  # Signed indices cost a tenth of the time (wraparound check).
    left = table[head]
    if left == 0:
        refresh(table, model, symbols)
        left = table[head]
    table[head] = left - 1
    k = model + HEAD + symbol
    table[np.uint64(k + symbols)] += 1
    share = length >> LENGTH_BITS
    low = np.int64(table[np.uint64(k)])
    # The last symbol takes the rounding remainder.
    length = length - low * share if symbol == symbols - 1 else (table[np.uint64(k + 1)] - low) * share
    return settled(out, base + low * share, length, at)


@kernel()
def refresh(table, model, symbols):  # type: ignore[no-untyped-def]
    """Make a model's probabilities follow its counts; in an unused one, all symbols are equally probable."""
    counts = model + HEAD + symbols
    new = table[model + 1] == 0
    if new:
        table[counts : counts + symbols] = 1
        table[model + 1] = symbols
        table[model + 2] = 0
    total = np.int64(table[model + 2]) + table[model + 1]
    if total > 1 << LENGTH_BITS:
        total = 0
        for k in range(counts, counts + symbols):
            table[k] = (table[k] + 1) >> 1
            total += table[k]
    scale = (1 << 31) // total
    seen = 0
    for k in range(symbols):
        table[model + HEAD + k] = (scale * seen) >> (31 - LENGTH_BITS)
        seen += table[counts + k]
    cycle = (symbols + 6) >> 1 if new else min((5 * table[model + 1]) >> 2, (symbols + 6) << 3)
    table[model] = cycle
    table[model + 1] = cycle
    table[model + 2] = total


@inlined()
def encode_bit(out, coder, table, model, bit):  # type: ignore[no-untyped-def]
    """The coder after a bit; its model has counted it."""
    base, length, at = coder
    if table[model] == 0:
        refresh_bit(table, model)
    table[model] -= 1
    table[model + 3] += 1 - bit
    low = table[model + 4] * (length >> BIT_LENGTH_BITS)
    return settled(out, base + bit * low, length - low if bit else low, at)


@kernel()
def refresh_bit(table, model):  # type: ignore[no-untyped-def]
    """Make a bit model's probability follow its counts; in an unused one, both are equally probable."""
    if table[model + 1] == 0:
        cycle = 4
        bits = np.int64(2)
        zeros = np.int64(1)
    else:
        cycle = min((5 * table[model + 1]) >> 2, MAX_BITS_BETWEEN)
        bits = np.int64(table[model + 2]) + table[model + 1]
        zeros = np.int64(table[model + 3])
        if bits > 1 << BIT_LENGTH_BITS:
            bits = (bits + 1) >> 1
            zeros = (zeros + 1) >> 1
            bits += zeros == bits
    table[model] = cycle
    table[model + 1] = cycle
    table[model + 2] = bits
    table[model + 3] = zeros
    table[model + 4] = (zeros * ((1 << 31) // bits)) >> (31 - BIT_LENGTH_BITS)


@inlined()
def write_bits(out, coder, bits, value):  # type: ignore[no-untyped-def]
    """The coder after a number of up to 32 uncompressed bits."""
    if bits > MAX_RAW_BITS:
        base, length, at = coder
        length >>= 16
        coder = settled(out, base + (value & 0xFFFF) * length, length, at)
        value >>= 16
        bits -= 16
    base, length, at = coder
    length >>= bits
    return settled(out, base + value * length, length, at)


@inlined()
def finish(out, coder):  # type: ignore[no-untyped-def]
    """The end of the output after the final bytes."""
    base, length, at = coder
    if length > 2 * MIN_LENGTH:
        base = base + MIN_LENGTH
        length = MIN_LENGTH >> 1
        zeros = 3
    else:
        base = base + (MIN_LENGTH >> 1)
        length = MIN_LENGTH >> 9
        zeros = 2
    _, _, at = settled(out, base, length, at)
    for _ in range(zeros):
        out[at] = 0
        at += 1
    return at


DIRECT_BITS: Final = 8
"""Modelled bits of an error; lower ones are written uncompressed."""
INTEGER_BITS: Final = 32
CORRECTORS: Final = np.cumsum(
    [0, BIT_MODEL, *(model_size(1 << min(k, DIRECT_BITS)) for k in range(1, INTEGER_BITS + 1))]
)
"""Offset of the model of errors of k bits from that of 0 bits; last, the end."""


def integers_size(bits: np.int64, contexts: np.int64) -> np.int64:
    """Numbers that a coding of integers of `bits` bits takes in its table."""
    return np.int64(contexts * model_size(bits + 1) + CORRECTORS[bits + 1])


@inlined()
def wrapped(value):  # type: ignore[no-untyped-def]
    """The int32 that the lowest 32 bits of a number are."""
    return ((value + 0x80000000) & 0xFFFFFFFF) - 0x80000000


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
    elif k < INTEGER_BITS:
        place = error - 1 if error > 0 else error + (1 << k) - 1
        rest = max(k - DIRECT_BITS, 0)
        coder = encode(out, coder, table, correctors + CORRECTORS[np.uint64(k)], 1 << (k - rest), place >> rest)
        if rest:
            coder = write_bits(out, coder, rest, place & ((1 << rest) - 1))
    return coder, k
