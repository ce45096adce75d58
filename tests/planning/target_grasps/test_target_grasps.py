"""With which grasps the target is taken: x_g, the best of a list, or any; each judged before anything moves, and told in the plan."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinematics.errors import InputError
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Grasp, Scene
from kinematics.shapes import Box, Cylinder, Shape
from kinematics.transforms import rotation_about, transform
from planning import plan_scene, verify_plan
from planning.grasping.sampling import DENSE, DENSEST, USUAL
from planning.io.results import scene_writer
from planning.motion.pick_place import Motions
from planning.plan import SCENE
from planning.policies.unsolvable import Finding, Prover
from planning.scenes.generation import generate, load_spec
from planning.target_grasps import allowed
from planning.target_grasps.allowed import GraspChoice, TargetGrasps, lies_flat, target_grasps
from planning.target_grasps.proposals import propose, rank
from planning.verdict import judge_grasp
from retrieve_cli.__main__ import main

PROVED = 880011, 358  # of `shelf`: what blocks x_g can't be picked, and another grasp of the target would help


@pytest.fixture(scope="module")
def scene(ur5e: Robot) -> Scene:
    """A scene whose proof says that another grasp of the target would help."""
    seed, index = PROVED
    return generate(load_spec("shelf"), ur5e, to_ref(ur5e), seed, index)


@pytest.fixture(scope="module")
def alone(ur5e: Robot, scene: Scene) -> Scene:
    """Its target alone in the cabinet, with a list of grasps."""
    scene = replace(scene, objects=(scene.target_body,))
    return replace(scene, grasps=propose(ur5e, scene, most=4).grasps)


def beside(grasp: Grasp) -> Grasp:
    """A grasp of nothing."""
    return replace(grasp, T_world_hand=transform(p=(0.0, 0.0, 0.2)) @ grasp.T_world_hand)


def same(a: Grasp | None, b: Grasp) -> bool:
    return a is not None and a.width_m == b.width_m and np.array_equal(a.T_world_hand, b.T_world_hand)


def test_the_best_of_a_list_is_taken_and_what_can_not_be_meant_is_left_out(ur5e: Robot, alone: Scene) -> None:
    listed = [grasp for grasp, _ in alone.grasps]
    assert len(listed) > 1
    wrong = replace(alone, grasp=beside(alone.x_g))
    chosen = target_grasps(ur5e, wrong, GraspChoice.LIST)
    assert isinstance(chosen, TargetGrasps)
    assert list(chosen.first) == listed
    assert chosen.more is None
    plan = plan_scene(wrong, "local", grasp="list")
    assert plan.success
    assert same(plan.grasp, listed[0])
    assert verify_plan(wrong, plan) == ()
    other_way_round = replace(wrong, grasps=alone.grasps[::-1])
    assert same(plan_scene(other_way_round, "local", grasp="list").grasp, listed[-1])


def test_only_x_g_is_taken_unless_more_is_asked_for(ur5e: Robot, alone: Scene) -> None:
    plan = plan_scene(alone, "local")
    assert same(plan.grasp, alone.x_g)
    refused = plan_scene(replace(alone, grasp=beside(alone.x_g)), "local")
    assert refused.reason is not None
    assert (refused.reason.stage, "does not hold" in refused.reason.detail) == (SCENE, True)


def test_a_list_of_which_nothing_can_be_meant_says_why(alone: Scene) -> None:
    none = replace(alone, grasp=None, grasps=tuple((beside(g), s) for g, s in alone.grasps))
    plan = plan_scene(none, "local", grasp="list")
    assert plan.reason is not None
    assert plan.reason.detail.startswith(f"grasp: none of the {len(alone.grasps)} that are listed is valid; the first: x_g does not hold")


@pytest.mark.parametrize(
    ("shape", "why"),
    [
        (Cylinder(0.06, 0.1), "it measures 120 × 120 × 100 mm, and the fingers, which open 8[0-9] mm, find no two faces of it to close on"),
        (Cylinder(0.03, 0.004), "it lies 4 mm high, and the middle of the pads stays 40 mm above the floor: stand it up"),
        (Box(np.array([0.03, 0.2, 0.004])), "it lies 4 mm high, and the middle of the pads stays"),
    ],
)
def test_a_target_that_no_sampled_grasp_holds_says_how_large_it_is(ur5e: Robot, alone: Scene, shape: Shape, why: str) -> None:
    T, old = alone.target_body.T_world_body.copy(), alone.target_body.shape
    T[2, 3] += shape.half[2] - old.half[2]
    other = replace(alone, objects=(replace(alone.target_body, shape=shape, T_world_body=T),), grasp=None, grasps=())
    wrong = target_grasps(ur5e, other, GraspChoice.ANY)
    assert isinstance(wrong, str)
    assert re.match(f"no grasp that is sampled on {alone.target} is valid: {why}", wrong)


def test_a_can_that_lies_is_too_low_where_the_pads_stay_above_its_axis(ur5e: Robot, alone: Scene) -> None:
    """Though its top is high enough for pads that close on flat sides."""
    can, floor_z = Cylinder(0.03, 0.12), float(alone.cabinet.T_world_cabinet[2, 3])
    middle = [*alone.target_body.T_world_body[:2, 3], floor_z + can.radius_m]
    lying = replace(alone.target_body, shape=can, T_world_body=transform(rotation_about((1.0, 0.0, 0.0), np.pi / 2), middle))
    other = replace(alone, objects=(lying,), grasp=None, grasps=(), approaches=("horizontal",))
    said = "it lies 60 mm high, and the middle of the pads stays 40 mm above the floor: stand it up"
    assert lies_flat(ur5e, other) == said
    assert lies_flat(ur5e, replace(other, objects=(replace(lying, shape=Box(2 * can.half)),))) is None
    from_above = replace(other, approaches=APPROACHES)
    assert (lies_flat(ur5e, from_above) is None) == isinstance(target_grasps(ur5e, from_above, GraspChoice.ANY), TargetGrasps)


def test_without_a_grasp_or_a_list_there_is_nothing_to_choose(ur5e: Robot, alone: Scene) -> None:
    with pytest.raises(InputError, match=r"has no list of grasps: retrieve grasp proposes one, or plan with --grasp given or any"):
        target_grasps(ur5e, replace(alone, grasps=()), GraspChoice.LIST)
    with pytest.raises(InputError, match="has no grasp for its target"):
        target_grasps(ur5e, replace(alone, grasp=None), GraspChoice.GIVEN)


def test_any_grasp_does_where_none_is_given(alone: Scene) -> None:
    plan = plan_scene(replace(alone, grasp=None), "local", grasp="any")
    assert plan.success
    assert plan.grasp is not None
    assert verify_plan(alone, plan) == ()


def test_all_that_is_sampled_can_be_meant_and_densely_there_is_more(ur5e: Robot, scene: Scene) -> None:
    chosen = target_grasps(ur5e, scene, GraspChoice.ANY)
    assert isinstance(chosen, TargetGrasps)
    assert chosen.first == (scene.x_g,)
    assert chosen.more is not None
    usual = list(chosen.more(USUAL))
    assert usual
    assert all(judge_grasp(ur5e, scene, grasp) is None for grasp in usual)
    few = next(chosen.more(DENSE), None)
    assert few is not None


def test_what_the_proof_says_would_help_does(ur5e: Robot, scene: Scene) -> None:
    """Proved unsolvable with x_g; by another grasp it is solved; and where any may be taken there is no such proof."""
    motions = Motions(ur5e, scene)
    proof = Prover(motions)(motions.start()).unsolvable
    assert proof is not None
    assert f"another grasp of {scene.target}" in proof.would_help
    chosen = target_grasps(ur5e, scene, GraspChoice.ANY)
    assert isinstance(chosen, TargetGrasps)
    freer = Motions(ur5e, scene, target_grasps=chosen.first, more_grasps=chosen.more)
    assert Prover(freer)(freer.start()) == Finding()
    plan = plan_scene(scene, "lookahead", grasp="any")
    assert plan.success
    assert not same(plan.grasp, scene.x_g)
    assert verify_plan(scene, plan) == ()


def test_the_command_takes_the_choice(alone: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with scene_writer(tmp_path / "scene.jsonl") as write:
        write(replace(alone, grasps=()))
    plan = ["plan", str(tmp_path / "scene.jsonl"), "--policy", "local", "-o", str(tmp_path / "plan.jsonl")]
    assert main([*plan, "--grasp", "any"]) == 0
    assert main([*plan, "--grasp", "list"]) == 2
    assert "has no list of grasps" in capsys.readouterr().err
    assert main([*plan, "--grasp", "none"]) == 2


def test_a_grasp_is_proposed_once_though_it_is_sampled_or_read_twice(ur5e: Robot, scene: Scene) -> None:
    """Two heights that the same limit clamps give the same hand, and networks say a grasp many times."""
    kept = [grasp for grasp, _ in propose(ur5e, scene, most=100).grasps]
    nudged = [Grasp(transform(p=(0.0001, 0.0, 0.0)) @ g.T_world_hand, g.width_m) for g in kept]
    again = rank(ur5e, scene, [*kept, *nudged, *kept], most=300)
    assert len(kept) > 1
    assert {(*g.T_world_hand.ravel().tolist(), g.width_m) for g, _ in again.grasps} == {
        (*g.T_world_hand.ravel().tolist(), g.width_m) for g in kept
    }
    for i, a in enumerate(kept):
        for b in kept[:i]:
            apart = np.abs(a.T_world_hand - b.T_world_hand).max()
            assert apart > 1e-4 or abs(a.width_m - b.width_m) > 1e-4


def test_another_grasp_a_millimetre_or_a_degree_away_is_another(ur5e: Robot, scene: Scene) -> None:
    best, _ = propose(ur5e, scene, most=1).grasps[0]
    up = Grasp(transform(p=(0.0, 0.0, 0.001)) @ best.T_world_hand, best.width_m)
    turned = Grasp(best.T_world_hand @ transform(rotation_about((0.0, 1.0, 0.0), np.radians(1.0))), best.width_m)
    assert len(rank(ur5e, scene, [best, up, turned], most=9).grasps) == 3


def test_dense_grasps_of_the_target_are_not_judged_one_by_one(ur5e: Robot, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """There are tens of thousands, of which the hand alone rules most out at once: to judge each took minutes where no grasp helps."""
    asked = list[Grasp]()

    def judge(robot: Robot, scene: Scene, grasp: Grasp | None = None) -> str | None:
        assert grasp is not None
        asked.append(grasp)
        return judge_grasp(robot, scene, grasp)

    monkeypatch.setattr(allowed, "judge_grasp", judge)
    chosen = target_grasps(ur5e, scene, GraspChoice.ANY)
    assert isinstance(chosen, TargetGrasps)
    assert chosen.more is not None
    asked.clear()
    assert len(list(chosen.more(DENSEST))) > 1000
    assert asked == []
    assert len(list(chosen.more(USUAL))) <= len(asked)
