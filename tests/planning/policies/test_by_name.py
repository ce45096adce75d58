"""Policies by name: which halves each is made of, which networks it asks, and what is said where there are none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from planning import policies
from planning.learning.networks.model import Model
from planning.policies import LOOK_AHEAD, NEAREST, NETWORKS, POLICIES, Effort, make_policy

MOTIONS: Any = SimpleNamespace(robot=SimpleNamespace(name="ur5e"))
OBJECTS, PAPER, OTHERS = (
    Model(form, robot, 4, {}, {}, {}) for form, robot in (("objects", "ur5e"), ("paper", "ur5e"), ("objects", "gen3"))
)


@pytest.fixture(autouse=True)
def named_halves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Halves, lines and encodings are told by their names and by what they rest on; so are the networks that ship."""
    halves = [f"make_{which}_{half}" for which in ("local", "neural", "rrt") for half in ("object", "region")]
    for name in (*halves, "make_neural_preferences", "Lines", "CachedEncoding", "CountedPaths", "Prover"):
        monkeypatch.setattr(policies, name, lambda basis, name=name: (name, basis))
    for name in ("random_object", "random_region"):
        monkeypatch.setattr(policies, name, name)
    monkeypatch.setattr(policies, "Lookahead", Ahead)
    monkeypatch.setattr(policies, "shipped", lambda robot, form: f"{form} networks of {robot}")


class Ahead:
    """Stands for `Lookahead`: remembers what it is made of."""

    def __init__(self, *made_of: Any, **options: Any) -> None:
        self.made_of, self.options, self.outlook = made_of, options, "the outlook at first"

    def select(self) -> None: ...
    def place(self) -> None: ...
    def certain(self) -> None: ...


LINES = ("Lines", MOTIONS)
LOCAL = (("make_local_object", LINES), ("make_local_region", LINES))


def neural(networks: object) -> tuple[Any, Any]:
    encoding = ("CachedEncoding", networks)
    return ("make_neural_object", encoding), ("make_neural_region", encoding)


def halves(name: str, **given: Any) -> tuple[Any, Any]:
    policy = make_policy(name, MOTIONS, **given)
    return policy.select, policy.place


def test_the_baselines_ask_no_network() -> None:
    for given in ({}, {"model": OTHERS}):
        assert halves("random", **given) == ("random_object", "random_region")
        assert halves("local", **given) == LOCAL


def test_the_rrt_baseline_counts_paths_once_for_both_halves() -> None:
    paths = ("CountedPaths", MOTIONS)
    assert halves("rrt") == (("make_rrt_object", paths), ("make_rrt_region", paths))


@pytest.mark.parametrize(
    ("name", "preferences", "effort", "glance"),
    [
        ("lookahead", NEAREST, Effort(attempts=300), False),
        ("search", NEAREST, Effort(attempts=3000, last=1000), False),
        ("neural", ("make_neural_preferences", ("CachedEncoding", "objects networks of ur5e")), Effort(attempts=300, last=1000), True),
    ],
)
def test_what_looks_ahead(name: str, preferences: Any, effort: Effort, glance: bool) -> None:
    """One look for both halves, and for what is known of the scene in the end; a proof may come to it; so many moves are allowed."""
    for given, most in (({}, 5), ({"max_moves": 3}, 3)):
        policy = make_policy(name, MOTIONS, **given)  # type: ignore[arg-type]
        ahead: Any = policy.select.__self__  # type: ignore[attr-defined]
        assert ahead.made_of == (MOTIONS, preferences, effort, ("Prover", MOTIONS))
        assert ahead.options == {"most": most, "glance": glance}
        assert (policy.select, policy.place) == (ahead.select, ahead.place)
        ahead.outlook = "the outlook later"
        assert policy.certain == ahead.certain
        assert policy.outlook() == "the outlook later"  # type: ignore[comparison-overlap]
    assert set(LOOK_AHEAD) == {"lookahead", "neural", "search"}


def test_the_ablations_are_half_and_half() -> None:
    select, place = neural("objects networks of ur5e")
    assert halves("osnet-only") == (select, LOCAL[1])
    assert halves("rpnet-only") == (LOCAL[0], place)
    select, place = neural(OBJECTS)
    assert halves("osnet-only", model=OBJECTS) == (select, LOCAL[1])
    assert halves("rpnet-only", model=OBJECTS) == (LOCAL[0], place)


def test_the_printed_planner_asks_the_printed_networks() -> None:
    assert halves("neural-paper") == neural("paper networks of ur5e")
    assert halves("neural-paper", model=PAPER) == neural(PAPER)
    with pytest.raises(
        ValueError, match=r"the policy neural-paper asks networks of the form paper, and this model's are of the form objects"
    ):
        make_policy("neural-paper", MOTIONS, model=OBJECTS)

    assert halves("osnet-only-paper") == (neural("paper networks of ur5e")[0], LOCAL[1])
    assert halves("rpnet-only-paper", model=PAPER) == (LOCAL[0], neural(PAPER)[1])
    assert halves("neural-greedy") == neural("objects networks of ur5e")
    assert halves("neural-greedy", model=PAPER) == neural(PAPER)


def test_other_network_policies_take_any_form() -> None:
    assert halves("osnet-only", model=PAPER)[0] == neural(PAPER)[0]
    assert halves("rpnet-only", model=PAPER)[1] == neural(PAPER)[1]


@pytest.mark.parametrize("name", NETWORKS)
def test_networks_of_another_robot_are_refused(name: str) -> None:
    form = "paper" if name.endswith("-paper") else "objects"
    with pytest.raises(ValueError, match=r"the model was trained for the robot gen3, and this scene's is ur5e"):
        make_policy(name, MOTIONS, model=Model(form, "gen3", 4, {}, {}, {}))


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=rf"unknown policy 'neurl' \(did you mean 'neural'\?\); the valid names are {', '.join(POLICIES)}"):
        make_policy("neurl", MOTIONS)


def test_the_names() -> None:
    networks = ("neural", "neural-greedy", "neural-paper", "osnet-only", "osnet-only-paper", "rpnet-only", "rpnet-only-paper")
    assert tuple(POLICIES) == ("random", "local", "rrt", "lookahead", *networks, "search")
    assert networks == NETWORKS
