"""Queries that are packed from others are the ones that would be packed anew."""

from __future__ import annotations

import numpy as np

from kinematics.jit.record import Record
from kinematics.robots.robot import Robot
from kinematics.scene import RobotRef
from kinematics.transforms import transform
from planning.motion.cell.packed_cell import PackedCell
from planning.motion.settings import DEFAULTS
from planning.scenes.generation import generate, load_spec


def test_an_empty_hand_among_the_same_objects_elsewhere_is_packed_as_if_anew(ur5e: Robot) -> None:
    scene = generate(load_spec("paper"), ur5e, RobotRef(transform(p=ur5e.base_p), ur5e.name), 3141, 0)
    gripper = float(ur5e.opening.value_at(0.06))
    before, moved = scene.poses(), transform(p=[0.05, -0.04, 0.0])
    after = {name: moved @ T if i % 2 else T for i, (name, T) in enumerate(before.items())}
    used, fresh = (PackedCell(ur5e, scene, (), DEFAULTS) for _ in range(2))
    first = used.problem(before, gripper)
    kept = [array.copy() for array in _arrays(first.task)]
    second, anew = used.problem(after, gripper), fresh.problem(after, gripper)
    assert second.names == anew.names
    assert all(np.array_equal(a, b) for a, b in zip(_arrays(second.task), _arrays(anew.task), strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(_arrays(second.task), kept, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(_arrays(first.task), kept, strict=True))


def _arrays(record: object) -> list[np.ndarray]:
    """All arrays and numbers of a record and of those in it."""
    assert isinstance(record, Record)
    out: list[np.ndarray] = []
    for value in record:  # type: ignore[attr-defined]
        out += _arrays(value) if isinstance(value, Record) else [np.asarray(value)]
    return out
