"""Messages out of the SQLite files of ROS 2 bags."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from velocal.capture.bag_message import MOST_BYTES, Content, Message, Topic, Unusable

MAGIC = b"SQLite format 3\0"


def messages(path: Path) -> Content:
    """Read the messages of a file by their times.

    Parameters
    ----------
    path : Path

    Yields
    ------
    Message or Unusable

    Raises
    ------
    sqlite3.Error
        If the file has not the two tables of a bag.
    """
    with _opened(path) as database:
        topics = _topics(database)
        rows = database.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
        )
        while True:
            try:
                row = rows.fetchone()
            except (sqlite3.Error, UnicodeError):
                yield Unusable("bag cut short or damaged", 1)
                return
            if row is None:
                return
            number, time_ns, data = row
            if number in topics and isinstance(data, bytes) and isinstance(time_ns, int):
                yield Message(topics[number], time_ns, data)
            else:
                yield Unusable("message of an unknown topic", len(data or b""))


def counted(path: Path) -> Counter[Topic]:
    """Count messages by topic.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Counter of Topic

    Raises
    ------
    sqlite3.Error
        If the file has not the two tables of a bag, or is damaged.
    """
    with _opened(path) as database:
        topics = _topics(database)
        found: Counter[Topic] = Counter(dict.fromkeys(topics.values(), 0))
        for number, n in database.execute(
            "SELECT topic_id, count(*) FROM messages GROUP BY topic_id"
        ):
            if number in topics:
                found[topics[number]] += n
        return found


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a file for reading only; what it defines besides its tables is not run."""
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
        database.execute("PRAGMA trusted_schema = OFF")
        # A view of the same name might never end.
        tables = {name for (name,) in database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'"
        )}  # fmt: skip
        if not {"topics", "messages"} <= tables:
            raise sqlite3.DatabaseError("it has no tables with the names topics and messages")
        yield database


def _topics(database: sqlite3.Connection) -> dict[int, Topic]:
    """Topics by their number."""
    rows = database.execute("SELECT id, name, type FROM topics").fetchall()
    return {number: Topic(str(name), str(type_), False) for number, name, type_ in rows}
