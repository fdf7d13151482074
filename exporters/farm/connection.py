"""The way to a PostGIS database, and what its errors mean, never with the password."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import psycopg
from psycopg.conninfo import conninfo_to_dict

from furrowmap.core.values.errors import FurrowmapError, InputError, RefusedError, UsageError

_CONNECT_S: Final = 10
_KEPT: Final = ("service", "host", "hostaddr", "port", "dbname", "user", "sslmode")
"""What of a connection may be told and is kept in a project: who opens that has a password of their own."""


def public_parameters(target: str) -> dict[str, str]:
    """The parameters of a connection that are no secret.

    Raises:
        UsageError: if `target` is not how PostgreSQL calls a database.
    """
    try:
        parameters = conninfo_to_dict(target)
    except psycopg.Error:  # whose text may repeat the password
        raise UsageError(
            "The base is written like a database, but PostgreSQL does not understand it.",
            "Nothing was done.",
            "Write postgresql://USER@SERVER:5432/DATABASE; special characters in it as %XX, passwords into ~/.pgpass.",
            code="usage",
        ) from None
    return {name: str(parameters[name]) for name in _KEPT if parameters.get(name) is not None}


def shown(target: str) -> str:
    """`target` as it may be told."""
    known = public_parameters(target)
    if "service" in known:
        return f"service={known['service']}"
    user = f"{known['user']}@" if "user" in known else ""
    port = f":{known['port']}" if "port" in known else ""
    return f"postgresql://{user}{known.get('host', '')}{port}/{known.get('dbname', '')}"


@contextmanager
def connected(target: str) -> Iterator[psycopg.Connection[Any]]:
    """A connection, whose every error comes in three lines.

    Raises:
        InputError: if there is no such server or database, or it wants another password.
        RefusedError: if the user has no right to do what is done, or somebody else is at work for long.
        FurrowmapError: of whatever else the database says.
    """
    name = shown(target)
    try:
        patience_s = conninfo_to_dict(target).get("connect_timeout", _CONNECT_S)
        connection = psycopg.connect(target, connect_timeout=patience_s)
    except psycopg.Error as error:
        raise _no_way(name, error) from None
    with connection:
        try:
            yield connection
        except psycopg.Error as error:
            raise _told(name, error) from None


def _no_way(name: str, error: psycopg.Error) -> InputError:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    last = lines[-1] if lines else type(error).__name__
    if "password" in last or "authentication" in last:
        return InputError(
            f"{name}: {last}.",
            "The database does not let you in, so nothing was done.",
            "Put the right password into ~/.pgpass or the variable PGPASSWORD, and check the user's name.",
            code="base-password",
        )
    return InputError(
        f"{name}: {last}.",
        "The database cannot be reached, so nothing was done.",
        "Check the server, port and database, and that the server runs: `psql` with the same address shows it.",
        code="base-unreachable",
    )


def _told(name: str, error: psycopg.Error) -> FurrowmapError:
    message = error.diag.message_primary or str(error).splitlines()[0]
    if isinstance(error, psycopg.errors.InsufficientPrivilege):
        return RefusedError(
            f"{name}: {message}.",
            "You may not do that in this database, so it stays as it was.",
            "Ask its owner for it: GRANT CREATE ON DATABASE makes a new base possible, "
            "GRANT USAGE, CREATE ON SCHEMA and rights on its tables an old one.",
            code="base-no-right",
        )
    if isinstance(error, psycopg.errors.LockNotAvailable):
        return RefusedError(
            f"{name}: somebody else has been changing the base for long.",
            "Two at once could lose what one of them added, so nothing was done.",
            "Wait for the other one to end, and run the command again.",
            code="base-busy",
        )
    return FurrowmapError(
        f"{name}: {message.rstrip('.')}.",
        "The database refused a step, so the base stays as it was.",
        "Mend what it says there, and run the command again.",
        code="base-database",
    )
