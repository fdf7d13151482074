"""A progress that holds workflows to what they promise of it."""

from __future__ import annotations


class Told:
    """Takes shares from 0 to 1, of which a stage never takes anything back.

    Attributes:
        shares: of each stage, in the order in which they were told.
    """

    def __init__(self) -> None:
        self.shares: dict[str, list[float]] = {}

    def __call__(self, stage: str, share: float) -> None:
        earlier = self.shares.setdefault(stage, [0.0])
        assert isinstance(stage, str)
        assert earlier[-1] <= share <= 1.0, (stage, earlier[-1], share)
        earlier.append(share)

    def begun(self) -> dict[str, bool]:
        """Whether more than its beginning was told of each stage."""
        return {stage: shares[-1] > 0.0 for stage, shares in self.shares.items()}
