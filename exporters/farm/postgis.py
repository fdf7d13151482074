"""A farm map in PostGIS, which several people can share; :mod:`.geopackage` has the same operations."""

import datetime as dt
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray
from psycopg.conninfo import conninfo_to_dict
from psycopg.sql import SQL, Composable, Composed, Identifier
from pyproj import CRS

from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice, RefusedError, UsageError
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.farm.edit import (
    KNOWN_COLUMNS,
    LAYER_SETTING,
    SCHEMA,
    SETTINGS,
    STYLE_BY,
    KnownSession,
    check_schema,
    chosen_columns,
    column_type,
    content_hash,
    is_due,
    row_of,
)
from furrowmap.exporters.farm.farm_results import SESSIONS
from furrowmap.exporters.farm.project import PROJECT, project_metadata
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array
from furrowmap.exporters.vectors.geopackage import GEOMETRY

_CONNECT_S: Final = 10
_PUBLIC: Final = ("service", "host", "hostaddr", "port", "dbname", "user", "sslmode")
"""Parameters without secrets, shown in messages and stored in projects: each user has a password of their own."""


def public_parameters(target: str) -> dict[str, str]:
    """The parameters of a connection string that are not secret."""
    try:
        parameters = conninfo_to_dict(target)
    except psycopg.Error:  # whose text may repeat the password
        raise UsageError("usage.connection-string") from None
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


_PATIENCE: Final = "60s"
_SQL_TYPES: Final = {
    "f": "double precision", "i": "bigint", "u": "bigint", "b": "boolean", "O": "text", "D": "date", "M": "timestamptz",
}  # fmt: skip


@contextmanager
def postgis_edit(target: str, *, create: bool = False, schema: str = "furrowmap") -> "Iterator[PostgisEdit]":
    """Change the farm map in a database within one transaction; other processes of furrowmap wait."""
    with connected(target) as connection, connection.transaction():
        connection.execute(SQL("SET LOCAL lock_timeout = {}").format(_PATIENCE))
        connection.execute("SELECT pg_advisory_xact_lock(hashtext('furrowmap'), hashtext(%s))", (schema,))
        edit = PostgisEdit(connection, schema, public_parameters(target), public_name(target))
        edit.begin(create=create)
        yield edit


