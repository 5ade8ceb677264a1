"""SQLite file of all measurements: opening, migration, and atomic writes by several programs.

Each entry is one transaction, which is committed and synced to the disk as soon as it is finished.
A crash therefore loses no finished entry. `transaction` joins several entries. The file uses
write-ahead logging: two flights can write while others read. Opening a file of an older version
migrates it in one transaction.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from skywright.errors import InputError
from skywright.inspection.history.schema import APPLICATION_ID, STEPS, VERSION

T = TypeVar("T")
BUSY_S = 10.0  # s, longest wait for another writer


class DatabaseFile:
    """An open database file. Every method raises InputError if SQLite reports an error."""

    _together = False
    """Whether the entries belong to the transaction of a block."""

    def __init__(self, path: Path, *, create: bool = False) -> None:
        """Open `path`, or create it if `create` is set; migrate a file of an older version.

        Raises InputError if the file does not exist, is not a database of inspection records, is
        damaged, has a newer version, is locked by another program, or cannot be written.
        """
        self.path = path
        if not create and not path.is_file():
            what = "is a folder" if path.is_dir() else "no such file"
            raise InputError(f"{path}: {what}; records are written by skywright run --records")
        if create and path.is_dir():
            raise InputError(f"{path}: is a folder; give a file for the records")
        if create and not path.parent.is_dir():
            raise InputError(f"{path}: the folder does not exist")
        self._db = self._try(
            lambda: sqlite3.connect(path, timeout=BUSY_S, isolation_level=None), "opened"
        )
        try:
            self._try(lambda: self._open(create), "opened")
        except BaseException:
            self._db.close()
            raise

    def _open(self, create: bool) -> None:
        db = self._db
        if create:
            self._log_ahead()
        db.execute("PRAGMA synchronous = FULL")
        db.execute("PRAGMA foreign_keys = ON")
        # one transaction: a file that another program is creating is seen complete or empty
        db.execute("BEGIN IMMEDIATE" if create else "BEGIN")
        owner, version = self._read_mark()
        empty = int(db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]) == 0
        if not (create and empty and owner == 0 and version == 0) and owner != APPLICATION_ID:
            raise InputError(f"{self.path}: is a database without inspection records")
        if version > VERSION:
            raise InputError(
                f"{self.path}: records of version {version}; this version of Skywright reads "
                f"versions 1 to {VERSION}: install a newer one"
            )
        if create:
            self._apply(version)
        db.execute("COMMIT")
        if version < VERSION and not create:
            self._migrate()

    def _log_ahead(self) -> None:
        """Switch to write-ahead logging; a file system without it keeps the rollback journal.

        SQLite waits for other programs in every operation except this one. It fails at once if
        another program switches the mode, or closes the file as its last user. Therefore the
        switch is repeated for up to BUSY_S.
        """
        until = time.monotonic() + BUSY_S
        while True:
            try:
                self._db.execute("PRAGMA journal_mode = WAL")
                return
            except sqlite3.OperationalError as error:
                if "locked" not in str(error) or time.monotonic() > until:
                    raise
                time.sleep(0.005)

    def _read_mark(self) -> tuple[int, int]:
        db = self._db
        return (
            int(db.execute("PRAGMA application_id").fetchone()[0]),
            int(db.execute("PRAGMA user_version").fetchone()[0]),
        )

    def _migrate(self) -> None:
        """Migrate the file to the current version in one transaction."""
        self._db.execute("BEGIN IMMEDIATE")
        self._apply(self._read_mark()[1])  # another program may have migrated it meanwhile
        self._db.execute("COMMIT")

    def _apply(self, version: int) -> None:
        """Execute the migration steps from `version` to the current one."""
        if version >= VERSION:
            return
        for step in STEPS[version:]:
            for statement in step:
                self._db.execute(statement)
        self._db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        self._db.execute(f"PRAGMA user_version = {VERSION}")

    def close(self) -> None:
        """Close the file."""
        self._db.close()

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Store all entries of the block in one transaction, or none if the block fails."""
        self._together = True
        try:
            self._try(lambda: self._db.execute("BEGIN IMMEDIATE"), "written")
            yield
            self._try(lambda: self._db.execute("COMMIT"), "written")
        finally:
            self._together = False
            self._end_transaction()

    def write(self, *statements: tuple[str, Sequence[object]]) -> int:
        """Execute statements in one transaction; return the row id of the last one.

        `:last` in the values of a statement stands for the row id of the previous statement.
        """

        def work() -> int:
            self._begin()
            last = 0
            for sql, values in statements:
                given = [last if v == ":last" else v for v in values]
                last = self._db.execute(sql, given).lastrowid or 0
            self._commit()
            return last

        return self._try(work, "written")

    def read(self, sql: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        """Return the rows of a query."""
        return self._try(lambda: self._db.execute(sql, values).fetchall(), "read")

    def keep(self, table: str, keys: Mapping[str, object], more: Mapping[str, object]) -> int:
        """Insert or update the entry with these `keys`; return its row id.

        `more` gives the other columns. A value of None in `more` keeps the stored value.
        """
        given = {k: v for k, v in more.items() if v is not None}
        names = [*keys, *given]
        update = ", ".join(f"{k} = excluded.{k}" for k in given) or f"{names[0]} = {names[0]}"
        sql = (
            f"INSERT INTO {table} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))})"
            f" ON CONFLICT ({', '.join(keys)}) DO UPDATE SET {update} RETURNING rowid"
        )

        def work() -> int:
            self._begin()
            row = int(self._db.execute(sql, [*keys.values(), *given.values()]).fetchone()[0])
            self._commit()
            return row

        return self._try(work, "written")

    def _begin(self) -> None:
        if not self._together:
            self._db.execute("BEGIN IMMEDIATE")

    def _commit(self) -> None:
        if not self._together:
            self._db.execute("COMMIT")

    def _try(self, action: Callable[[], T], what: str) -> T:
        """Return the result of `action`; turn an error of SQLite into an InputError."""
        try:
            return action()
        except sqlite3.Error as error:
            text = str(error)
            if "locked" in text:
                text = f"another program has locked it for {BUSY_S:g} s"
            elif "not a database" in text:
                text = "it is not a SQLite database"
            elif "malformed" in text:
                text = "it is damaged; sqlite3 FILE .recover may save what is left"
            elif "full" in text:
                text = "the disk is full"
            elif "readonly" in text:
                text = "it cannot be written, which a file of an older version requires"
            raise InputError(f"{self.path}: records cannot be {what}: {text}") from None
        finally:
            if hasattr(self, "_db") and not self._together:
                self._end_transaction()

    def _end_transaction(self) -> None:
        """Roll back a transaction that is still open."""
        try:
            if self._db.in_transaction:
                self._db.rollback()
        except sqlite3.ProgrammingError:  # the connection is closed
            pass


def stamp(t: datetime) -> str:
    """Return a time in UTC as ISO 8601 with milliseconds and Z."""
    return t.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def parse_stamp(text: str, what: str) -> datetime:
    """Parse an ISO 8601 time; return it in UTC.

    A date alone means midnight. A time without a zone is in UTC. Raises InputError, which begins
    with `what`, if `text` is not a time.
    """
    try:
        t = datetime.fromisoformat(text.strip())
        return t.replace(tzinfo=UTC) if t.tzinfo is None else t.astimezone(UTC)
    except (ValueError, OverflowError):  # the latter at the ends of the calendar
        raise InputError(
            f"{what}: {text[:40]!r} is no time; valid: ISO 8601, such as 2026-03-01T12:00:00Z"
        ) from None
