"""Where a cabinet may stand beside what is fixed to an arm's base, and what is put into it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinematics.robots.load import load
from kinematics.scene import RobotRef
from kinematics.shapes import box_corners
from kinematics.transforms import Array
from planning.scenes.fitting import BESIDE_M, _is_beside, _not_held, _of_one_kind, _slimmed
from planning.scenes.generation import load_spec

SPEC = load_spec("paper")


def _box(size: str, at: str) -> str:
    return f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>'


def _joint(name: str, kind: str, parent: str, child: str, at: str, axis: str, most: float) -> str:
    least = -most if kind == "revolute" else 0.0
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/><axis xyz="{axis}"/>'
        f'<limit lower="{least}" upper="{most}" velocity="1" effort="1"/></joint>'
    )


def _hand(palm: str) -> str:
    """An arm of six joints whose fingers are 50 mm long and open 80 mm, on such a palm."""
    links = "".join(f'<link name="l{i}">{_box("0.05 0.05 0.15", "0 0 0.09")}</link>' for i in range(1, 6))
    joints = "".join(
        _joint(f"a{i}", "revolute", f"l{i - 1}" if i else "base", f"l{i}" if i < 5 else "palm", "0 0 0.2", f"0 {i % 2} {1 - i % 2}", 2.5)
        for i in range(6)
    )
    links = links.replace('name="l5"', 'name="l0"')
    fingers = "".join(f'<link name="{f}">{_box("0.02 0.01 0.05", f"0 {y} 0.025")}</link>' for f, y in (("f1", 0.005), ("f2", -0.005)))
    slides = "".join(_joint(f"j{f}", "prismatic", "palm", f, "0 0 0.05", f"0 {y} 0", 0.04) for f, y in (("f1", 1), ("f2", -1)))
    base = f'<link name="base">{_box("0.1 0.1 0.1", "0 0 0")}</link>'
    return f'<robot name="r">{base}{links}{joints}<link name="palm">{palm}</link>{fingers}{slides}</robot>'


ARM = _hand(_box("0.04 0.2 0.04", "0 0 0.03"))


def block(size: tuple[float, float, float], at: tuple[float, float, float]) -> Array:
    return box_corners(np.array(size) / 2) + np.array(at)


def test_a_cabinet_stands_within_a_frame_that_is_fixed_to_the_base() -> None:
    """Posts on both sides and a beam above, all of which reach further ahead than its front."""
    depth, width, height = SPEC.cabinet_size_m
    aside, above = width / 2 + SPEC.cabinet_wall_m + 2 * BESIDE_M, 0.1 + height + SPEC.cabinet_wall_m + 2 * BESIDE_M
    frame = [block((2.0, 0.02, 2.0), (0.5, s * (aside + 0.01), 0.5)) for s in (1, -1)] + [block((2.0, 2.0, 0.02), (0.5, 0.0, above + 0.01))]
    assert _is_beside(SPEC, (0.3, 0.1), frame)
    assert not _is_beside(SPEC, (0.3, 0.1 + 1.5 * BESIDE_M), frame)
    assert not _is_beside(SPEC, (0.3, 0.1), [*frame, block((0.02, 0.02, 0.3), (0.3 + depth / 2, 0.0, 0.2))])
    assert _is_beside(SPEC, (0.3, 0.1), [])


@pytest.mark.parametrize("boxes", [True, False])
def test_objects_of_one_kind_alone(boxes: bool) -> None:
    """A spec of household objects keeps those of the kind; one that has none of it keeps what it has."""
    assert _of_one_kind(SPEC, boxes=boxes).objects_box_share == float(boxes)
    lab = load_spec("lab-s")
    kinds = {len(kind.size_m) for kind in lab.objects_household}
    assert kinds == {2, 3}
    assert {len(kind.size_m) for kind in _of_one_kind(lab, boxes=boxes).objects_household} == {3 if boxes else 2}
    only = replace(lab, objects_household=tuple(kind for kind in lab.objects_household if len(kind.size_m) == (2 if boxes else 3)))
    assert _of_one_kind(only, boxes=boxes).objects_household == only.objects_household


def test_slimmer_objects_are_as_high_and_as_many() -> None:
    slim = _slimmed(SPEC, 0.5)
    assert slim.objects_half_width_m == tuple(0.5 * half for half in SPEC.objects_half_width_m)
    assert slim.target_half_width_m == tuple(0.5 * half for half in SPEC.target_half_width_m)
    assert (slim.objects_height_m, slim.objects_count) == (SPEC.objects_height_m, SPEC.objects_count)
    assert _slimmed(SPEC, 1.0) is SPEC


def test_a_hand_with_a_near_palm_holds_slim_objects_only(tmp_path: Path) -> None:
    """Between fingers that open 80 mm, the palm ends 25 mm behind the middle of the pads: what is thicker than twice that touches it."""
    (tmp_path / "arm.urdf").write_text(ARM)
    robot = load(str(tmp_path / "arm.urdf"))
    assert robot.opening.max_m == pytest.approx(0.08, abs=1e-3)
    ref = RobotRef(np.eye(4), urdf=str(tmp_path / "arm.urdf"))
    wrong = _not_held(SPEC, robot, ref, boxes=False)
    assert wrong is not None
    assert "palm would touch the target itself" in wrong
    assert _not_held(_slimmed(SPEC, 0.5), robot, ref, boxes=False) is None