class PostgisEdit:
    """A change of a farm map in a database: all of it takes place, or nothing."""

    def __init__(self, connection: psycopg.Connection[Any], schema: str, parameters: dict[str, str], name: str) -> None:
        self._connection = connection
        self._schema = schema
        self._parameters = parameters
        self._name = name
        self._extension = ""  # its schema

    def begin(self, *, create: bool) -> None:
        """Check that the database has PostGIS and a farm map of this version, or create that."""
        extension = self._one(
            "SELECT nspname FROM pg_extension JOIN pg_namespace n ON n.oid = extnamespace WHERE extname = 'postgis'"
        )
        if extension is None:
            raise InputError("base-no-postgis", name=self._name)
        self._extension = str(extension)
        if not self._has(SETTINGS):
            if not create:
                raise InputError("base-missing.empty-schema", name=self._name, schema=self._schema)
            if self._one("SELECT to_regnamespace(quote_ident(%s))", self._schema) is None:
                self._do(SQL("CREATE SCHEMA {}").format(Identifier(self._schema)))
            self._do(SQL("CREATE TABLE {} (name text PRIMARY KEY, value text)").format(self._table(SETTINGS)))
            self.store_setting("schema", str(SCHEMA))
        check_schema(self._name, self.setting("schema"), "with --schema")

    def name(self) -> str:
        """Address of the database without its password, and the schema."""
        return f"{self._name} (schema {self._schema})"

    def file(self) -> Path | None:
        """The file of the farm map; None for one in a database."""
        return None

    def crs(self) -> CRS | None:
        """Of all layers; None for a new farm map."""
        if not self._has(SESSIONS):
            return None
        query = SQL(
            "SELECT auth_name, auth_srid, srtext FROM {0}.spatial_ref_sys s JOIN {0}.geometry_columns g USING (srid) "
            "WHERE f_table_schema = %s AND f_table_name = %s"
        ).format(Identifier(self._extension))
        row = self._connection.execute(query, (self._schema, SESSIONS)).fetchone()
        assert row is not None
        return CRS.from_authority(row[0], row[1]) if row[0] else CRS.from_wkt(row[2])

    def sessions(self) -> list[KnownSession]:
        """The sessions in order of time."""
        if not self._has(SESSIONS):
            return []
        query = SQL('SELECT {} FROM {} s JOIN {} p USING (session) ORDER BY s."start", s.session').format(
            SQL(KNOWN_COLUMNS), self._table(SESSIONS), self._table("provenance")
        )
        return [row_of(row) for row in self._connection.execute(query).fetchall()]

    def remove(self, sessions: Sequence[str]) -> None:
        """Remove sessions, given by their identities, from all layers."""
        if sessions:  # the rows of the other tables follow by their foreign keys
            query = SQL("DELETE FROM {} WHERE session = ANY(%s)").format(self._table(SESSIONS))
            self._connection.execute(query, (list(sessions),))

    def append(self, layer: Layer, crs: CRS) -> None:
        """Append features to a layer; a missing layer or column is created."""
        if layer.name in self.layers():
            for name in layer.columns.keys() - self.columns(layer.name):
                self._do(SQL("ALTER TABLE {} ADD COLUMN {}").format(self._table(layer.name), self._column(layer, name)))
        else:
            self._create(layer, crs)
        names = [*([GEOMETRY] if layer.kind else []), *layer.columns]
        cells = [_cells(values) for values in layer.columns.values()]
        if layer.kind:
            shapes = shapely.set_srid(layer.shapes, self._srid(crs))
            with_height = layer.kind.startswith("2.5D")
            wkb = shapely.to_wkb(shapes, hex=True, output_dimension=3 if with_height else 2, include_srid=True)
            cells.insert(0, list(wkb))
        columns = SQL(", ").join(Identifier(name) for name in names)
        copying = SQL("COPY {} ({}) FROM STDIN").format(self._table(layer.name), columns)
        with self._connection.cursor() as cursor, cursor.copy(copying) as copy:
            for row in zip(*cells, strict=True):
                copy.write_row(row)

    def layers(self) -> dict[str, str]:
        """Geometry type (as OGR calls it, empty for tables) of each layer of furrowmap, by name."""
        query = SQL(
            "SELECT substr(name, {}), value FROM {} JOIN information_schema.tables "
            "ON table_schema = %s AND name = {} || table_name"
        ).format(len(LAYER_SETTING) + 1, self._table(SETTINGS), LAYER_SETTING)
        return dict(self._connection.execute(query, (self._schema,)).fetchall())

    def read(self, layer: str, columns: Sequence[str]) -> Layer:
        """Features of a layer with some of its columns; those that it does not have are None or nan throughout."""
        kind = self.layers().get(layer)
        empty = Layer(layer, kind or "", "", np.empty(0, object), {})
        if kind is None:
            return chosen_columns(empty, columns)
        existing = self.columns(layer)
        there = [name for name in columns if name in existing]
        shape = (
            SQL("{}.ST_AsBinary({})").format(Identifier(self._extension), Identifier(GEOMETRY)) if kind else SQL("NULL")
        )
        parts = [shape, *map(Identifier, there)]
        query = SQL("SELECT {} FROM {} ORDER BY fid").format(SQL(", ").join(parts), self._table(layer))
        rows = self._connection.execute(query).fetchall()
        cells = list(zip(*rows, strict=True)) if rows else [()] * len(parts)
        shapes = geometry_array(shapely.from_wkb([None if wkb is None else bytes(wkb) for wkb in cells[0]]))
        values: Columns = {name: _array(column) for name, column in zip(there, cells[1:], strict=True)}
        return chosen_columns(replace(empty, shapes=shapes, columns=values), columns)

    def rewrite(self, layer: Layer, crs: CRS) -> None:
        """Replace all features of a layer; a missing layer or column is created."""
        if layer.name in self.layers():
            self._do(SQL("DELETE FROM {}").format(self._table(layer.name)))
        if len(layer.shapes):
            self.append(layer, crs)

    def setting(self, name: str) -> str | None:
        """A setting of the farm map; None where it was never stored."""
        found = self._one(SQL("SELECT value FROM {} WHERE name = %s").format(self._table(SETTINGS)), name)
        return None if found is None else str(found)

    def store_setting(self, name: str, value: str) -> None:
        """Store a setting of the farm map."""
        query = SQL("INSERT INTO {} VALUES (%s, %s) ON CONFLICT (name) DO UPDATE SET value = excluded.value")
        self._connection.execute(query.format(self._table(SETTINGS)), (name, value))

    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east and north bound of all sessions."""
        query = SQL(
            "SELECT min({0}.ST_XMin({1})), min({0}.ST_YMin({1})), max({0}.ST_XMax({1})), max({0}.ST_YMax({1})) FROM {2}"
        ).format(Identifier(self._extension), Identifier(GEOMETRY), self._table(SESSIONS))
        row = self._connection.execute(query).fetchone()
        assert row is not None
        west, south, east, north = (float(value or 0.0) for value in row)
        return west, south, east, north

    def source(self, layer: str, kind: str) -> tuple[str, str]:
        """QGIS's provider of a layer, and its data source as seen from the stored project."""
        known = {"dbname": self._connection.info.dbname} | self._parameters
        escapes = str.maketrans({"\\": "\\\\", "'": "\\'"})
        words = [*(f"{name}='{value.translate(escapes)}'" for name, value in known.items()), "key='fid'"]
        if kind:
            crs = self.crs()
            assert crs is not None
            words += [f"srid={self._srid(crs)}", f"type={_postgis_kind(kind)}"]
        schema = self._schema.replace('"', '""')
        words.append(f'table="{schema}"."{layer}"' + (f" ({GEOMETRY})" if kind else ""))
        return "postgres", " ".join(words)

    def store_styles(self, styles: dict[str, str]) -> tuple[Notice, ...]:
        """Store the styles of layers where QGIS looks for them; one that a user has changed stays."""
        try:
            with self._connection.transaction():
                if self._one("SELECT to_regclass('layer_styles')") is None:
                    self._do(SQL(_STYLES_TABLE))
                for name, text in styles.items():
                    self._store_style(name, text)
        except psycopg.errors.InsufficientPrivilege:
            return (Notice("base-no-styles", project=PROJECT, schema=self._schema),)
        return ()

    def store_project(self, archive: bytes) -> None:
        """Store the project where QGIS looks for it; one that a user has changed stays."""
        table = self._table("qgis_projects")
        columns = "(name text PRIMARY KEY, metadata jsonb, content bytea)"
        self._do(SQL("CREATE TABLE IF NOT EXISTS {} {}").format(table, SQL(columns)))
        stored = self._one(SQL("SELECT content FROM {} WHERE name = %s").format(table), PROJECT)
        if not is_due(None if stored is None else bytes(stored), archive, self.setting("project")):
            return
        metadata = project_metadata(self._connection.info.user)
        query = SQL(
            "INSERT INTO {} VALUES (%s, %s, %s) "
            "ON CONFLICT (name) DO UPDATE SET metadata = excluded.metadata, content = excluded.content"
        ).format(table)
        self._connection.execute(query, (PROJECT, metadata, archive))
        self.store_setting("project", content_hash(archive))

    def _create(self, layer: Layer, crs: CRS) -> None:
        if self._has(layer.name):
            raise RefusedError("base-clash.foreign-table", database=self.name(), layer=layer.name)
        table = self._table(layer.name)
        parts: list[Composable] = [SQL("fid bigint GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY")]
        if layer.kind:
            kind = SQL("{}.geometry({}, {})").format(
                Identifier(self._extension), SQL(_postgis_kind(layer.kind)), self._srid(crs)
            )
            parts.append(SQL("{} {}").format(Identifier(GEOMETRY), kind))
        parts += [self._column(layer, name) for name in layer.columns]
        self._do(SQL("CREATE TABLE {} ({})").format(table, SQL(", ").join(parts)))
        self._do(SQL("COMMENT ON TABLE {} IS {}").format(table, layer.description))
        if layer.kind:
            self._do(SQL("CREATE INDEX ON {} USING gist ({})").format(table, Identifier(GEOMETRY)))
        if layer.name != SESSIONS and "session" in layer.columns:
            self._do(SQL("CREATE INDEX ON {} (session)").format(table))
        self.store_setting(f"{LAYER_SETTING}{layer.name}", layer.kind)

    def _column(self, layer: Layer, name: str) -> Composable:
        column = SQL("{} {}").format(Identifier(name), SQL(column_type(layer.columns[name], _SQL_TYPES)))
        if name != "session":
            return column
        if layer.name == SESSIONS:
            return SQL("{} NOT NULL UNIQUE").format(column)
        return SQL("{} NOT NULL REFERENCES {} (session) ON DELETE CASCADE").format(column, self._table(SESSIONS))

    def columns(self, layer: str) -> set[str]:
        """Names of the columns of a layer's table."""
        query = "SELECT column_name FROM information_schema.columns WHERE table_schema = %s AND table_name = %s"
        return {row[0] for row in self._connection.execute(query, (self._schema, layer)).fetchall()}

    def _store_style(self, name: str, text: str) -> None:
        where = (self._connection.info.dbname, self._schema, name, name)
        rows = self._connection.execute(_STYLE_QUERY, where).fetchall()
        number, stored = rows[0] if rows else (None, None)
        if not is_due(stored, text, self.setting(f"style {name}")):
            return
        if rows:
            self._connection.execute("UPDATE layer_styles SET styleqml = %s WHERE id = %s", (text, number))
        else:
            geometry = GEOMETRY if self.layers()[name] else None
            self._connection.execute(_STYLE_INSERT, (*where, geometry, text, STYLE_BY))
        (_, stored), *_ = self._connection.execute(_STYLE_QUERY, where).fetchall()
        self.store_setting(f"style {name}", content_hash(stored))

    def _srid(self, crs: CRS) -> int:
        """PostGIS's number of a CRS."""
        code = crs.to_epsg()
        known = SQL("SELECT srid FROM {}.spatial_ref_sys WHERE auth_name = 'EPSG' AND auth_srid = %s")
        srid = None if code is None else self._one(known.format(Identifier(self._extension)), code)
        if srid is None:
            raise RefusedError("base-crs.unknown-to-postgis", name=self._name, crs=name_of(crs))
        return int(srid)

    def _table(self, name: str) -> Identifier:
        return Identifier(self._schema, name)

    def _has(self, name: str) -> bool:
        query = (
            "SELECT 1 FROM pg_class c JOIN pg_namespace n ON n.oid = relnamespace WHERE nspname = %s AND relname = %s"
        )
        return self._one(query, self._schema, name) is not None

    def _do(self, statement: SQL | Composed) -> None:
        self._connection.execute(statement)

    def _one(self, query: Any, *values: object) -> Any:
        """The first value of the first row; None if there is no row."""
        row = self._connection.execute(query, values or None).fetchone()
        return None if row is None else row[0]


