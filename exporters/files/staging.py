"""Writing a folder of products: it holds those of one run or of another, never a mixture."""

import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError
from furrowmap.core.runtime.file_names import is_relative_name
from furrowmap.core.runtime.write_errors import failed_write, shown_path, write_error
from furrowmap.exporters.files.atomic import flush, flush_folder, flush_together, move, refuse_open, unwritable
from furrowmap.exporters.files.lease import (
    COMPLETE,
    STAGED_PRODUCTS,
    hold_lease,
    is_real_folder,
    is_revoked,
    read_small,
    refuse_leased,
)
from furrowmap.exporters.files.plain_files import refuse_special

_KEPT: Final = "kept.bin"


def refuse_products(folder: Path, products: Iterable[str], *, overwrite: bool) -> None:
    """Raise RefusedError if products of these names may not be replaced, or are open elsewhere, on Windows.

    Raises InputError if something else than a file has such a name.
    """
    there = [name for name in products if os.path.lexists(folder / name)]
    if there and not overwrite:
        raise RefusedError("output-exists.earlier-products", folder=folder, there=", ".join(there))
    for name in there:
        _refuse_taken(folder / name)
    refuse_open(folder / name for name in there)


@contextmanager
def staged_folder(folder: Path, *, resume: bool = False) -> Iterator[Path]:
    """Write products into a staging folder and move them to `folder` together at the end.

    If the work is interrupted, `folder` is unchanged. If the process is killed while it moves the finished products,
    the next run or :func:`recover` completes that. Products that an earlier report of the same name lists, and that
    neither have a successor nor are in the new reports' lists, are removed. Raises InputError if `folder` cannot be
    written to; RefusedError if another run is writing to it; if another program has earlier products open, on Windows:
    they are unchanged, or, if it opened them at the last moment, the next run or :func:`recover` replaces them.

    Args:
        folder: of the products, made if it does not exist.
        resume: take over the file :func:`kept` of a run that was killed.

    Yields:
        The folder to write to; every file in it, and in the folders below, becomes a product under its own name.
    """
    created = not folder.exists()
    try:
        with ExitStack() as stack:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                lease = stack.enter_context(hold_lease(folder))
                _finish_ended(folder, lease, resume=resume)
                products = lease / STAGED_PRODUCTS
                products.mkdir()
            except OSError as error:
                raise unwritable(folder, error) from error
            try:
                yield products
                _commit(lease, folder)
            except FurrowmapError:
                raise
            except Exception as error:
                if isinstance(error, OSError) and is_revoked(lease):
                    raise RefusedError("output-lost", folder=folder) from None
                failed = failed_write(error, folder)
                if failed is not None:
                    raise write_error(_product_of(failed, products), failed) from error
                raise
    except BaseException:
        if created:
            with suppress(OSError):
                folder.rmdir()
        raise


def kept(staging: Path) -> Path:
    """The file beside a staging folder for what a later run may continue from, if this one is killed."""
    return staging.parent / _KEPT


def recover(folder: Path) -> None:
    """Complete the move of a killed run's finished products, and remove those that cannot be resumed.

    Raises RefusedError if a run is writing to the folder, or another program has products open, on Windows.
    """
    if folder.is_dir():
        _finish_ended(folder)


def _finish_ended(folder: Path, own: Path | None = None, *, resume: bool = False) -> None:
    for lease in refuse_leased(folder, own):
        resumable = not _put_in_place(lease, folder) and _is_regular_file(lease / _KEPT)
        if resumable and own is None:
            continue
        if resumable and resume and own is not None:
            (lease / _KEPT).replace(own / _KEPT)
        shutil.rmtree(lease, ignore_errors=True)


