"""The proof that no moves help, and what would, in cabinets in which it is written down what blocks what with which grasps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fakes import scene_of

from kinematics.scene import APPROACHES, State
from kinematics.transforms import Array
from planning.motion.cell.workcell import IkSearch
from planning.motion.handling.picking import THOROUGH
from planning.motion.handling.subdivision import Access
from planning.plan import Unsolvable
from planning.policies import unsolvable as module
from planning.policies.unsolvable import Finding, Prover
from planning.relaxed_plan import Names

HERE = State(np.zeros(1), scene_of(*"abcdefgh", target="t").poses())
Ways = Mapping[str, Sequence[str]]
STUCK: Ways = {"t": ["a", "b"], "a": ["b"], "b": ["a"], "c": ["a", ""]}
"""a and b keep each other, and each blocks one way to the target."""
OTHERS = "other approaches (diagonal, downward)"


class Written:
    """What the table does not name can be picked at once."""

    def __init__(self, ways: Ways) -> None:
        self.ways = ways

    def free(self, name: str, standing: Names) -> bool:
        return any(not frozenset(way) & standing for way in self.ways.get(name, [""]))


class Finest:
    """Objects in `doubtful` may have a way, though none is found; others have one where the table says so, by a hand called after them."""

    def __init__(self, ways: Ways, doubtful: str) -> None:
        self.written, self.doubtful, self.asked = Written(ways), doubtful, list[tuple[str, Names]]()

    def at(self, poses: Mapping[str, Array]) -> Finest:
        assert poses is HERE.poses
        return self

    def access(self, name: str, standing: Names) -> Access:
        self.asked.append((name, standing))
        free = self.written.free(name, standing)
        return Access(name.upper() if free else None, not free and name not in self.doubtful, 7)  # type: ignore[arg-type]


class Cabinet:
    """Stands for `Motions`: what blocks what in the exhaustive look, with any grasp of the target, with all approaches, with both, and in
    the subdivision.

    made: how often obstructions were built for other grasps than the exhaustive look's own.
    """

    def __init__(
        self,
        usual: Ways,
        *,
        any_grasp: Ways | None = None,
        freely: Ways | None = None,
        both: Ways | None = None,
        finest: Ways | None = None,
        doubtful: str = "",
    ) -> None:
        freely = freely or usual
        self.answers = {
            (("horizontal",), True): any_grasp or usual,
            (APPROACHES, False): freely,
            (APPROACHES, True): both or freely,
        }
        self.scene = SimpleNamespace(target_name="t", approaches=("horizontal",))
        self.robot, self.cell, self.made = object(), object(), 0
        self.exhaustive = SimpleNamespace(obstructions=self._look(usual))
        self.finest: Finest | None = Finest(finest or usual, doubtful)
        self.partly_unseen, self.usual = False, usual
        self.if_free: Any = None
        self.supports = SimpleNamespace(waiting=lambda poses: {}, put_down_nowhere=frozenset(), lifted_into=lambda name, poses: ())
        self.thorough = SimpleNamespace(target_grasps=("the target's own",))
        self.reached_closely: list[frozenset[str]] = []

    def with_hands(self, poses: Mapping[str, Array], hands: Mapping[str, Sequence[Any]]) -> Any:
        """With a hand an object can be picked in the way that the subdivision has found."""
        assert poses is HERE.poses
        assert self.finest is not None
        assert all(found == [name.upper()] for name, found in hands.items())
        ways = {**self.usual, **{name: self.finest.written.ways.get(name, [""]) for name in hands}}
        return SimpleNamespace(obstructions=self._look(ways), hands=sorted(hands))

    def reaches_closely(self, poses: Mapping[str, Array], standing: frozenset[str]) -> bool:
        return standing in self.reached_closely

    def _look(self, ways: Ways) -> Callable[[Mapping[str, Array]], Written]:
        def look(poses: Mapping[str, Array]) -> Written:
            assert poses is HERE.poses
            return Written(ways)

        return look


@pytest.fixture(autouse=True)
def grasps_that_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Grasps say what was asked for, and obstructions answer by the grasps that they were given."""

    def sampled(robot: Any, scene: Any, name: str, T: Array, *, approaches: Sequence[str], sampling: Any) -> tuple[Any, ...]:
        assert sampling is THOROUGH.sampling
        return ("sampled", robot, scene, name, tuple(approaches))

    class Obstruction:
        def __init__(self, cell: Any, grasps_on: Callable[[str, Array], Iterable[Any]], *, ik: IkSearch) -> None:
            cabinet = next(c for c in CABINETS if c.cell is cell)
            assert ik == THOROUGH.ik
            on_a, on_t = (tuple(grasps_on(name, np.eye(4))) for name in "at")
            assert on_a[:4] == ("sampled", cabinet.robot, cabinet.scene, "a")
            assert on_t in (("the target's own",), ("sampled", cabinet.robot, cabinet.scene, "t", on_a[4]))
            self.at = cabinet._look(cabinet.answers[on_a[4], on_t[0] == "sampled"])
            cabinet.made += 1

    monkeypatch.setattr(module, "sampled_grasps", sampled)
    monkeypatch.setattr(module, "Obstruction", Obstruction)


