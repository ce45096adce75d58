"""Queries that are packed from others are the ones that would be packed anew."""

from __future__ import annotations

import numpy as np
import pytest

from kinematics.jit.record import Record
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import Held
from kinematics.transforms import transform
from planning.motion.cell.packed_cell import KNOWN_KEPT, PackedCell
from planning.motion.settings import DEFAULTS
from planning.scenes.generation import generate, load_spec


@pytest.mark.parametrize("full", [False, True])
def test_a_hand_among_the_same_objects_elsewhere_is_packed_as_if_anew(ur5e: Robot, full: bool) -> None:
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 3141, 0)
    gripper = float(ur5e.opening.value_at(0.06))
    before, moved = scene.poses(), transform(p=[0.05, -0.04, 0.0])
    after = {name: moved @ T if i % 2 else T for i, (name, T) in enumerate(before.items())}
    name = next(iter(before))
    held = [Held(name, transform(p=[0.0, 0.0, 0.15])) if full else None for _ in range(2)]
    if full:
        del before[name], after[name]
    used, fresh = (PackedCell(ur5e, scene, (), DEFAULTS) for _ in range(2))
    first = used.problem(before, gripper, held=held[0])
    kept = [array.copy() for array in _arrays(first.task)]
    second, anew = (cell.problem(after, gripper, held=held[1]) for cell in (used, fresh))
    assert second.names == anew.names
    assert all(np.array_equal(a, b) for a, b in zip(_arrays(second.task), _arrays(anew.task), strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(_arrays(second.task), kept, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(_arrays(first.task), kept, strict=True))


def test_so_many_queries_of_a_state_are_kept_and_no_more_and_a_forgotten_one_is_packed_the_same(ur5e: Robot) -> None:
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 3141, 0)
    cell, poses = PackedCell(ur5e, scene, (), DEFAULTS), scene.poses()
    values = np.linspace(ur5e.lower[ur5e.gripper_joint], ur5e.upper[ur5e.gripper_joint], KNOWN_KEPT + 2).tolist()
    first = cell.problem(poses, values[0])
    assert cell.problem(poses, values[0]) is first
    for value in values[1:]:
        cell.problem(poses, value)
    assert len(cell._standing(poses).known) == KNOWN_KEPT
    again = cell.problem(poses, values[0])
    assert again is not first
    assert all(np.array_equal(a, b) for a, b in zip(_arrays(again.task), _arrays(first.task), strict=True))


def _arrays(record: object) -> list[np.ndarray]:
    """All arrays and numbers of a record and of those in it."""
    assert isinstance(record, Record)
    out: list[np.ndarray] = []
    for value in record:  # type: ignore[attr-defined]
        out += _arrays(value) if isinstance(value, Record) else [np.asarray(value)]
    return out
