"""Where the tests find recordings, and what happens where they are missing."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of sample recordings that lies beside the checkout."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the sample recordings (../shared/data) are not beside this checkout")
    return SHARED_DATA
