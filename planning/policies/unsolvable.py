"""The proof that no moves help, and what would.

Take the largest set of objects of which none can be picked while only they and the target stand. None of them ever moves: the first one to
be picked would be picked while all of them, the target and perhaps others stand where they stood at the beginning, and more objects never
make a pick possible. So if every way to x_g is blocked by that set alone, no sequence of picks frees the target.

The proof holds for the grasps that were sampled on the objects, and for the arm's solutions that were found for them: of an arm of more
than six joints, which has whole lines of them, for some dozen of each hand's. So grasps are sampled far more densely for it than where
moves are planned, those that hold an object by an edge or deeper than its middle among them: wherever the verdict would call it held; and
at last in a cabinet with as much more room as there is between one such grasp and the next (`handling/subdivision.py`). Of meshes and what
is not upright, and of hands whose pads are askew, grasps can't be sampled as densely, and plates and thin walls can't be looked at with
more room: there nothing is proved by what is stuck. It says nothing about pushing.

An object that leans on something, and could be put down nowhere else, is as stuck as one that can't be picked; and so is what bears another
that is stuck, or the target.

The subdivision may find a hand that takes one of the stuck objects after all. Then there are fewer of them, and either these still are a
proof, or there is hope: what can be done with those hands.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from kinematics.scene import APPROACHES, Grasp, State
from kinematics.transforms import Array
from planning.motion.handling.object_grasps import sampled_grasps
from planning.motion.handling.obstruction import Obstruction, View
from planning.motion.handling.picking import THOROUGH
from planning.motion.handling.shrunk_scene import thinnest_allowed_m
from planning.motion.pick_place import Motions
from planning.plan import Unsolvable
from planning.relaxed_plan import NOTHING, Names, stuck_set


@dataclass(frozen=True)
class Finding:
    """What is found where no look at grasps holds out hope. unsolvable: the proof that there is none. hope: the motions with hands that the
    subdivision found, if these leave some. undecided: why neither is known, in words."""

    unsolvable: Unsolvable | None = None
    hope: Motions | None = None
    undecided: str | None = None


class Prover:
    """Proofs for the states of one scene."""

    def __init__(self, motions: Motions) -> None:
        self.motions, self.target = motions, motions.scene.target_name
        self._known: dict[tuple[tuple[str, ...], bool], Obstruction] = {}

    def __call__(self, state: State) -> Finding:
        """The proof that no moves take the target out of a state, or the hands that perhaps do; nothing where usual ones may."""
        look, hands = self.motions.exhaustive, dict[str, list[Grasp]]()
        while True:
            view = look.obstructions(state.poses)
            stuck = stuck_set(view, frozenset(state.poses) - {self.target})
            if view.free(self.target, stuck):
                return Finding(hope=look) if hands else Finding()
            if not view.free(self.target, frozenset()):  # whatever goes, the target stays
                return self._proof(state, frozenset(), stuck)
            found, doubt = self._subdivision(state, stuck)
            if found:
                hands |= found
                look = self.motions.with_hands(state.poses, hands)
            elif doubt is not None:
                return Finding(undecided=doubt)
            else:
                return self._proof(state, stuck, stuck)

    def _proof(self, state: State, named: Names, stuck: Names) -> Finding:
        """That a set of objects keeps the target in, unless an arm of many joints may reach it in a way that is hardly found."""
        if self.motions.reaches_closely(state.poses, named):
            return Finding(undecided=f"{self.target} may be reached among what is stuck by a solution of the arm that is hardly found")
        supports = self.motions.supports
        leaning = tuple(sorted(named & supports.put_down_nowhere))
        staying = {name: T for name, T in state.poses.items() if name in named or name == self.target}
        lifted_into = tuple((name, met[0]) for name in sorted(named) if (met := supports.lifted_into(name, staying)))
        return Finding(Unsolvable(tuple(sorted(named)), tuple(self._would_help(state, stuck)), leaning, lifted_into))

    def _subdivision(self, state: State, stuck: Names) -> tuple[dict[str, list[Grasp]], str | None]:
        """A hand that takes one of a set of objects while the others of it stand; or else why it is in doubt that there is none."""
        waiting = self.motions.supports.waiting(state.poses)
        hidden = [name for name in sorted(stuck) if self._is_hidden(state, name, stuck)]
        doubt = f"{hidden[-1]} may be taken once what nobody has seen before it was seen" if hidden else None
        stays = {name for name in stuck if waiting.get(name, NOTHING) & {*stuck, self.target}}  # whatever hand there is
        asked = sorted(stuck.difference(stays, hidden))
        if not asked:
            return {}, doubt
        if self.motions.finest is None:
            thin_mm = 1e3 * thinnest_allowed_m(self.motions.scene)
            what = f"meshes, what is not upright, pads that are askew, and anything thinner than {thin_mm:.0f} mm"
            return {}, f"nothing is proved where there are {what}: hands among these can't be looked at densely enough"
        view = self.motions.finest.at(state.poses)
        for name in asked:
            access = view.access(name, stuck - {name})
            if access.hand is not None:
                return {name: [access.hand]}, None
            if not access.closed:
                looked_at = f"{access.between} hands between others" if access.between else "the hands that were looked at"
                doubt = f"{name} is hardly reachable, if at all: {looked_at} do not tell"
        return {}, doubt

    def _is_hidden(self, state: State, name: str, stuck: Names) -> bool:
        """Whether unseen space alone keeps one of a set of stuck objects from being taken: hands between others are not why."""
        motions = self.motions
        return motions.partly_unseen and motions.if_free.exhaustive.obstructions(state.poses).free(name, stuck - {name})

    def _would_help(self, state: State, stuck: Names) -> Iterator[str]:
        """What would change it, one thing at a time: another grasp of the target, other approaches, both, an object taken away by hand."""
        usual, others = self.motions.scene.approaches, [a for a in APPROACHES if a not in self.motions.scene.approaches]
        found = False
        if self._view(state, usual, any_grasp=True).free(self.target, stuck):
            found = True
            yield f"another grasp of {self.target}"
        if others:
            freer, how = self._stuck(state, APPROACHES), f"other approaches ({', '.join(others)})"
            if self._view(state, APPROACHES).free(self.target, freer):
                found = True
                yield how
            if not found and self._view(state, APPROACHES, any_grasp=True).free(self.target, freer):
                yield f"another grasp of {self.target} and {how}"
        view = self._view(state, usual)
        for name in sorted(stuck):
            if view.free(self.target, stuck_set(view, frozenset(state.poses) - {self.target, name})):
                yield f"{name} taken away by hand"

    def _stuck(self, state: State, approaches: Sequence[str]) -> Names:
        return stuck_set(self._view(state, approaches), frozenset(state.poses) - {self.target})

    def _view(self, state: State, approaches: Sequence[str], *, any_grasp: bool = False) -> View:
        """Obstructions with very densely sampled grasps on the objects, and on the target its own. With other approaches, or with any grasp
        of the target, nothing is proved, and fewer will do."""
        motions, key = self.motions, (tuple(approaches), any_grasp)
        if key == (motions.scene.approaches, False):
            return motions.exhaustive.obstructions(state.poses)
        if key not in self._known:

            def grasps_on(name: str, T: Array) -> Iterable[Grasp]:
                if name == self.target and not any_grasp:
                    return motions.thorough.target_grasps
                sampling = THOROUGH.sampling
                return sampled_grasps(motions.robot, motions.scene, name, T, approaches=approaches, sampling=sampling)

            self._known[key] = Obstruction(motions.cell, grasps_on, ik=THOROUGH.ik)
        return self._known[key].at(state.poses)
