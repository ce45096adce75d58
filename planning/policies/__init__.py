"""Policies by name: each makes a pair (select, place) for one scene. An ablation changes one word."""

from __future__ import annotations

from collections.abc import Callable

from planning.motion.pick_place import Motions
from planning.policies.local import Lines, make_local_object, make_local_region
from planning.policies.random import random_object, random_region
from planning.retrieval import Policy


def _local(motions: Motions) -> Policy:
    lines = Lines(motions)
    return Policy(make_local_object(lines), make_local_region(lines))


POLICIES: dict[str, Callable[[Motions], Policy]] = {
    "random": lambda motions: Policy(random_object, random_region),
    "local": _local,
}


def make_policy(name: str, motions: Motions) -> Policy:
    """The policy called `name` for the scene behind `motions`. Raises ValueError for an unknown name, listing the valid ones."""
    if name not in POLICIES:
        raise ValueError(f"unknown policy {name!r}: the policies are {', '.join(POLICIES)}")
    return POLICIES[name](motions)
