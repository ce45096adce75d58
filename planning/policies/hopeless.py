"""Why nothing is worth a long search: what keeps the target in is where the arm does not get to.

An object that can be taken hold of, as far as straight ways in and up say, may still stand where no path leads: in a low cabinet most hands
from above and aslant are in pockets of the arm's free space. If the arm gets to none of many picks of it while nothing else stands there
but the target and other objects of the kind, it stays, for more objects never make a path possible. What is left then is whether the target
can be taken among those that stay.

This is no proof: the picks are some of many, and that RRT-Connect finds no path does not mean that there is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinematics.scene import State
from planning.policies.search import World
from planning.relaxed_plan import NOTHING


def why_hopeless(looks: Sequence[World], state: State) -> str | None:
    """Why hardly any moves will be found from a state, in words; None where there is hope. looks: those with whose picks the arm may get
    to something; the first says what is in the target's way."""
    rng, staying = np.random.default_rng(0), NOTHING
    target = looks[0].scene.target_name

    def got_to(name: str) -> bool:
        there = State(state.q, {n: T for n, T in state.poses.items() if n in staying | {name, target}})
        return any(look.gets_to(there, name, rng) for look in looks)

    view = looks[0].obstructions(state.poses)
    in_the_way = sorted(NOTHING.union(*view.blockers(target, frozenset(state.poses) - {target})))
    while got_to(target):
        more = {name for name in in_the_way if name not in staying and not got_to(name)}
        if not more:
            return None
        staying |= more
    if not staying:
        return f"no way was found for the arm to get to {target} even if nothing else stood there"
    named = [name for name in sorted(staying) if not view.free(target, frozenset({name}))] or sorted(staying)
    return f"no way was found for the arm to get to {' or to '.join(named)} even if nothing else but {target} stood there"
