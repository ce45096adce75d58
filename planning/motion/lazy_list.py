"""What is found when asked for, and once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import count
from typing import Generic, TypeVar

T = TypeVar("T")


class LazyList(Generic[T]):
    """An iterable that may be gone through again and again, though what it stands for is costly: it goes only as far as somebody asked."""

    def __init__(self, rest: Iterable[T]) -> None:
        self._rest, self._found = iter(rest), list[T]()

    def __iter__(self) -> Iterator[T]:
        for i in count():
            if i == len(self._found):
                try:
                    self._found.append(next(self._rest))
                except StopIteration:
                    return
            yield self._found[i]
