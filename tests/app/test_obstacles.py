"""Whatever has the name of a product, every writer changes nothing else, does not hang, and says what is in its way.

`KILLS=1` tries all writers with all of it.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from tests.app.killing import ALWAYS, KILLS, Mortal
from tests.app.obstacles import OBSTACLES, obstacle
from tests.app.writers import WRITERS

LONGEST_S = 240.0
REPLACED = ("symbolic link", "dangling link", "hard link")
"""What a new file takes the place of; what it leads to is unchanged."""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and sockets need rights there")


@pytest.mark.parametrize("deed", sorted(WRITERS) if KILLS else ALWAYS)
def test_promise_23__writer_follows_no_links_and_opens_no_pipes(deed: str, tmp_path: Path, program: Mortal) -> None:
    writer = WRITERS[deed]
    for name in ("sources", "products"):
        (tmp_path / name).mkdir()
    source = writer.make(tmp_path / "sources", 1)
    target = tmp_path / "products" / writer.target
    said = program.does(deed, source, target)
    assert said.get("operations"), said
    content = writer.content(target)
    kept = tmp_path / "kept"
    shutil.copytree(target.parent, kept)
    products = [target] if target.is_file() else sorted(path for path in target.rglob("[!.]*") if path.is_file())
    for number, kind in enumerate(OBSTACLES):
        shutil.rmtree(target.parent)
        shutil.copytree(kept, target.parent)
        product = products[number * len(products) // len(OBSTACLES)]
        product.unlink()
        with obstacle(product, kind) as unchanged:
            said = program.does(deed, source, target, seconds=LONGEST_S)
            unchanged()
            assert said["status"] == 0, (kind, product, said)
            if "operations" in said and kind in REPLACED:
                assert not product.is_symlink()
                assert product.stat().st_nlink == 1
                assert writer.content(target) == content
            else:
                assert len(said.get("error", ())) == 3, (kind, product, said)
                # A farm map may be a link, to one on a server.
                assert any(str(path) in said["error"][0] for path in (product, product.resolve())), (kind, said)
                assert product.is_symlink() or not product.is_file() or kind in REPLACED


@pytest.mark.parametrize("deed", sorted(WRITERS) if KILLS else ALWAYS)
def test_folder_that_does_not_exist__is_made_by_every_writer(deed: str, tmp_path: Path, program: Mortal) -> None:
    """But for those of which the folder has to be there: a session lies beside its recording, a farm map may be far."""
    writer = WRITERS[deed]
    (tmp_path / "sources").mkdir()
    source = writer.make(tmp_path / "sources", 1)
    target = tmp_path / "new" / "below" / writer.target
    said = program.does(deed, source, target)
    if deed in ("farm", "init", "calibrate"):
        assert not (tmp_path / "new").exists()
    else:
        assert said.get("operations"), said
        assert writer.content(target)
