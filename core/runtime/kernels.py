"""How kernels are compiled."""

from __future__ import annotations

from functools import partial
from typing import Final

import numba

kernel: Final = partial(numba.njit, cache=True, nogil=True, no_cfunc_wrapper=True)
"""``@kernel()`` compiles a function when it is first called, and keeps it on disk. The wrapper for callers in C, which
nobody uses, would take a sixth of the time."""