CABINETS: list[Cabinet] = []


def found(cabinet: Cabinet) -> Finding:
    CABINETS[:] = [cabinet]
    return Prover(cabinet)(HERE)  # type: ignore[arg-type]


def proof(cabinet: Cabinet) -> Unsolvable | None:
    return found(cabinet).unsolvable


def test_there_is_no_proof_where_the_stuck_ones_leave_a_way() -> None:
    """Though others are in it: they can go."""
    assert proof(Cabinet({**STUCK, "t": ["a", "c"]})) is None
    assert found(Cabinet({**STUCK, "t": [""]})) == Finding()


def test_hands_that_the_subdivision_finds_leave_hope() -> None:
    """The stuck ones are asked with the others of them standing, and no longer than till one has a hand. Other objects are not asked."""
    cabinet = Cabinet(STUCK, finest={**STUCK, "b": ["c"]})
    finding = found(cabinet)
    assert (finding.unsolvable, finding.undecided) == (None, None)
    assert finding.hope.hands == ["b"]  # type: ignore[union-attr]
    assert cabinet.finest is not None
    assert cabinet.finest.asked == [("a", frozenset("b")), ("b", frozenset("a"))]
    assert found(Cabinet(STUCK, finest={**STUCK, "c": []})) == Finding(proof(Cabinet(STUCK)))


def test_with_hands_on_some_the_others_may_be_a_proof_still() -> None:
    """c has a hand, and after it d; a and b keep each other."""
    ways: Ways = {**STUCK, "c": ["d"], "d": ["c"], "t": ["ac"]}
    finest = {**ways, "c": [""], "d": ["a"]}
    assert proof(Cabinet(ways, finest=finest)) == Unsolvable(("a", "b"), proof(Cabinet(ways)).would_help)  # type: ignore[union-attr]
    both = found(Cabinet({**ways, "t": ["cd"]}, finest={**ways, "c": [""], "d": [""]}))
    assert both.hope.hands == ["c"]  # type: ignore[union-attr]


def test_what_is_in_doubt_is_said_where_no_hand_is_found() -> None:
    for doubtful, hand in (("a", "b"), ("b", "a")):
        finding = found(Cabinet(STUCK, doubtful=doubtful))
        assert (finding.unsolvable, finding.hope) == (None, None)
        assert finding.undecided == f"{doubtful} is hardly reachable, if at all: 7 hands between others do not tell"
        open_ = found(Cabinet(STUCK, doubtful=doubtful, finest={**STUCK, hand: [""]}))
        assert (open_.unsolvable, open_.undecided) == (None, None)
        assert open_.hope.hands == [hand]  # type: ignore[union-attr]


def test_hands_between_others_are_not_sought_on_what_unseen_space_alone_keeps() -> None:
    cabinet = Cabinet(STUCK, finest={**STUCK, "a": [""]})
    assert found(cabinet).hope is not None
    cabinet.partly_unseen, cabinet.if_free = True, Cabinet({**STUCK, "a": [""]})
    cabinet.finest.asked.clear()  # type: ignore[union-attr]
    finding = found(cabinet)
    assert (finding.unsolvable, finding.hope) == (None, None)
    assert (finding.undecided or "").startswith("a may be taken once")
    assert cabinet.finest.asked == [("b", frozenset("a"))]  # type: ignore[union-attr]
    cabinet.if_free = Cabinet(STUCK)
    assert found(cabinet).hope is not None