def _commit(lease: Path, folder: Path) -> None:
    """Replace the earlier products by the new ones.

    From the moment that the file `complete.json` exists the new products are valid, even if the process is killed.
    """
    staging = lease / STAGED_PRODUCTS
    products = _products(staging)
    names = {path.as_posix() for path in products}
    for path in products:
        _refuse_taken(folder / path)
        for inner in (folder / part for part in _folders(path)):
            if os.path.lexists(inner) and not is_real_folder(inner):
                raise InputError("output-no-folder", inner=inner)
    refuse_open(folder / path for path in products)
    flush_together([staging / path for path in products])
    earlier = {name for name in _listed(folder, names) if _is_product(folder, name)}
    gone = sorted(earlier - names - _listed(staging, names))
    content = json.dumps({"products": sorted(names), "gone": gone})
    unfinished = lease / f"{COMPLETE}.part"
    unfinished.write_text(content, encoding="utf-8")
    flush(unfinished)
    if is_revoked(lease):
        raise RefusedError("output-lost", folder=folder)
    unfinished.replace(lease / COMPLETE)
    flush_folder(lease)
    _put_in_place(lease, folder)
    flush_folder(folder)
    (lease / COMPLETE).unlink()


def _product_of(error: BaseException, staging: Path) -> Path:
    """The product that could not be written: the one that the error names, or else that was written to last."""
    name = (error.filename2 or error.filename) if isinstance(error, OSError) else None
    if isinstance(name, str) and Path(name).is_relative_to(staging):
        return shown_path(name)
    last = max(
        (staging / path for path in _products(staging)), key=lambda path: path.stat().st_mtime_ns, default=staging
    )
    return shown_path(last)


def _refuse_taken(place: Path) -> None:
    if place.is_dir():
        raise InputError("output-is-folder.in-the-place", place=place)
    refuse_special(place)


def _put_in_place(lease: Path, folder: Path) -> bool:
    """Move finished products to their places, and earlier ones without a successor away; False where there are none.

    All changes are renamings out of the lease's folder or into it, so a run that has lost its lease changes nothing.
    """
    complete = _read(lease / COMPLETE)
    if not complete or not is_real_folder(lease / STAGED_PRODUCTS):
        return False
    leaving = lease / secrets.token_hex(4)
    leaving.mkdir()
    gone = complete.get("gone")
    for name in gone if isinstance(gone, list) else ():
        if isinstance(name, str) and _is_product(folder, name):
            with suppress(FileNotFoundError):
                _move(folder / name, leaving / secrets.token_hex(8), folder / name)
            for part in _folders(Path(name)):
                with suppress(OSError):  # not empty
                    (folder / part).rmdir()
    staging = lease / STAGED_PRODUCTS
    for path in _products(staging):
        if all(_made(folder / part) for part in reversed(_folders(path))):
            with suppress(FileNotFoundError):  # another process completes the same
                _move(staging / path, folder / path, folder / path)
    return True


def _move(source: Path, target: Path, product: Path) -> None:
    try:
        move(source, target)
    except PermissionError:
        raise RefusedError("output-open.after", path=product) from None


def _made(inner: Path) -> bool:
    """Make a folder if it does not exist; whether there is one, and no link to one, afterwards."""
    with suppress(FileExistsError):
        inner.mkdir()
    return is_real_folder(inner)


def _folders(path: Path) -> list[Path]:
    """The folders that a relative path leads through."""
    return [part for part in path.parents if part != Path()]


def _is_product(folder: Path, name: str) -> bool:
    """Whether a name in a report is that of a file of the folder; links are not followed."""
    return (
        is_relative_name(name)
        and all(is_real_folder(folder / part) for part in _folders(Path(name)))
        and (folder / name).is_file()
    )


def _listed(folder: Path, names: set[str]) -> set[str]:
    """What the reports of these names in a folder list under "products"."""
    reports = [_read(folder / name) for name in names if name.endswith(".json") and "/" not in name]
    listed = [report.get(key) for report in reports for key in ("products", "furrowmap:products")]
    return {name for products in listed if isinstance(products, list) for name in products if isinstance(name, str)}


def _products(staging: Path) -> list[Path]:
    """The regular files in a folder and in those below, relative to it."""
    found = []
    for place, folders, files in os.walk(staging):
        folders[:] = [name for name in folders if is_real_folder(Path(place, name))]
        found += [path for path in (Path(place, name) for name in files) if _is_regular_file(path)]
    return sorted(path.relative_to(staging) for path in found)


def _is_regular_file(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _read(path: Path) -> dict[str, Any]:
    """A JSON object; empty for a missing or damaged file."""
    try:
        content = json.loads(read_small(path))
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}
