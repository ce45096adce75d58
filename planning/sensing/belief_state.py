"""What the loop has gathered so far: pictures, the map, the bodies that they show, objects that were moved, and where the arm is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene
from kinematics.transforms import Array
from perception.belief import Belief, believe, without_bodies, without_objects
from perception.frames import Frame
from perception.mapping.voxels import unknown_voxels
from perception.objects.prepared_frames import ReadyFrame
from perception.rendering.synthetic_camera import DEFAULT
from planning.motion.pick_place import Motions
from planning.motion.trajectory import FULL, Pace
from planning.plan import Motion
from planning.sensing.aimed_views import aimed_views
from planning.sensing.fine_map import FineMap, Moved, coarsened
from planning.sensing.hiding_places import COMPLETE
from planning.sensing.look_around import Limits, Looked, look_around
from planning.sensing.settings import SENSING, SensingSettings
from planning.sensing.unknown_space import unknown_mask, unknown_space
from planning.sensing.world import World, configuration, part_done, with_own_pixels


class BeliefState:
    """Grows with each look. q (J,): where the arm is; voxels: the map; belief: what all pictures together show.

    by_size: whether unseen space into which nothing of `sensing.smallest_m` fits is taken for free. tops: name to the share of its top
    that was seen. fine: the map in which this is found.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        rng: np.random.Generator,
        sensing: SensingSettings = SENSING,
        *,
        target_box: Array | None = None,
        pace: Pace = FULL,
    ) -> None:
        self.sensing, self.by, self.target_box, self.pace = sensing, sensing.by, target_box, pace
        self.empty_scene = replace(scene, objects=(), observation=None)
        self.robot, self.rng = robot, rng
        self.voxels, self.frames = unknown_voxels(self.empty_scene.cabinet), list[Frame]()
        self._ready = dict[Frame, ReadyFrame]()
        self.tracked: dict[str, Body] = {}
        self.by_size = False
        self._hiding: tuple[Belief, NDArray[np.bool_]] | None = None
        self.fine, self.tops = FineMap(self.empty_scene.cabinet), dict[str, float]()
        before_looking = Motions(self.robot, self.empty_scene)
        self.q, self.start_blocked = before_looking.start().q, before_looking.start_blocked()
        self.belief = Belief((), {}, self.voxels)

    def look(self, world: World, limits: Limits, focus: Array | None, on_step: Callable[[str], None], *, aimed: bool = False) -> Looked:
        """Look around, see `look_around`. aimed: by views that are sought for the focus alone, where there are some."""
        base = self.empty_scene.robot.T_world_base

        def drive(motions: Sequence[Motion]) -> tuple[Sequence[Motion], Array]:
            stopped = world.execute(motions)
            if stopped is None:
                return motions, motions[-1].q[-1]
            q = configuration(self.robot, world.where())
            on_step(f"the way to a view stopped: {stopped.why}")
            return (*motions[: stopped.motion], part_done(motions[stopped.motion], q)), q

        intrinsics = getattr(world, "intrinsics", DEFAULT)
        spots = None
        if aimed and focus is not None:
            spots = aimed_views(self.robot, self.empty_scene, self.voxels, self.belief.bodies, focus, self.rng, intrinsics)
        looked = look_around(
            self.empty_scene, self.robot, lambda _, q: with_own_pixels(self.robot, base, world.take_frame(), q), self.q, self.voxels,
            self.rng, bodies=self.belief.bodies, limits=limits, focus=focus, noise_1m_m=self.sensing.noise_1m_m,
            intrinsics=intrinsics, pace=self.pace, drive=drive, hiding=self.unseen_boxes if self.by_size else None, spots=spots,
            on_step=on_step,
        )  # fmt: skip
        fresh = looked.frames
        self.fine.add(*looked.rays)
        if self.by is None:
            self.by = "geometry" if any(f.instance is None for f in fresh) else "mask"
        if self.by == "geometry":
            known = (*self.empty_scene.obstacles, *self.tracked.values())
            fresh = tuple(without_bodies(f, known, self.sensing.noise_1m_m) for f in fresh)
        else:
            fresh = tuple(without_objects(f, self.tracked) for f in fresh)
        self.frames += fresh
        self.voxels, self.q = looked.voxels, looked.q
        return looked

    def understand(self) -> None:
        """Believe what all pictures together show. Raises: NoSurfaces when they show nothing but noise."""
        self.belief = believe(
            self.empty_scene, self.frames, self.voxels,
            by=self.by or "geometry", target_box=self.target_box, tracked=self.tracked, before=self.belief.bodies, kept=self._ready,
        )  # fmt: skip
        self.tops |= self.belief.seen_tops

    def unseen_boxes(self) -> tuple[Body, ...]:
        """Where something may be that nobody has seen, as obstacles."""
        bodies = self.belief.bodies
        return self.fine.boxes(self._places(), bodies) if self.by_size else unknown_space(self.voxels, bodies, blocks=1)

    def unseen_voxels(self) -> NDArray[np.bool_]:
        """The same as voxels (X, Y, Z) of the map."""
        if not self.by_size:
            return unknown_mask(self.voxels, self.belief.bodies)
        return coarsened(self._places(), self.fine.voxels, self.voxels)

    def _places(self) -> NDArray[np.bool_]:
        """Where something may hide, in voxels of the fine map; what the coarse map knows is known. Kept until the belief changes."""
        if self._hiding is None or self._hiding[0] is not self.belief:
            bodies = self.belief.bodies
            complete = {name for name, share in self.tops.items() if share >= COMPLETE}
            places = self.fine.hiding_places(self.voxels, unknown_mask(self.voxels, bodies), bodies, complete, self.sensing.smallest_m)
            self._hiding = (self.belief, places)
        return self._hiding[1]

    def moved(self, name: str, T_world_body: Array, q: Array) -> None:
        """An object has been put down: the room that it took is free now, and where it stands is its own."""
        body = self.belief.body(name)
        assert body is not None
        if self.by == "mask":  # what shows it there is past
            self.frames = [without_objects(f, (name,)) for f in self.frames]
        elif name not in self.tracked:
            before = (without_objects(f, (name,)) for f in self.belief.frames)
            self.frames = [replace(f, instance=None, names=()) for f in before]
        self.tracked[name] = replace(body, T_world_body=T_world_body)
        moved = Moved(body, self.tracked[name])
        self.fine.add(moved)
        self.voxels = moved.marked_in(self.voxels)
        bodies = tuple(self.tracked.get(b.name, b) for b in self.belief.bodies)
        self.belief, self.q = replace(self.belief, bodies=bodies, voxels=self.voxels), q
