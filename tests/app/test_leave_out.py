"""What commands leave out of libraries, and what a program that uses furrowmap keeps of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PLOTS = "--crs EPSG:6677 --corner 0,0 --azimuth 86 --rows 2 --columns 2 --length 2 --width 1"
OF_A_COMMAND = """
import sys
from furrowmap.cli.main import main
try:
    main()
except SystemExit as ended:
    assert not ended.code, ended.code
import laspy, numba, pyogrio, rasterio
print(sorted({"boto3", "cffi", "geopandas", "pandas", "pyarrow", "requests", "yaml"}.intersection(sys.modules)))
import geopandas  # of an export of tables
print(len(geopandas.GeoDataFrame({"a": [1]})))
"""
OF_A_PROGRAM = """
import sys
import furrowmap
from furrowmap.core.readers.ogr_layers import list_layers
from pathlib import Path
assert list_layers(Path(sys.argv[1]))
import geopandas
print(len(geopandas.read_file(sys.argv[1])))
"""


def said(code: str, *words: str | Path) -> list[str]:
    """The last lines of a process's output."""
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-2:]


def test_command__imports_no_tables_and_a_program_that_uses_furrowmap_reads_them(tmp_path: Path) -> None:
    made = tmp_path / "plots.gpkg"
    assert said(OF_A_COMMAND, "plots", *PLOTS.split(), "-o", made) == ["[]", "1"]
    assert said(OF_A_PROGRAM, made)[-1] == "4"
