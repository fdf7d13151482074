"""Writing a folder of products: it holds those of one run or of another, never a mixture."""

from __future__ import annotations

import json
import os
import platform
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from furrowmap.core.values.errors import InputError, RefusedError
from furrowmap.exporters.files.atomic import is_running

STAGING: Final = ".furrowmap-run"
_OWNER: Final = "owner.json"
_COMPLETE: Final = "complete.json"


def refuse_products(folder: Path, products: Iterable[str], *, overwrite: bool) -> None:
    """Check, before the work, that a folder has no products of these names, or that they may be replaced.

    Raises:
        RefusedError: if there are any and `overwrite` is not given.
    """
    there = [name for name in products if (folder / name).exists()]
    if there and not overwrite:
        raise RefusedError(
            f"{folder} already contains {', '.join(there)}.",
            "They would be replaced.",
            "Choose another folder with -o, or replace them with --overwrite.",
            code="output-exists",
        )


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Write products into a staging folder and move them to `folder` together at the end.

    If the work is interrupted, `folder` is unchanged. If the process is killed while it moves the finished products,
    the next run or :func:`recover` completes that. Products that an earlier report of the same name lists, and that
    have no successor, are removed.

    Yields:
        The folder to write to; every file in it becomes a product under its own name.

    Raises:
        InputError: if `folder` cannot be written to.
        RefusedError: if another run is writing to it.
    """
    created = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        recover(folder)
        staging = folder / STAGING
        products = staging / "products"
        _claim(staging)
        products.mkdir()
    except OSError as error:
        raise InputError(
            f"{folder}: {error.strerror or error}.",
            "The products cannot be written there.",
            "Choose a folder that you may write to with -o.",
            code="output-unwritable",
        ) from None
    try:
        yield products
        names = {path.name for path in products.iterdir()}
        _mark_complete(staging, sorted(names), sorted(_earlier(folder, names) - names))
    except BaseException:
        shutil.rmtree(staging, ignore_errors=True)
        if created:
            with suppress(OSError):
                folder.rmdir()
        raise
    _move_in(folder)


def recover(folder: Path) -> None:
    """Complete the move of a killed run's finished products, or remove unfinished ones.

    Raises:
        RefusedError: if the run is still writing.
    """
    staging = folder / STAGING
    if not staging.is_dir():
        return
    owner = _read(staging / _OWNER)
    process = owner.get("process")
    foreign = owner.get("host") == platform.node() and process != os.getpid()
    if foreign and isinstance(process, int) and is_running(process):
        raise _busy(folder, f"another run (process {process}) is writing there")
    if (staging / _COMPLETE).exists():
        _move_in(folder)
    else:
        shutil.rmtree(staging)


def _busy(folder: Path, what: str) -> RefusedError:
    return RefusedError(
        f"{folder}: {what}.",
        "Two runs into one folder would mix their products.",
        "Wait for the other run, or choose another folder with -o.",
        code="output-busy",
    )


def _claim(staging: Path) -> None:
    try:
        staging.mkdir()
    except FileExistsError:
        raise _busy(staging.parent, "another run has just started to write there") from None
    (staging / _OWNER).write_text(json.dumps({"host": platform.node(), "process": os.getpid()}))


def _earlier(folder: Path, names: set[str]) -> set[str]:
    """The products that an earlier report with the name of a new one lists under "products"."""
    listed = [_read(folder / name).get("products") for name in names if name.endswith(".json")]
    found = [name for products in listed if isinstance(products, list) for name in products]
    return {name for name in found if isinstance(name, str) and Path(name).name == name and (folder / name).is_file()}


def _mark_complete(staging: Path, names: list[str], gone: list[str]) -> None:
    """Commit: from here on the new products replace the earlier ones, even if the process is killed."""
    unfinished = staging / "complete.part"
    with unfinished.open("w") as file:
        json.dump({"products": names, "gone": gone}, file)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(staging / _COMPLETE)


def _move_in(folder: Path) -> None:
    """Move the products to their places, and remove earlier ones without a successor."""
    staging = folder / STAGING
    complete = json.loads((staging / _COMPLETE).read_text())
    for name in complete["products"]:
        with suppress(FileNotFoundError):  # moved before the process was killed
            (staging / "products" / name).replace(folder / name)
    for name in complete["gone"]:
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(staging)


def _read(path: Path) -> dict[str, Any]:
    """A JSON object; empty for a missing or damaged file."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
