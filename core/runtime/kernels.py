"""How kernels are compiled."""

from functools import partial
from typing import Final

import numba

kernel: Final = partial(numba.njit, cache=True, nogil=True, no_cfunc_wrapper=True, fastmath=False)
"""``@kernel()`` compiles a function when it is first called, and keeps it on disk. The wrapper for callers in C, which
nobody uses, would take a sixth of the time. Floating-point flags are stated even where there are none: numba gives a
function without them those of the kernel that calls it first, so that the last bits depended on the order of calls."""

kernel_part: Final = partial(kernel, _nrt=False, error_model="numpy")
"""The same for what kernels call in their loops: it neither makes nor returns arrays, so that it needs no counts of who
holds those it is given. These are atomic; two threads that take turns at them would spend a fifth of the time there.
Kernels that make no arrays may be such too: they take arrays out of tuples in their loops without counting. Division by
zero gives infinity, as in most kernels."""


@kernel_part()
def count_until(values, limit):  # type: ignore[no-untyped-def]
    """Number of increasing values (n,) up to a limit; numba compiles its `np.searchsorted` for a third of a second."""
    begin = 0
    end = len(values)
    while begin < end:
        middle = (begin + end) >> 1
        if values[middle] <= limit:
            begin = middle + 1
        else:
            end = middle
    return begin
