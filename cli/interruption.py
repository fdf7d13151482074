"""Ctrl-C, and a polite request to end."""

from __future__ import annotations

from typing import Final, NoReturn


class Interruption:
    """Turns the signals into an exception that lets everybody clean up behind them.

    Attributes:
        asked: whether one came, whatever became of the exception: compiled code and libraries turn it into others, or
            lose it where it meets them in a callback.
    """

    def __init__(self) -> None:
        self.asked = False

    def __call__(self, *_: object) -> NoReturn:
        """Handle the signal."""
        self.asked = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise again what was lost.

        Raises:
            KeyboardInterrupt: if a signal came.
        """
        if self.asked:
            raise KeyboardInterrupt


INTERRUPTION: Final = Interruption()
"""This process's own."""
