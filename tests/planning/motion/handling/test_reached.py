"""Ways to many picks at once: whole and certified from where the arm is, the same each time, and none where it can't set out."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Scene, State
from kinematics.transforms import Array
from planning.motion.handling.carry import gripper_on_the_way
from planning.motion.handling.picking import Pick
from planning.motion.handling.reached import reached
from planning.motion.pick_place import Motions
from planning.plan import Blocked
from planning.scenes.generation import generate, load_spec


def made(ur5e: Robot) -> tuple[Motions, State, list[Pick]]:
    """A cabinet and all picks of some object in it."""
    scene: Scene = generate(load_spec("paper-any"), ur5e, to_ref(ur5e), 23, 0)
    look = Motions(ur5e, scene).varied
    state = look.start()
    return look, state, next(picks for body in scene.objects if len(picks := look.picks(state, body.name)[0]) > 50)


def ways(look: Motions, state: State, picks: list[Pick], most: int, seed: int = 0, **more: int) -> dict[Pick, Array]:
    return reached(look.cell, state, picks, np.random.default_rng(seed), most=most, iterations=20_000, **more)


def test_each_way_leads_from_the_arm_to_its_pick_and_is_certified(ur5e: Robot) -> None:
    look, state, picks = made(ur5e)
    found = ways(look, state, picks, 8)
    assert len(found) == 8
    for pick, path in found.items():
        gripper = gripper_on_the_way(look.cell, state, pick)
        assert not isinstance(gripper, Blocked)
        assert np.array_equal(path[0], ur5e.arm_q(state.q))
        assert np.array_equal(path[-1], pick.approach[0])
        assert look.cell.free_along(look.cell.problem(state.poses, gripper), path)
    again = ways(look, state, picks, 8)
    assert list(again) == list(found)
    assert all(np.array_equal(again[pick], found[pick]) for pick in found)


def test_no_way_leads_to_what_is_shut_off_and_each_search_is_made(ur5e: Robot) -> None:
    look, state, picks = made(ur5e)
    asked = list[int]()

    def none(query: object, starts: Array, goals: Array, rng: object, iterations: int, *, shorter: bool) -> None:
        asked.append(iterations)

    look.cell.way = none  # type: ignore[assignment]
    same = [pick for pick in picks if pick.gripper_open == picks[0].gripper_open]
    assert ways(look, state, same, 8, searches=3) == {}
    assert asked == [20_000] * 3
    assert ways(look, state, same, 8, searches=0) == {}
    assert len(asked) == 3


def test_picks_at_neither_end_of_whose_way_the_fingers_can_be_set_are_left_out(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    look, state, picks = made(ur5e)
    shut = set(picks[::2])

    def gripper(cell: object, state: object, pick: Pick) -> float | Blocked:
        return Blocked("transit", "left_finger", "ceiling") if pick in shut else pick.gripper_open

    monkeypatch.setattr("planning.motion.handling.reached.gripper_on_the_way", gripper)
    found = ways(look, state, picks, 8)
    assert len(found) == 8
    assert not shut & set(found)
