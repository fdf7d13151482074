"""Handling of SIGINT (Ctrl-C) and SIGTERM."""

from __future__ import annotations

from typing import Final, NoReturn


class Interruption:
    """Signal handler that raises KeyboardInterrupt, so that callers can clean up.

    Attributes:
        asked: whether a signal came. Compiled code and libraries convert the exception, or lose it in a callback.
    """

    def __init__(self) -> None:
        self.asked = False

    def __call__(self, *_: object) -> NoReturn:
        """Handle the signal."""
        self.asked = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise the exception again if it was lost.

        Raises:
            KeyboardInterrupt: if a signal came.
        """
        if self.asked:
            raise KeyboardInterrupt


INTERRUPTION: Final = Interruption()
"""The handler of this process."""
