"""How many threads the linear algebra of an adjustment has."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_thread() -> Iterator[None]:
    """Let the linear algebra work in one thread; a context, or a decorator of functions.

    Notes
    -----
    The matrices of a unit are small, a hundred rows or some hundreds. Several threads wait for
    each other longer than they compute: with two of them an adjustment took three times as long,
    and a plan five times. With one thread the results are also the same on every machine with the
    same kind of processor, however many it has.
    """
    with threadpool_limits(1, user_api="blas"):
        yield
