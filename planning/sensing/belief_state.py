"""What the loop has gathered so far: pictures, the map, the bodies that they show, objects that were moved, and where the arm is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from kinematics.robots.robot import Robot
from kinematics.scene import Body, Scene
from kinematics.transforms import Array
from perception.belief import Belief, believe, without_bodies, without_objects
from perception.frames import Frame
from perception.mapping.voxels import FREE, UNKNOWN, unknown_voxels
from perception.rendering.synthetic_camera import DEFAULT
from planning.motion.pick_place import Motions
from planning.motion.trajectory import Pace
from planning.plan import Motion
from planning.sensing.look_around import BODY_MARGIN_M, Limits, Looked, look_around, skin
from planning.sensing.world import World, configuration, part_done, with_own_pixels


class BeliefState:
    """Grows with each look. q (J,): where the arm is; voxels: the map; belief: what all pictures together show."""

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        rng: np.random.Generator,
        *,
        by: Literal["mask", "geometry"] | None,
        noise_1m_m: float,
        target_box: Array | None,
        pace: Pace,
    ) -> None:
        self.by, self.target_box, self.pace = by, target_box, pace
        self.empty_scene = replace(scene, objects=(), observation=None)
        self.robot, self.rng, self.noise = robot, rng, noise_1m_m
        self.voxels, self.frames = unknown_voxels(self.empty_scene.cabinet), list[Frame]()
        self.tracked: dict[str, Body] = {}
        before_looking = Motions(self.robot, self.empty_scene)
        self.q, self.start_blocked = before_looking.start().q, before_looking.start_blocked()
        self.belief = Belief((), {}, self.voxels)

    def look(self, world: World, limits: Limits, focus: Array | None, on_step: Callable[[str], None]) -> Looked:
        base = self.empty_scene.robot.T_world_base

        def drive(motions: Sequence[Motion]) -> tuple[Sequence[Motion], Array]:
            stopped = world.execute(motions)
            if stopped is None:
                return motions, motions[-1].q[-1]
            q = configuration(self.robot, world.where())
            on_step(f"the way to a view stopped: {stopped.why}")
            return (*motions[: stopped.motion], part_done(motions[stopped.motion], q)), q

        looked = look_around(
            self.empty_scene, self.robot, lambda _, q: with_own_pixels(self.robot, base, world.take_frame(), q), self.q, self.voxels,
            self.rng, bodies=self.belief.bodies, limits=limits, focus=focus, noise_1m_m=self.noise,
            intrinsics=getattr(world, "intrinsics", DEFAULT), pace=self.pace, drive=drive, on_step=on_step,
        )  # fmt: skip
        fresh = looked.frames
        if self.by is None:
            self.by = "geometry" if any(f.instance is None for f in fresh) else "mask"
        if self.by == "geometry":
            fresh = tuple(without_bodies(f, tuple(self.tracked.values()), self.noise) for f in fresh)
        self.frames += fresh
        self.voxels, self.q = looked.voxels, looked.q
        return looked

    def understand(self) -> None:
        """Believe what all pictures together show. Raises: NoSurfaces when they show nothing but noise."""
        self.belief = believe(
            self.empty_scene, self.frames, self.voxels,
            by=self.by or "geometry", target_box=self.target_box, tracked=self.tracked, before=self.belief.bodies,
        )  # fmt: skip

    def moved(self, name: str, T_world_body: Array, q: Array) -> None:
        """An object has been put down: the room that it took is free now, and where it stands is its own."""
        body = self.belief.body(name)
        assert body is not None
        if self.by == "geometry" and name not in self.tracked:  # what shows it there is past
            before = (without_objects(f, (name,)) for f in self.belief.frames)
            self.frames = [replace(f, instance=None, names=()) for f in before]
        self.tracked[name] = replace(body, T_world_body=T_world_body)
        left = self.voxels.touched(body, BODY_MARGIN_M) | skin(self.voxels, [body])
        self.voxels = self.voxels.marked(left, FREE).marked(self.voxels.touched(self.tracked[name]), UNKNOWN)
        bodies = tuple(self.tracked.get(b.name, b) for b in self.belief.bodies)
        self.belief, self.q = replace(self.belief, bodies=bodies, voxels=self.voxels), q
