"""Connections to PostGIS, and their errors without the password."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import psycopg
from psycopg.conninfo import conninfo_to_dict

from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError, UsageError

_CONNECT_S: Final = 10
_PUBLIC: Final = ("service", "host", "hostaddr", "port", "dbname", "user", "sslmode")
"""Parameters without secrets, shown in messages and stored in projects: each user has a password of their own."""


def public_parameters(target: str) -> dict[str, str]:
    """The parameters of a connection string that are not secret."""
    try:
        parameters = conninfo_to_dict(target)
    except psycopg.Error:  # whose text may repeat the password
        raise UsageError("usage.public-parameters") from None
    return {name: str(parameters[name]) for name in _PUBLIC if parameters.get(name) is not None}


def public_name(target: str) -> str:
    """`target` without its password."""
    known = public_parameters(target)
    if "service" in known:
        return f"service={known['service']}"
    user = f"{known['user']}@" if "user" in known else ""
    port = f":{known['port']}" if "port" in known else ""
    return f"postgresql://{user}{known.get('host', '')}{port}/{known.get('dbname', '')}"


@contextmanager
def connected(target: str) -> Iterator[psycopg.Connection[Any]]:
    """A connection whose errors are FurrowmapErrors.

    Raises:
        InputError: if there is no such server or database, or the password is wrong.
        RefusedError: if the user lacks a right, or another process holds a lock for too long.
        FurrowmapError: for all other errors of the database.
    """
    name = public_name(target)
    try:
        patience_s = conninfo_to_dict(target).get("connect_timeout", _CONNECT_S)
        connection = psycopg.connect(target, connect_timeout=patience_s)
    except psycopg.Error as error:
        raise _unreachable(name, error) from None
    with connection:
        try:
            yield connection
        except psycopg.Error as error:
            raise _database_error(name, error) from None


def _unreachable(name: str, error: psycopg.Error) -> InputError:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    last = lines[-1] if lines else type(error).__name__
    if "password" in last or "authentication" in last:
        return InputError("base-password", name=name, last=last)
    return InputError("base-unreachable", name=name, last=last)


def _database_error(name: str, error: psycopg.Error) -> FurrowmapError:
    message = error.diag.message_primary or str(error).splitlines()[0]
    if isinstance(error, psycopg.errors.InsufficientPrivilege):
        return RefusedError("base-no-right", name=name, message=message)
    if isinstance(error, psycopg.errors.LockNotAvailable):
        return RefusedError("base-busy", name=name)
    return FurrowmapError("base-database", name=name, message=message.rstrip("."))
