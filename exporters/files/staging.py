"""A folder that holds the products of one run or of another, never some of each."""

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
_ACCOUNTS: Final = ("report.json", "preview.json", "surfaces.json", "provenance.json")
"""Files that list the products they belong to, themselves among them, under "products"."""


def refuse_products(folder: Path, products: Iterable[str], *, overwrite: bool) -> None:
    """Keep the products of others in a folder, unless they were asked to go; to be called before the work.

    Raises:
        RefusedError: if there are any of that name, and nobody said `overwrite`.
    """
    there = [name for name in products if (folder / name).exists()]
    if there and not overwrite:
        raise RefusedError(
            f"{folder} holds {', '.join(there)} already.",
            "They would be lost, so nothing was done.",
            "Choose another folder with -o, or replace them with --overwrite.",
            code="output-exists",
        )


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Write products into a folder of their own, which take their places in `folder` together at the end.

    If anything interrupts the work, `folder` is as it was. If the process is killed while the finished products take
    their places (an instant of renaming), the next run or :func:`recover` finishes that. Two runs at once are refused.

    Yields:
        The folder to write to; every file in it becomes a product of `folder` under its own name.

    Raises:
        InputError: if `folder` cannot be written to.
        RefusedError: if another run is at work in it.
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
            "The products could not be written there, so the work did not start.",
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
    """Finish what a killed run had finished, and remove what it had not.

    Raises:
        RefusedError: if the run is still at work.
    """
    staging = folder / STAGING
    if not staging.is_dir():
        return
    owner = _read(staging / _OWNER)
    process = owner.get("process")
    foreign = owner.get("host") == platform.node() and process != os.getpid()
    if foreign and isinstance(process, int) and is_running(process):
        raise RefusedError(
            f"{folder}: another run (process {process}) is writing there.",
            "Two runs into one folder would mix their products.",
            "Wait for the other run, or choose another folder with -o.",
            code="output-busy",
        )
    if (staging / _COMPLETE).exists():
        _move_in(folder)
    else:
        shutil.rmtree(staging)


def _claim(staging: Path) -> None:
    try:
        staging.mkdir()
    except FileExistsError:
        raise RefusedError(
            f"{staging.parent}: another run has just begun to write there.",
            "Two runs into one folder would mix their products.",
            "Wait for the other run, or choose another folder with -o.",
            code="output-busy",
        ) from None
    (staging / _OWNER).write_text(json.dumps({"host": platform.node(), "process": os.getpid()}))


def _earlier(folder: Path, names: set[str]) -> set[str]:
    """The products that the new ones take the place of: those that an earlier account of the same kind lists."""
    listed = [_read(folder / account).get("products") for account in _ACCOUNTS if account in names]
    found = [name for products in listed if isinstance(products, list) for name in products]
    return {name for name in found if isinstance(name, str) and Path(name).name == name and (folder / name).is_file()}


def _mark_complete(staging: Path, names: list[str], gone: list[str]) -> None:
    """From here on the new products are the folder's, and those without a successor are not, whatever happens."""
    unfinished = staging / "complete.part"
    with unfinished.open("w") as file:
        json.dump({"products": names, "gone": gone}, file)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(staging / _COMPLETE)


def _move_in(folder: Path) -> None:
    """Put the products in their places, and remove the earlier ones that have no successor."""
    staging = folder / STAGING
    complete = json.loads((staging / _COMPLETE).read_text())
    for name in complete["products"]:
        with suppress(FileNotFoundError):  # moved before the process was killed
            (staging / "products" / name).replace(folder / name)
    for name in complete["gone"]:
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(staging)


def _read(path: Path) -> dict[str, Any]:
    """A JSON object; empty if there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
