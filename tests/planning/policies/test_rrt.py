"""The planner by counted paths, with counts that are written down: who blocks most goes first, to where it blocks nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fakes import observation

from kinematics.transforms import Array, rotations_about, transform
from perception.observation import Observation
from planning.policies import rrt as module
from planning.policies.regions import free_regions
from planning.policies.rrt import PATHS, CountedPaths, make_rrt_object, make_rrt_region

RNG = np.random.default_rng(0)
SIZE = (0.06, 0.06, 0.12)
BOXES = {
    "a": (0.05, 0.15, 0.06, *SIZE),
    "b": (0.15, -0.15, 0.06, *SIZE),
    "target": (0.35, 0.0, 0.06, *SIZE),
    "c": (0.25, 0.15, 0.06, *SIZE),
}
SEEN = observation(BOXES)
T_CABINET = transform(rotations_about((0.0, 0.0, 1.0), np.array(0.7)), [0.4, -0.2, 0.9])


class Paths:
    """Stands for what finds paths and counts them; notes what it is asked."""

    def __init__(self, blocks: list[int], hits: Array) -> None:
        self.blocks, self.hits = np.array(blocks), hits
        self.sought: list[Any] = []
        self.counted: list[Any] = []
        self.motions: Any = SimpleNamespace(state="first")

    def install(self, patch: pytest.MonkeyPatch) -> CountedPaths:
        patch.setattr(module, "paths_to_target", self._seek)
        patch.setattr(module, "paths_met", self._count)
        return CountedPaths(self.motions)

    def _seek(self, *asked: Any) -> str:
        self.sought.append(asked)
        return "paths"

    def _count(self, motions: Any, state: Any, names: Any, cells: Array, paths: Any) -> tuple[Any, Array]:
        assert (motions, paths) == (self.motions, "paths")
        self.counted.append((state, names, cells))
        return self.blocks, self.hits


def test_who_blocks_most_goes_first_and_who_blocks_nothing_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    for blocks, order in (([1, 5, 3], ["b", "c", "a"]), ([2, 0, 2], ["a", "c"]), ([0, 0, 0], [])):
        paths = Paths(blocks, np.zeros((3, 16), int)).install(monkeypatch)
        assert list(make_rrt_object(paths)(SEEN, RNG)) == order


def test_of_those_that_block_as_much_the_first_in_the_scene_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"can_{i}" for i in range(60)]
    blocks = [i % 3 for i in range(60)]
    crowd = observation(dict.fromkeys([*names, "target"], BOXES["a"]))
    select = make_rrt_object(Paths(blocks, np.zeros((60, 16), int)).install(monkeypatch))
    assert list(select(crowd, RNG)) == names[2::3] + names[1::3]


@pytest.mark.parametrize("name", ["b", "c"])
def test_it_goes_to_the_nearest_free_region_where_it_blocks_no_path(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Of those that are as near, the first by number."""
    seen = observation(BOXES, n=8)
    hits = np.zeros((3, 64), int)
    free = free_regions(seen, name).tolist()
    hits[seen.movable.index(name), free[::5]] = 1 + np.arange(len(free[::5]))
    regions = list(make_rrt_region(Paths([0, 0, 0], hits).install(monkeypatch))(seen, name, RNG))
    away = np.linalg.norm(seen.regions[:, :2] - seen.boxes[name][:2], axis=1)
    left = [i for i in free if i not in free[::5]]
    assert len(set(away[left])) < len(left)
    assert regions == sorted(left, key=lambda i: (away[i], i))


def test_paths_are_found_once_and_counted_once_an_observation(monkeypatch: pytest.MonkeyPatch) -> None:
    written = Paths([1, 2, 3], np.zeros((3, 16), int))
    paths = written.install(monkeypatch)
    paths.of(SEEN, RNG), make_rrt_object(paths)(SEEN, RNG), make_rrt_region(paths)(SEEN, "a", RNG)
    assert written.sought == [(written.motions, "first", RNG, PATHS)]
    assert [(state, list(names)) for state, names, _ in written.counted] == [("first", ["a", "b", "c"])]
    written.motions.state = "later"
    other: Observation = observation(BOXES)
    assert paths.of(other, RNG)[0] is written.blocks
    assert [state for state, *_ in written.counted] == ["first", "later"]
    assert len(written.sought) == 1  # the paths ignore the other objects, so they stay
    assert PATHS == 16


def test_regions_are_counted_in_the_cabinets_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """The observation's are in the world's."""
    written = Paths([1, 2, 3], np.zeros((3, 16), int))
    seen = observation(BOXES, T_cabinet=T_CABINET)
    written.install(monkeypatch).of(seen, RNG)
    cells = written.counted[0][2]
    assert cells.shape == (16, 3)
    assert np.allclose(cells[:, 2], cells[0, 2])
    assert np.allclose(sorted(set(np.round(cells[:, 0], 9))), [0.05, 0.15, 0.25, 0.35])
    assert np.allclose(sorted(set(np.round(cells[:, 1], 9))), [-0.15, -0.05, 0.05, 0.15])
