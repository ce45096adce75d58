"""Of a measured hand frame x is up as things are held: a camera at the hand is above it, whichever finger is the first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from six_joints import arm, box, joint

from kinematics.robots.load import load

HAND = "".join(
    f'<link name="f{side}">{box("0.02 0.012 0.08", f"0 {0.006 * side} 0.04")}</link>'
    + joint(f"open{side}", "prismatic", "palm", f"f{side}", "0 0 0.01", f"0 {side} 0", (0.0, 0.04))
    for side in (1, -1)
)


def x_in_palm(tmp_path: Path, camera: float, hand: str = HAND, last: str = "") -> float:
    """Along the palm's x: the hand's, with something on a bracket that far along the palm's x."""
    bracket = f'<link name="bracket">{box("0.03 0.03 0.03", f"{camera} 0 0")}</link>'
    fixed = '<joint name="b" type="fixed"><parent link="palm"/><child link="bracket"/></joint>'
    text = arm(hand + bracket + fixed)
    if last:
        at = text.index('<joint name="a5"')
        text = text[:at] + text[at:].replace('lower="-3" upper="3"', last, 1)
    file = tmp_path / "r.urdf"
    file.write_text(text)
    made = load(str(file))
    poses = made.link_poses(made.home)
    return float((poses["palm"][:3, :3].T @ poses["hand"][:3, 0])[0])


@pytest.mark.parametrize("camera", [0.1, -0.1])
@pytest.mark.parametrize("order", [1, -1])
def test_what_a_hand_bears_at_its_side_is_up(camera: float, order: int, tmp_path: Path) -> None:
    hand = HAND if order == 1 else HAND[HAND.index('<link name="f-1"') :] + HAND[: HAND.index('<link name="f-1"')]
    assert x_in_palm(tmp_path, camera, hand) == pytest.approx(np.sign(camera), abs=1e-6)


def test_a_hand_that_the_last_joint_does_not_turn_round_stays_as_it_is(tmp_path: Path) -> None:
    a, b = (x_in_palm(tmp_path, camera, last='lower="-1" upper="1"') for camera in (0.1, -0.1))
    assert a == pytest.approx(b)
