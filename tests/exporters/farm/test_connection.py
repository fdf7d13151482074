"""Connections to PostGIS: what is told of them, and which error of the database is which of ours."""

from __future__ import annotations

import pytest
from psycopg import errors
from psycopg.conninfo import conninfo_to_dict

from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError, UsageError
from furrowmap.exporters.farm.postgis import (
    _database_error,
    _unreachable,
    connected,
    public_name,
    public_parameters,
)

SECRET = "hunter2"


@pytest.mark.parametrize(
    ("target", "name"),
    [
        (f"postgresql://me:{SECRET}@server:5433/farm", "postgresql://me@server:5433/farm"),
        (f"postgresql://server/farm?user=me&password={SECRET}", "postgresql://me@server/farm"),
        ("postgresql://server/farm", "postgresql://server/farm"),
        (f"host=server dbname=farm password={SECRET}", "postgresql://server/farm"),
        (f"host=server user=me port=5432 passfile={SECRET} sslkey={SECRET}", "postgresql://me@server:5432/"),
        (f"service=farm password={SECRET}", "service=farm"),
    ],
)
def test_name__has_all_but_what_is_secret(target: str, name: str) -> None:
    assert public_name(target) == name
    known = public_parameters(target)
    assert known == {key: value for key, value in conninfo_to_dict(target).items() if key in known}
    assert SECRET not in str(known)


@pytest.mark.parametrize("target", [f"postgresql://me:{SECRET}@server:54 33/farm", f"host='server password={SECRET}"])
def test_target__that_is_none_is_refused_without_its_password(target: str) -> None:
    for call in (public_parameters, public_name, lambda target: connected(target).__enter__()):
        with pytest.raises(UsageError, match="not a valid PostgreSQL connection string") as refused:
            call(target)
        assert refused.value.code == "usage"
        assert SECRET not in str(refused.value)
        assert refused.value.__suppress_context__


@pytest.mark.parametrize("host", ["127.0.0.1", "/nowhere"])
def test_server__that_is_not_there(host: str) -> None:
    target = f"host={host} port=1 dbname=farm user=me password={SECRET} connect_timeout=2"
    with pytest.raises(InputError) as refused, connected(target):
        pass
    assert refused.value.code == "base-unreachable"
    assert refused.value.what.startswith(f"postgresql://me@{host}:1/farm: ")
    assert SECRET not in str(refused.value)


@pytest.mark.parametrize(
    ("said", "code"),
    [
        ('connection failed\nFATAL:  password authentication failed for user "me"\n', "base-password"),
        ("fe_sendauth: no password supplied", "base-password"),
        ("Peer authentication failed", "base-password"),
        ('FATAL:  database "farm" does not exist\n\n', "base-unreachable"),
        ("", "base-unreachable"),
    ],
)
def test_login__that_fails(said: str, code: str) -> None:
    error = _unreachable("server", errors.OperationalError(said))
    assert error.code == code
    last = [line.strip() for line in said.splitlines() if line.strip()][-1:] or ["OperationalError"]
    assert error.what == f"server: {' '.join(last[0].split())}."


@pytest.mark.parametrize(
    ("fault", "kind", "code", "words"),
    [
        (errors.InsufficientPrivilege("permission denied\nmore"), RefusedError, "base-no-right", "permission denied."),
        (errors.LockNotAvailable("lock timeout"), RefusedError, "base-busy", "another process has been changing"),
        (errors.DiskFull("no space left.\nmore"), FurrowmapError, "base-database", "server: no space left."),
    ],
)
def test_fault__of_the_database(fault: errors.Error, kind: type[FurrowmapError], code: str, words: str) -> None:
    error = _database_error("server", fault)
    assert type(error) is kind
    assert error.code == code
    assert words in error.what
    assert ".." not in error.what
