"""A robot before a cluttered cabinet, for tests that ask the compiled core and FCL the same questions."""

from __future__ import annotations

from functools import lru_cache

import fcl
import numpy as np
from small_queries import make_problem

from kinematics.chain import forward
from kinematics.collision.fcl_solids import Solid, hull_solid, shape_solids
from kinematics.collision.geometry import Query, make_solids
from kinematics.collision.robot_model import robot_collision_model
from kinematics.collision.sphere_model import make_sphere_world, posed_sphere_model
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet
from kinematics.shapes import Box, Cylinder
from kinematics.transforms import Array, rotation_about, transform
from planning.motion.search.edges import Memory, Task, make_memory, make_task

_REQUEST = fcl.CollisionRequest()


class Cell:
    """A robot before a cluttered cabinet: our task, and FCL's view of it."""

    def __init__(self, robot: Robot) -> None:
        base = transform(p=robot.base_p)
        self.chain = robot.chain(base)
        bodies = cluttered(np.random.default_rng(8))
        parts, _ = robot.parts(robot.opening.value_at(0.06), base)
        model = posed_sphere_model(self.chain, robot_collision_model(robot, base).posed(robot.opening.value_at(0.06)))
        solids, _ = make_solids(bodies)
        check = np.repeat((parts.frame > 0)[:, None], len(bodies), 1).astype(np.uint8)
        query = Query(check, robot.self_pairs)
        self.task: Task = make_task(make_problem(self.chain, parts, solids, query), model, make_sphere_world(solids, query))
        self.memory: Memory = make_memory(self.task)
        hulls = [parts.vertices[a:b] for a, b in zip(parts.start[:-1], parts.start[1:])]
        self.movers: list[Solid] = [hull_solid("", v) for v in hulls]
        self.frame, n = parts.frame, len(hulls)
        still = [s.move(b.T_world_body) for b in bodies for s in shape_solids(b.name, b.shape)]
        self.objects = [s.object for s in [*self.movers, *still]]
        self.pairs = np.concatenate([query.pairs, np.argwhere(check) + np.array([0, n])])
        self.reach = np.array([s.radius for s in [*self.movers, *still]])[self.pairs].sum(1)
        self.centres, self.still = np.array([s.centre for s in self.movers]), np.array([s.at for s in still])
        self.frames = np.zeros((len(self.chain.q_index) + 1, 4, 4))

    def random(self, n: int, seed: int) -> Array:
        return np.random.default_rng(seed).uniform(self.chain.lower, self.chain.upper, (n, len(self.chain.lower)))

    def touches(self, q: Array) -> bool:
        """FCL's word, on the exact hulls, boxes and cylinders."""
        forward(self.chain, q, self.frames)
        T = self.frames[self.frame]
        at = np.concatenate([np.einsum("pij,pj->pi", T[:, :3, :3], self.centres) + T[:, :3, 3], self.still])
        near = self.pairs[np.linalg.norm(at[self.pairs[:, 0]] - at[self.pairs[:, 1]], axis=1) <= self.reach]
        for i in np.unique(near):
            if i < len(self.movers):
                self.objects[i].setTransform(fcl.Transform(T[i, :3, :3], T[i, :3, 3]))
        return any(fcl.collide(self.objects[i], self.objects[j], _REQUEST, fcl.CollisionResult()) > 0 for i, j in near)


def cluttered(rng: np.random.Generator) -> list[Body]:
    """The walls of the paper's cabinet, and eight boxes and cylinders in it, the last two lying."""
    cabinet = Cabinet(np.array([0.56, 0.86, 0.50]), transform(p=[0.30, 0.0, 0.10]), 0.03)
    bodies = list(cabinet.walls())
    for i in range(8):
        half, height = rng.uniform(0.02, 0.037, 2), rng.uniform(0.08, 0.25)
        R = rotation_about((0.0, 0.0, 1.0), rng.uniform(0, 3)) @ rotation_about((0.0, 1.0, 0.3), 1.5 if i > 5 else 0.0)
        T = cabinet.T_world_cabinet @ transform(R, [rng.uniform(0.05, 0.5), rng.uniform(-0.38, 0.38), height / 2 if i < 6 else 0.05])
        bodies.append(Body(f"{i}", Box(np.array([*2 * half, height])) if i % 2 else Cylinder(half[0], height), T))
    return bodies


@lru_cache(maxsize=4)
def cell_of(robot: Robot) -> Cell:
    return Cell(robot)
