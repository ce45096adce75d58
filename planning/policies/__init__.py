"""Policies by name: each makes a pair (select, place) for one scene. An ablation changes one word."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from planning.learning.model import FORMS, Model, shipped
from planning.motion.pick_place import Motions
from planning.policies.local import Lines, make_local_object, make_local_region
from planning.policies.neural import CachedEncoding, make_neural_object, make_neural_region
from planning.policies.random import random_object, random_region
from planning.policies.search import Plans, make_search_object, make_search_region
from planning.retrieval import Policy

NetworkOf = Callable[..., Model]  # of a form, `objects` if none is named; a policy that asks no network never calls it


def _local(motions: Motions, network: NetworkOf) -> Policy:
    lines = Lines(motions)
    return Policy(make_local_object(lines), make_local_region(lines))


def _search(motions: Motions, network: NetworkOf) -> Policy:
    plans = Plans(motions)
    return Policy(make_search_object(plans), make_search_region(plans))


def _neural(motions: Motions, network: NetworkOf) -> Policy:
    encoding = CachedEncoding(network())
    return Policy(make_neural_object(encoding), make_neural_region(encoding))


def _neural_paper(motions: Motions, network: NetworkOf) -> Policy:
    return _neural(motions, partial(network, "paper"))


def _osnet_only(motions: Motions, network: NetworkOf) -> Policy:
    return Policy(make_neural_object(CachedEncoding(network())), make_local_region(Lines(motions)))


def _rpnet_only(motions: Motions, network: NetworkOf) -> Policy:
    return Policy(make_local_object(Lines(motions)), make_neural_region(CachedEncoding(network())))


POLICIES: dict[str, Callable[[Motions, NetworkOf], Policy]] = {
    "random": lambda motions, network: Policy(random_object, random_region),
    "local": _local,
    "neural": _neural,
    "neural-paper": _neural_paper,
    "osnet-only": _osnet_only,
    "rpnet-only": _rpnet_only,
    "search": _search,
}


NETWORKS = ("neural", "neural-paper", "osnet-only", "rpnet-only")
"""The policies that ask a model."""


def make_policy(name: str, motions: Motions, *, model: Model | None = None) -> Policy:
    """The policy called `name` for the scene behind `motions`.

    model: the networks of a policy that has some; by default those that ship for the robot.
    Raises: ValueError for an unknown name, listing the valid ones; for a robot without networks, or with those of another robot or form.
    """
    if name not in POLICIES:
        raise ValueError(f"unknown policy {name!r}: the policies are {', '.join(POLICIES)}")

    def network(form: str | None = None) -> Model:
        if model is None:
            return shipped(motions.robot.name, form or FORMS[0])
        if form not in (None, model.form):
            raise ValueError(f"the policy {name} asks networks of the form {form}, and this model's are of the form {model.form}")
        if model.robot != motions.robot.name:
            raise ValueError(f"the model was trained for the robot {model.robot}, and this scene's is {motions.robot.name}")
        return model

    return POLICIES[name](motions, network)
