"""What the tests of the policies that look ahead share: a search's settings, and how a policy is asked."""

from __future__ import annotations

import numpy as np
from written_world import WrittenWorld

from kinematics.scene import State
from perception.observation import Observation, observe
from planning.motion.pick_place import Choice
from planning.plan import Unsolvable
from planning.policies.lookahead import Lookahead
from planning.policies.search import Effort, Preferences
from planning.policies.unsolvable import Finding

SOME = Effort(attempts=200)

IN_ORDER = Preferences(lambda seen: lambda name: 0.0, lambda seen, name, rng: range(len(seen.regions)))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def proved(state: State) -> Finding:
    return Finding(Unsolvable(("a", "b"), ("another grasp of t",)))


def no_proof(state: State) -> Finding:
    return Finding()


def look(world: WrittenWorld, **more: object) -> Lookahead:
    return Lookahead(world, IN_ORDER, SOME, **{"prove": no_proof, "most": 5, **more})  # type: ignore[arg-type]


def asked(policy: Lookahead, world: WrittenWorld) -> list[Choice]:
    """All that a policy proposes in the world's state."""
    seen: Observation = observe(world.scene, world.state)
    return [(name, region) for name in policy.select(seen, rng()) for region in policy.place(seen, name, rng())]
