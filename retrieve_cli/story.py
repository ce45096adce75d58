"""What became of a scene, told in words: what is in the way, each move, and at the end why it failed, if it did."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kinematics.scene import Scene
    from planning.plan import Plan

MOST_REASONS = 3  # of failed attempts that are told, the most frequent first


def story(scene: Scene, plan: Plan) -> Iterator[str]:
    """The lines to tell of a scene's plan, which was made in this call: what kept the target in at each try is in no file."""
    import numpy as np

    others = len(scene.objects) - 1
    yield f"scene {scene.id}: {scene.target_name} is wanted; {others} other object{'s stand' if others != 1 else ' stands'} in the cabinet"
    done = [move for move in plan.moves if move.done]
    for number, move in enumerate(done):
        if number < len(plan.target_blocked):
            yield _blocked(scene.target_name, plan.target_blocked[number].in_words(), again=number > 0)
        far = 100 * float(np.linalg.norm(move.T_world_to[:3, 3] - move.T_world_from[:3, 3]))
        yield f"  {number + 1}. {move.object} moves {far:.0f} cm away, to region {move.region}"
    if plan.success:
        travel = f"the arm moves for {plan.duration_s:.1f} s, its hand {plan.hand_travel_m:.1f} m"
        yield f"  {len(done) + 1}. {scene.target_name} comes out; {travel}"
    else:
        if plan.target_blocked and (plan.reason is None or plan.reason.stage in ("unsolvable", "moves")):
            yield _blocked(scene.target_name, plan.target_blocked[-1].in_words(), again=bool(done))
        yield from _failure(plan, again=bool(done), target=scene.target_name)
    yield from (f"  note: {note.detail}" for note in plan.notes)
    yield f"  planned in {plan.planning_time_s + plan.motion_time_s:.1f} s{_attempts(plan)}"


def _blocked(target: str, words: str, *, again: bool) -> str:
    return f"  {target} is {'still ' if again else ''}blocked: {words}"


def _failure(plan: Plan, *, again: bool, target: str) -> Iterator[str]:
    """Why the target stays in."""
    why = plan.reason
    if plan.unsolvable is not None:
        helps = "; ".join(plan.unsolvable.would_help)
        yield f"  no moves help: {plan.unsolvable.words}"
        yield f"  what would: {helps}" if helps else "  nothing that was tried would help"
    elif why is not None and why.stage == "moves":
        yield f"  not solved: {why.detail}"
    elif why is not None:
        yield _blocked(target, why.in_words(), again=again)
        known = why.detail if plan.target_blocked and why.detail != plan.target_blocked[-1].detail else None
        yield f"  not solved: {known or 'nothing more was found to move'}"
    tried = Counter((move.object, move.reason.in_words()) for move in plan.moves if not move.done and move.reason)
    for (name, words), times in tried.most_common(MOST_REASONS):
        yield f"  {name} can't be moved: {words}" + (f", in {times} attempts" if times > 1 else "")


def _attempts(plan: Plan) -> str:
    failed = sum(not move.done for move in plan.moves)
    if not failed:
        return ""
    return f"; {failed} {'other ' if plan.success else ''}attempt{'s' if failed > 1 else ''} failed"
