"""Names that tell things apart."""

from __future__ import annotations

from collections.abc import Container
from itertools import chain, count


def free_name(name: str, taken: Container[str], first: int = 1) -> str:
    """The name, or where it is taken the name with the first number, from `first` on, that makes it one that is not: box_1."""
    return next(other for other in chain((name,), (f"{name}_{number}" for number in count(first))) if other not in taken)
