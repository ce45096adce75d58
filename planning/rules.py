"""The rules of the retrieval loop."""

from __future__ import annotations

from enum import StrEnum

MAX_MOVES = 5
"""How many objects may be moved, if nothing else is said; the paper's number."""


class Rule(StrEnum):
    """How far the loop falls through when a proposed move can't be carried out; in the order in which reports give them."""

    DEEP = "deep"  # objects in order, regions in order
    REGION = "region"  # the first object, its regions in order
    STRICT = "strict"  # the first object and its first region, or the step is lost