def test_nothing_is_proved_by_what_is_stuck_where_no_look_is_fine_enough() -> None:
    """But where nothing is stuck, walls keep the hand from the target."""
    cabinet, walled = Cabinet(STUCK), Cabinet({"t": [], "a": [""], "b": [""], "c": [""]})
    cabinet.finest = walled.finest = None
    assert proof(cabinet) is None
    assert "meshes" in (found(cabinet).undecided or "")
    assert proof(walled) == Unsolvable((), ())


def test_what_is_stuck_is_named_and_each_that_would_help_by_hand() -> None:
    """Without a, b can go, and the other way round; c is not stuck, and helps nobody."""
    assert proof(Cabinet(STUCK)) == Unsolvable(("a", "b"), ("a taken away by hand", "b taken away by hand"))


def test_what_is_named_is_in_order() -> None:
    """Eight in a ring, each kept by the next; whichever is taken away, the others can go."""
    ring = {name: [nxt] for name, nxt in zip("abcdefgh", "bcdefgha", strict=True)}
    assert proof(Cabinet({**ring, "t": ["a"]})) == Unsolvable(tuple("abcdefgh"), tuple(f"{n} taken away by hand" for n in "abcdefgh"))


def test_only_what_frees_the_target_is_said_to_help() -> None:
    ways: Ways = {"t": ["a"], "a": ["b"], "b": ["ac"], "c": ["b"]}
    assert proof(Cabinet(ways)) == Unsolvable(("a", "b", "c"), ("a taken away by hand", "b taken away by hand"))


def test_no_object_is_named_where_the_target_is_out_of_reach_with_every_one_gone() -> None:
    cabinet = Cabinet({**STUCK, "t": []}, doubtful="ab")
    assert proof(cabinet) == Unsolvable((), ())
    assert cabinet.finest.asked == []


def test_another_grasp_or_other_approaches_help_where_they_free_the_target() -> None:
    walled: Ways = {**STUCK, "t": []}
    grasped, freed = {**walled, "t": [""]}, {**walled, "t": ["a"], "a": [""]}
    assert proof(Cabinet(walled, any_grasp=grasped)) == Unsolvable((), ("another grasp of t",))
    assert proof(Cabinet(walled, freely=freed)) == Unsolvable((), (OTHERS,))
    assert proof(Cabinet(walled, any_grasp=grasped, freely=freed)) == Unsolvable((), ("another grasp of t", OTHERS))


def test_both_together_are_said_where_neither_helps_alone() -> None:
    walled: Ways = {**STUCK, "t": []}
    freed, grasped = {**walled, "t": ["a"], "a": [""]}, {**walled, "t": [""]}
    assert proof(Cabinet(walled, both=freed)) == Unsolvable((), ())  # a is stuck in the freer view as well
    assert proof(Cabinet(walled, both=grasped)) == Unsolvable((), (f"another grasp of t and {OTHERS}",))
    assert proof(Cabinet(walled, any_grasp=grasped, both=grasped)) == Unsolvable((), ("another grasp of t",))
    assert proof(Cabinet(walled, freely=grasped, both=grasped)) == Unsolvable((), (OTHERS,))


def test_where_all_approaches_are_allowed_no_others_are_named() -> None:
    cabinet = Cabinet({**STUCK, "t": []})
    cabinet.scene.approaches = APPROACHES
    cabinet.answers = {(APPROACHES, True): STUCK}
    assert proof(cabinet) == Unsolvable((), ())
    assert cabinet.made == 1


def test_obstructions_are_built_once_for_all_states() -> None:
    cabinet = Cabinet(STUCK)
    CABINETS[:] = [cabinet]
    prover = Prover(cabinet)  # type: ignore[arg-type]
    assert prover(HERE) == prover(HERE)
    assert cabinet.made == 3


def test_what_an_arm_of_many_joints_may_reach_is_in_doubt() -> None:
    """Of the solutions for x_g, whole lines of them, the usual looks see a few."""
    cabinet = Cabinet(STUCK)
    cabinet.reached_closely.append(frozenset("ab"))
    assert found(cabinet) == Finding(undecided="t may be reached among what is stuck by a solution of the arm that is hardly found")
    for_good = Cabinet({**STUCK, "t": []})
    assert proof(for_good) is not None
    for_good.reached_closely.append(frozenset())
    assert found(for_good).unsolvable is None
