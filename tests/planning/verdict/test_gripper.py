"""What a plan tells the gripper, of one whose joint's 0.02 are 40 mm, unless another table is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_arm import HAND, motion
from toy_robot import toy_robot

from kinematics.robots.hands.opening import Opening
from kinematics.scene import Held
from planning.plan import Fault, Gripper, GripperState, Motion
from planning.verdict.gripper import force_faults, place_faults, told_faults, urdf_force_N, width_faults


def test_the_gripper_is_told_where_its_joint_is() -> None:
    def told(before: float, after: float, joint: str = "grip", lone: bool = False) -> list[Fault]:
        made = motion((0, 0, 0, 0, 0.01), (0, 0, 0, 0, 0.02), (0, 0, 0, 0, 0.03), stage="grasp")
        made = replace(made, gripper=Gripper(joint, GripperState(before, 0.0), GripperState(after, 0.0)))
        before_it = [motion((0,))] * (not lone)
        motions = [*before_it, made]
        return place_faults(motions)

    assert told(0.01, 0.03) == told(0.010099, 0.029901) == []
    assert told(0.01015, 0.03) == [
        Fault("grasp", (), "motion 1 tells the gripper 0.01015 before it, and grip is at 0.01", pytest.approx(1.5e-4))
    ]
    assert told(0.01, 0.02) == [Fault("grasp", (), "motion 1 tells the gripper 0.02 after it, and grip is at 0.03", pytest.approx(0.01))]
    assert [f.amount for f in told(0.02, 0.02)] == [pytest.approx(0.01)] * 2
    assert len(told(np.nan, 0.03)) == 1
    claw = Fault("grasp", (), "motion 0 tells a gripper's joint 'claw', which is none of its joints")
    assert told(0.01, 0.03, "claw", lone=True) == [claw]
    assert place_faults([replace(motion((0,)), held=Held("a", np.eye(4)))]) == []
    zero, off = (replace(motion((0,)), gripper=Gripper("grip", GripperState(x, 0.0), GripperState(x, 0.0))) for x in (1e-4, 1.0))
    assert place_faults([zero]) == []
    claws = replace(zero, gripper=Gripper("claw", GripperState(0, 0), GripperState(0, 0)))
    assert [f.detail.split(" tells")[0] for f in place_faults([claws, zero, off])] == ["motion 0", "motion 2", "motion 2"]


def test_the_gripper_is_told_the_width_that_its_joint_has() -> None:
    opening = Opening(np.array([0.8, 0.0]), np.array([0.005, 0.085]), np.zeros(2), np.zeros(2))  # 0.1 rad are 10 mm

    def told(value: float, width_m: float, command: float | None = None) -> list[str]:
        state = GripperState(value, width_m, command=command)
        return [f.detail for f in width_faults([replace(motion((0,)), gripper=Gripper("grip", state, state))], opening)]

    assert told(0.3, 0.055) == told(0.3, 0.0554) == told(0.8, 0.0) == []  # it can't close further
    assert told(0.3, 0.053, 0.32) == []  # what was only seen: it closes until it meets it
    assert told(0.3, 0.08)[0] == "motion 0 tells the gripper a width of 80.0 mm before it; its joint is told 55.0 mm and stands at 55.0 mm"
    assert len(told(0.3, 0.0)) == len(told(0.3, 0.053)) == len(told(0.3, np.nan)) == 2
    assert [len(told(0.3, 0.055 + more)) for more in (4.9e-4, 5.1e-4, -4.9e-4, -5.1e-4)] == [0, 2, 0, 2]
    assert len(told(0.3, 0.055, 0.32)) == 2  # width and command differ
    assert len(told(0.3, 0.065, 0.2)) == 2  # it would let go
    assert width_faults([motion((0,))], opening) == []
    wide = GripperState(0.3, 0.08)
    late = width_faults([motion((0,)), replace(motion((0,)), gripper=Gripper("grip", GripperState(0.3, 0.055), wide))], opening)
    assert [f.detail.split(";")[0] for f in late] == ["motion 1 tells the gripper a width of 80.0 mm after it"]


def told(value: float, command: float | None = None, force_N: float | None = None, joint: str = "grip", held: str | None = None) -> Motion:
    """A motion whose gripper is told the same before it and for its end; of the toy 0.02 are 40 mm."""
    state = GripperState(value, 0.0, force_N, command)
    return replace(motion((0,)), gripper=Gripper(joint, state, state), held=None if held is None else Held(held, np.eye(4)))


def test_a_hand_that_holds_nothing_is_not_told_to_close_further() -> None:
    """Else what it is to let go of stays in it."""
    robot = toy_robot()
    assert told_faults([told(0.02), told(0.02, 0.02), told(0.02, 0.0198), told(0.02, 0.03), motion((0,))], robot) == []
    wrong = "motion {} tells the gripper to close to 30.0 mm {} it, and it holds nothing there"
    assert [f.detail for f in told_faults([motion((0,)), told(0.02, 0.015)], robot)] == [
        wrong.format(1, when) for when in ("before", "after")
    ]
    assert [f.detail for f in told_faults([told(0.02, 0.015)], robot)] == [wrong.format(0, "before"), wrong.format(0, "after")]
    assert [f.detail.split(" to close to ")[1][:7] for f in told_faults([told(0.05, 0.0495)], robot)] == ["99.0 mm"] * 2
    grasp, carried, release = told(0.02, 0.015), told(0.02, 0.015, held="a"), told(0.02, 0.015)
    assert [f.detail for f in told_faults([grasp, carried, release], robot)] == [wrong.format(0, "before"), wrong.format(2, "after")]


def test_a_hand_that_holds_is_told_a_force_where_one_is_known() -> None:
    grasp, carried, release = told(0.02), told(0.02, held="a"), told(0.02)
    wrong = "motion {} tells the gripper no force {} it, and it holds something there"
    assert told_faults([grasp, carried, release], toy_robot()) == []  # nobody knows how hard it closes
    knows = toy_robot(grip_force_N=40.0)
    four = [wrong.format(0, "after"), wrong.format(1, "before"), wrong.format(1, "after"), wrong.format(2, "before")]
    assert [f.detail for f in told_faults([grasp, carried, release], knows)] == four
    hard = [replace(m, gripper=told(0.02, force_N=force).gripper) for m, force in ((grasp, 20.0), (carried, 0.0), (release, 1.0))]
    assert [f.detail for f in told_faults(hard, knows)] == four[1:3]
    assert told_faults([told(0.02), motion((0,)), carried], knows)[0].detail == wrong.format(2, "before")  # long after the first
    cup = replace(toy_robot().opening, cup_m=0.03)
    assert told_faults([grasp, carried, release], toy_robot(grip_force_N=40.0, opening=cup)) == []


def test_the_gripper_that_is_told_is_the_robots() -> None:
    assert [f.detail for f in told_faults([told(0.0, joint="turn")], toy_robot())] == [
        "motion 0 tells a gripper's joint 'turn', and the gripper's is 'grip'"
    ]
    assert told_faults([told(0.0, joint="claw")], toy_robot()) == []  # which is none at all: place_faults
    twice = told_faults([told(0.02, 0.015, joint="turn"), told(0.02, 0.015)], toy_robot())  # of another's width nothing is said
    assert [f.detail[:28] for f in twice] == [
        "motion 0 tells a gripper's j",
        "motion 1 tells the gripper t",
        "motion 1 tells the gripper t",
    ]


def test_no_gripper_is_told_a_force_that_it_has_not() -> None:
    """By a data sheet, or else by virtual work: the toy's pads come apart by 2 mm a millimetre of its joint."""
    well, hard = told(0.02, force_N=40.03), told(0.02, force_N=40.05)
    by_sheet = toy_robot(most_grip_force_N=40.0)
    assert force_faults([well, told(0.02), motion((0,))], by_sheet, HAND) == []
    assert force_faults([told(0.02)], toy_robot(most_grip_force_N=0.5), HAND) == []
    wrong = "motion 1 tells the gripper a force of 40.05 N {} it, and its data sheet gives 40 N at most"
    found = force_faults([well, hard], by_sheet, HAND)
    assert found == [Fault("transit", (), wrong.format(when), 40.05) for when in ("before", "after")]
    strong = replace(HAND, arm=replace(HAND.arm, effort=np.full(5, 80.0)))
    assert force_faults([well], toy_robot(), strong) == []
    assert force_faults([hard], toy_robot(), strong)[0].detail == wrong.replace("motion 1", "motion 0").format("before").replace(
        "its data sheet gives", "the effort of grip in the URDF comes to"
    )
    assert force_faults([told(0.02, force_N=1e9)], toy_robot(), HAND) == []  # whose URDF gives no effort
    cup = toy_robot(most_grip_force_N=40.0, opening=replace(toy_robot().opening, cup_m=0.03))
    assert force_faults([hard], cup, HAND) == []


def test_a_lever_makes_the_same_effort_another_force() -> None:
    """Pads that a hinge moves by 0.2 m a rad where they are shut and by 0.1 m where they are open, whichever way it turns."""
    arm = replace(HAND.arm, effort=np.array([9.0, 9.0, 9.0, 9.0, 5.0]))
    for values in ([0.0, 0.1, 0.2, 0.3, 0.4], [0.4, 0.3, 0.2, 0.1, 0.0]):
        hinge = replace(HAND, arm=arm, values=np.array(values), widths=np.array([0.0, 0.02, 0.04, 0.05, 0.06]))
        shut, open_ = values[0], values[-1]
        assert urdf_force_N(hinge, shut) == pytest.approx(25.0)
        assert urdf_force_N(hinge, open_) == pytest.approx(50.0)
