"""Dictionaries of which only so many entries are kept, for each takes memory."""

from __future__ import annotations

from typing import Any


def evict_oldest(kept: dict[Any, Any], most: int) -> None:
    """Make room for another entry in a dictionary that keeps `most`: the one that was put in first goes."""
    if len(kept) >= most:
        kept.pop(next(iter(kept)))
