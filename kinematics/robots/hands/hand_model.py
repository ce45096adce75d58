"""What there is to look at where a gripper is sought: an arm's tree of joints, their limits, and the links' hulls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.robots.tree import FIXED, LinkHull, Tree
from kinematics.transforms import Array, inverse

Branch = tuple[int, ...]
"""The links of a finger, the one on the palm first."""


class NoGripper(ValueError):
    """There is no gripper that can be used; says what was looked for, and found."""


@dataclass(frozen=True, eq=False)
class Model:
    """What there is to look at: the tree, its actuated joints' names and limits (J,), the hulls."""

    tree: Tree
    joints: Sequence[str]
    lower: Array
    upper: Array
    hulls: Sequence[LinkHull]

    @property
    def rest(self) -> Array:
        """Joints at 0, or as near as they can come (J,)."""
        return np.clip(np.zeros(len(self.joints)), self.lower, self.upper)

    def group(self, link: int) -> int:
        """The link that stands for all that is fixed to a link: the one with a moving joint above them, or the root."""
        while self.tree.kind[link] == FIXED and self.tree.parent[link] >= 0:
            link = int(self.tree.parent[link])
        return link

    def moved_on(self, group: int) -> list[int]:
        """The links that move on a group, by joints of their own."""
        return [i for i in range(len(self.tree.names)) if self.tree.kind[i] != FIXED and self.group(int(self.tree.parent[i])) == group]

    def motors(self, link: int) -> list[int]:
        """The actuated joints of a link and of what it carries, in order."""
        moving = (i for i in self.tree.below(link) if self.tree.kind[i] != FIXED)
        return list(dict.fromkeys(int(self.tree.q_index[i]) for i in moving))

    def points(self, links: Sequence[int], q: Array, frame: int) -> Array:
        """The hulls' vertices (V, 3) of some links at q (J,), in a link's frame."""
        poses = self.tree.poses(q)
        back, names = inverse(poses[frame]), {self.tree.names[i]: i for i in links}
        out = [np.empty((0, 3))]
        for hull in self.hulls:
            if hull.link in names:
                T = back @ poses[names[hull.link]]
                out.append(hull.vertices @ T[:3, :3].T + T[:3, 3])
        return np.concatenate(out)
