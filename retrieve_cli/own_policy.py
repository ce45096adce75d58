"""A policy of the user's own, MODULE:FUNCTION, for `retrieve plan --policy`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeGuard

from kinematics.errors import OptionError
from retrieve_cli.own_code import answering, own_function

if TYPE_CHECKING:
    from perception.observation import Observation
    from planning.motion.pick_place import Motions
    from planning.retrieval import Policy


def is_own(policy: str | None) -> TypeGuard[str]:
    """Whether a policy is named as MODULE:FUNCTION."""
    return policy is not None and ":" in policy


@lru_cache(maxsize=4)
def own_policy(spec: str) -> Callable[[Motions], Policy]:
    """FUNCTION(motions) of MODULE, which returns a `planning.Policy`: what its parts raise, and propose that is not there, is told.

    It bears the function's name. Raises: InputError when there is none; in use OptionError, for no scene is to blame.
    """
    where, make = f"--policy {spec}", own_function("--policy", spec)

    def made(motions: Motions) -> Policy:
        from planning.retrieval import Policy

        with answering(where, OptionError):
            policy = make(motions)
        if not isinstance(policy, Policy):
            raise OptionError(f"{where}: returned a {type(policy).__name__}, and a planning.Policy is expected")

        def select(seen: Observation, rng: Any) -> Iterator[str]:
            return _known(f"{where}: select", lambda: policy.select(seen, rng), seen.movable, "an object that can be moved")

        def place(seen: Observation, name: str, rng: Any) -> Iterator[int]:
            return _known(f"{where}: place", lambda: policy.place(seen, name, rng), range(len(seen.regions)), "the number of a region")

        return replace(policy, select=select, place=place)

    made.__name__ = spec.rpartition(":")[2]
    return made


def _known(where: str, proposals: Callable[[], Iterable[Any]], valid: Iterable[Any], what: str) -> Iterator[Any]:
    """The proposals one by one. Raises: OptionError for what they raise, and for one that is not valid."""
    known = frozenset(valid)
    with answering(where, OptionError):
        for proposal in proposals():
            if proposal not in known:
                raise OptionError(f"{where}: {proposal!r} is not {what}")
            yield proposal
