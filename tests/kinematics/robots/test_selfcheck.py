"""A robot whose kinematics another program reads differently is refused when it is first seen; the named ones were compared beforehand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinematics import cache
from kinematics.robots import assemble
from kinematics.robots.load import forget, load
from kinematics.robots.named import named_robots
from kinematics.robots.robot import Robot
from kinematics.robots.selfcheck import check_kinematics


def test_named_robots_agree_and_are_the_ones_that_were_checked(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    check_kinematics(robot, seed=3)
    stored = {}
    monkeypatch.setattr(cache, "load", lambda _: None)
    monkeypatch.setattr(cache, "store", lambda _, data: stored.update(data))
    monkeypatch.setattr(assemble, "check_kinematics", lambda _: pytest.fail("the fingerprint in robots.toml is out of date"))
    forget()
    load(robot.name)
    assert assemble.fingerprint(stored) == named_robots()[robot.name]["checked_kinematics"]


@pytest.mark.parametrize(
    ("change", "link"),
    [
        (lambda tree, i: {"T_joint": _moved(tree.T_joint, i, 2e-5)}, "forearm_link"),
        (lambda tree, i: {"scale": np.where(np.arange(len(tree.scale)) == i, -tree.scale, tree.scale)}, "right_outer_knuckle"),
        (lambda tree, i: {"offset": np.where(np.arange(len(tree.offset)) == i, tree.offset + 0.001, tree.offset)}, "right_outer_knuckle"),
    ],
    ids=["an origin 0.02 mm away", "turned the other way", "an offset of a milliradian"],
)
def test_a_disagreement_names_the_first_joint(ur5e: Robot, change: object, link: str) -> None:
    i = ur5e.tree.index[link]
    wrong = replace(ur5e, tree=replace(ur5e.tree, **change(ur5e.tree, i)))  # type: ignore[operator]
    with pytest.raises(ValueError, match=f"joint between .* and {link} is read differently by a plain reading"):
        check_kinematics(wrong)


def _moved(T: np.ndarray, i: int, by: float) -> np.ndarray:
    out = T.copy()
    out[i, 0, 3] += by
    return out


def test_a_new_urdf_is_compared_once(toy_urdf: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    asked: list[str] = []
    monkeypatch.setattr(assemble, "check_kinematics", lambda robot: asked.append(robot.name))
    file = str(toy_urdf())
    for _ in range(2):
        forget()
        load(file, "tcp")
    assert asked == [file]