_STYLES_TABLE: Final = """\
CREATE TABLE layer_styles (
 id serial PRIMARY KEY, f_table_catalog varchar, f_table_schema varchar, f_table_name varchar,
 f_geometry_column varchar, styleName text, styleQML xml, styleSLD xml, useAsDefault boolean, description text,
 owner varchar(63) DEFAULT CURRENT_USER, ui xml, update_time timestamp DEFAULT CURRENT_TIMESTAMP, type varchar)"""
"""As QGIS makes it."""
_STYLE_QUERY: Final = (
    "SELECT id, styleqml::text FROM layer_styles "
    "WHERE f_table_catalog = %s AND f_table_schema = %s AND f_table_name = %s AND stylename = %s"
)
_STYLE_INSERT: Final = (
    "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, stylename, f_geometry_column, styleqml, "
    "description, useasdefault) VALUES (%s, %s, %s, %s, %s, %s, %s, true)"
)


def _postgis_kind(kind: str) -> str:
    return f"{kind.removeprefix('2.5D ')}Z" if kind.startswith("2.5D ") else kind


def _cells(values: NDArray[Any]) -> list[Any]:
    """The values as Python objects; None for masked values, nan and NaT."""
    data = np.ma.getdata(values)
    missing = np.ma.getmaskarray(values).copy()
    if data.dtype.kind in "fM":
        missing |= np.isnan(data)
    cells = data.tolist()
    if data.dtype == "datetime64[ms]":
        cells = [cell and cell.replace(tzinfo=dt.UTC) for cell in cells]
    return [None if empty else cell for cell, empty in zip(cells, missing.tolist(), strict=True)]


def _array(values: Sequence[Any]) -> NDArray[Any]:
    """A column as an array: times as datetime64 in UTC, all else as objects."""
    if any(isinstance(value, dt.datetime) for value in values):
        return np.array([value and value.astimezone(dt.UTC).replace(tzinfo=None) for value in values], "datetime64[ms]")
    return np.array(values, object)
