"""Policies by name: each makes a pair (select, place) for one scene. An ablation changes one word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from kinematics.errors import choose
from planning.learning.networks.model import FORMS, Model, shipped
from planning.motion.pick_place import Motions
from planning.policies.local import Lines, make_local_object, make_local_region
from planning.policies.lookahead import NEAREST, Lookahead
from planning.policies.neural import CachedEncoding, make_neural_object, make_neural_preferences, make_neural_region
from planning.policies.random import random_object, random_region
from planning.policies.rrt import CountedPaths, make_rrt_object, make_rrt_region
from planning.policies.search import Effort, Preferences
from planning.policies.unsolvable import Prover
from planning.retrieval import Policy
from planning.rules import MAX_MOVES

QUICK, PATIENT = Effort(attempts=300), Effort(attempts=3000, last=1000)
"""How many moves a policy that looks ahead may try; and how many the ceiling, which tries any regions at last."""
QUICK_FIRST = replace(QUICK, last=1000)
"""What `neural` may: where the quick tries have not done and there is hope, a third of what the ceiling may besides."""


@dataclass(frozen=True, eq=False)
class Setup:
    """What a policy is made of: the scene's motions, the moves that are allowed, and networks of a form, `objects` if none is named. A
    policy that asks no network never calls for one."""

    motions: Motions
    max_moves: int
    network: Callable[..., Model]


def _local(setup: Setup) -> Policy:
    lines = Lines(setup.motions)
    return Policy(make_local_object(lines), make_local_region(lines))


def _rrt(setup: Setup) -> Policy:
    paths = CountedPaths(setup.motions)
    return Policy(make_rrt_object(paths), make_rrt_region(paths))


def _look_ahead(setup: Setup, preferences: Preferences = NEAREST, effort: Effort = QUICK, *, glance: bool = False) -> Policy:
    ahead = Lookahead(setup.motions, preferences, effort, Prover(setup.motions), most=setup.max_moves, glance=glance)
    return Policy(ahead.select, ahead.place, lambda: ahead.outlook, ahead.certain, effort.choosy)


def _neural(setup: Setup) -> Policy:
    return _look_ahead(setup, make_neural_preferences(CachedEncoding(setup.network())), QUICK_FIRST, glance=True)


def _neural_greedy(setup: Setup, form: str | None = None) -> Policy:
    encoding = CachedEncoding(setup.network(form))
    return Policy(make_neural_object(encoding), make_neural_region(encoding))


def _osnet_only(setup: Setup, form: str | None = None) -> Policy:
    return Policy(make_neural_object(CachedEncoding(setup.network(form))), make_local_region(Lines(setup.motions)))


def _rpnet_only(setup: Setup, form: str | None = None) -> Policy:
    return Policy(make_local_object(Lines(setup.motions)), make_neural_region(CachedEncoding(setup.network(form))))


POLICIES: dict[str, Callable[[Setup], Policy]] = {
    "random": lambda setup: Policy(random_object, random_region),
    "local": _local,
    "rrt": _rrt,
    "lookahead": _look_ahead,
    "neural": _neural,
    "neural-greedy": _neural_greedy,
    "neural-paper": partial(_neural_greedy, form="paper"),
    "osnet-only": _osnet_only,
    "osnet-only-paper": partial(_osnet_only, form="paper"),
    "rpnet-only": _rpnet_only,
    "rpnet-only-paper": partial(_rpnet_only, form="paper"),
    "search": partial(_look_ahead, effort=PATIENT),
}


NETWORKS = tuple(name for name in POLICIES if name.startswith(("neural", "osnet", "rpnet")))
"""The policies that ask a model."""

LOOK_AHEAD = ("lookahead", "neural", "search")
"""The policies that may try motions while they choose: what they propose can be carried out, so all rules come to the same."""


def make_policy(name: str, motions: Motions, *, model: Model | None = None, max_moves: int = MAX_MOVES) -> Policy:
    """The policy called `name` for the scene behind `motions`, with so many moves to make at most.

    model: the networks of a policy that has some; by default those that ship for the robot.
    Raises: ValueError for an unknown name, listing the valid ones; for a robot without networks, or with those of another robot or form.
    """
    choose("policy", name, POLICIES)

    def network(form: str | None = None) -> Model:
        if model is None:
            return shipped(motions.robot.name, form or FORMS[0])
        if form not in (None, model.form):
            raise ValueError(f"the policy {name} asks networks of the form {form}, and this model's are of the form {model.form}")
        if model.robot != motions.robot.name:
            raise ValueError(f"the model was trained for the robot {model.robot}, and this scene's is {motions.robot.name}")
        return model

    return POLICIES[name](Setup(motions, max_moves, network))
