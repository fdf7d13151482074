"""A PostgreSQL of the tests' own: its data in a temporary folder, its port a free one, gone when they end."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import psycopg
from psycopg import sql

PASSWORD = "s3cret/pä:ss"
SETTINGS = (
    "fsync = off\nfull_page_writes = off\nsynchronous_commit = off\nmax_connections = 20\nshared_buffers = 16MB\n"
)


@dataclass(frozen=True)
class Server:
    """A running server with PostGIS in the database `template_postgis`, from which others are made."""

    port: int

    def url(self, database: str, user: str = "farmer", password: str = PASSWORD) -> str:
        return f"postgresql://{user}:{quote(password, safe='')}@127.0.0.1:{self.port}/{database}"

    def administer(self, database: str = "postgres") -> psycopg.Connection:
        """A connection of the administrator."""
        return psycopg.connect(self.url(database, "admin"), autocommit=True)

    def new_database(self, name: str, template: str = "template_postgis") -> str:
        """The address of a new database of the farmer's."""
        with self.administer() as connection:
            connection.execute(
                sql.SQL("CREATE DATABASE {} TEMPLATE {} OWNER farmer").format(
                    sql.Identifier(name), sql.Identifier(template)
                )
            )
        return self.url(name)


@contextmanager
def running_server(programs: Path) -> Iterator[Server]:
    """A server from the programs in a folder; PostgreSQL refuses to run as root, so another user runs it there."""
    folder = Path(tempfile.mkdtemp(prefix="furrowmap-postgis-"))
    somebody = [] if os.getuid() else ["setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups"]
    if somebody:
        account = pwd.getpwnam("postgres")
        os.chown(folder, account.pw_uid, account.pw_gid)
    secret = folder / "password"
    secret.write_text(PASSWORD)
    secret.chmod(0o644)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]

    def do(program: str, *arguments: str | Path) -> None:
        command = [*somebody, programs / program, *arguments]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=folder, env={**os.environ, "LC_ALL": "C"}
        )
        assert done.returncode == 0, f"{program}: {done.stdout}{done.stderr}"

    data = folder / "data"
    try:
        do("initdb", "-D", data, "-U", "admin", "-A", "scram-sha-256", "--pwfile", secret, "--no-sync", "-E", "UTF8")
        with (data / "postgresql.conf").open("a") as file:
            file.write(f"{SETTINGS}port = {port}\nlisten_addresses = '127.0.0.1'\nunix_socket_directories = ''\n")
        # Its output goes to a file: a pipe would stay open as long as the server runs.
        do("pg_ctl", "-D", data, "-l", folder / "log", "-w", "-t", "30", "start")
        try:
            server = Server(port)
            with server.administer() as connection:
                connection.execute(sql.SQL("CREATE ROLE farmer LOGIN PASSWORD {}").format(PASSWORD))
                connection.execute("CREATE DATABASE template_postgis")
            with server.administer("template_postgis") as connection:
                connection.execute("CREATE EXTENSION postgis")
            yield server
        finally:
            do("pg_ctl", "-D", data, "-m", "immediate", "-w", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
