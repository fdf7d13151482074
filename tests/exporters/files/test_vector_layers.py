"""Vector files that cannot be written whole are named, also where the disk has room, as with a limit of their size."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely

from furrowmap.core.runtime.write_errors import WriteError
from furrowmap.exporters.files.vector_layers import write_arrays

if sys.platform == "win32":
    pytest.skip("files have no limit of their size", allow_module_level=True)
else:
    import resource

LIMIT_BYTES = 64 << 10


@pytest.fixture
def limit() -> Iterator[None]:
    """Files of this process have at most so many bytes; Python ignores the signal."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT_BYTES, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("limit")
@pytest.mark.parametrize("driver", ["GPKG", "GeoJSON", "FlatGeobuf"])
def test_promise_19__file_that_grows_too_large_is_named(driver: str, tmp_path: Path) -> None:
    points = shapely.to_wkb(shapely.points(np.random.default_rng(1).uniform(0, 1, (20_000, 2))))
    path = tmp_path / "points.gpkg"
    with pytest.raises(WriteError, match=r"points.gpkg cannot be written"):
        write_arrays(path, points, [], [], layer="points", driver=driver, geometry_type="Point", crs="EPSG:4326")
