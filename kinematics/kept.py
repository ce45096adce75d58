"""Dictionaries of which only so many entries are kept, for each takes memory."""

from __future__ import annotations

from typing import Any


def forget_oldest(kept: dict[Any, Any], most: int) -> None:
    """Make room for another entry in what keeps so many: the one that was put in first goes."""
    if len(kept) >= most:
        kept.pop(next(iter(kept)))
