"""Patience with searches that fail: it halves, it ends, and what is limited is what a scene costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.transforms import Array
from planning.motion.handling.patience import Patience
from planning.motion.pick_place import ITERATIONS, Motions
from planning.motion.settings import DEFAULTS, PatienceSettings
from planning.plan import Blocked
from planning.scenes.generation import generate, load_spec


def test_it_halves_with_every_failure_down_to_the_least() -> None:
    patience = Patience(PatienceSettings(share=0.5, failed=10_000, least=300), 3000)
    assert [patience.iterations(n) for n in range(6)] == [3000, 1500, 750, 375, 300, 300]
    patience.failed(9_999)
    assert patience.iterations(0) == 3000
    patience.failed(1)
    assert patience.iterations(0) == 300
    assert Patience(PatienceSettings(least=300), 100).iterations(9) == 100  # what the user asks for is never exceeded


def test_searches_that_fail_cost_a_scene_no_more_than_they_may(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """No way across is ever found: whatever is asked about the scene, what searches are given in vain is limited, but for the least."""
    settings = PatienceSettings(failed=8_000, least=100)
    scene = generate(load_spec("paper"), ur5e, to_ref(ur5e), 23, 0)
    motions, given = Motions(ur5e, scene, settings=replace(DEFAULTS, patience=settings)), list[int]()
    found = motions.cell.connect

    def connect(
        query: object, start: Array, goals: Array, rng: np.random.Generator, iterations: int | None = None, known: object = ()
    ) -> Array | Blocked:
        if iterations is None:
            return found(query, start, goals, rng)  # type: ignore[arg-type]
        given.append(iterations)
        return Blocked("transit", detail="no path")

    monkeypatch.setattr(motions.cell, "connect", connect)
    state, rng = motions.start(), np.random.default_rng(0)
    for name in (b.name for b in scene.objects if b.name != scene.target_name):
        for region in range(0, scene.regions_n**2, 3):
            assert isinstance(motions.relocate(state, name, region, rng), Blocked)
    assert given[:1] == [ITERATIONS]
    spent = np.cumsum(given)
    assert (np.array(given)[1:][spent[:-1] >= settings.failed] == settings.least).all()
    assert spent[-1] > settings.failed
    assert sum(n for n in given if n > settings.least) < settings.failed + ITERATIONS
