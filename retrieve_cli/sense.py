"""`retrieve sense`: look into the cabinet from the hand, and write the scenes with what was observed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.errors import InputError, blame, choose
from planning.io.files import UNREADABLE, read_scene_lines
from planning.io.observation_documents import observation_to_json
from planning.io.results import scene_writer
from retrieve_cli.terminal import announce_first_run, progress, say
from retrieve_cli.version import version

if TYPE_CHECKING:
    import numpy as np

    from kinematics.robots.robot import Robot
    from kinematics.scene import Scene
    from kinematics.transforms import Array
    from perception.frames import Frame
    from perception.mapping.voxels import Voxels
    from planning.sensing.look_around import Limits

STAGE = 2  # this stage's word in the seeds of random generators
BY = ("mask", "geometry")
CLOUD = "cloud.ply"


def run(
    *,
    scenes: Path | None,
    views: Path | None,
    from_views: Path | None,
    max_views: int,
    share: float,
    noise: bool,
    by: str,
    target_box: str | None,
    seed: int,
    out: Path | None,
    resume: bool = False,
) -> int:
    """Sense every scene; scene number i writes its frames to folder i of `views`, or takes them from folder i of `from_views`."""
    import numpy as np

    from kinematics.robots.robot import from_ref
    from perception.belief import believe, observation
    from perception.frames import read_frames, write_frames, write_ply
    from perception.objects.prepared_frames import axial_noise
    from perception.recorded import misfit, trusted
    from perception.rendering.synthetic_camera import marked
    from planning.sensing.look_around import Limits, unknown_mask

    choose("way to tell objects apart (--by)", by, BY)
    box = None if target_box is None else parse_box(target_box)
    announce_first_run()
    asked = {"command": "sense", "version": version(), "seed": seed, "by": by, "noise": noise, "views": max_views, "share": share}
    asked |= {"target_box": target_box, "from_views": None if from_views is None else str(from_views.absolute())}
    with scene_writer(out, asked=asked, resume=resume, tell=say) as write, progress("scenes", out=out) as advance:
        for index, line in write.left(enumerate(read_scene_lines(scenes, "sense")), key=lambda numbered: numbered[1].key):
            if line.scene is None:
                raise InputError(line.error)
            where, scene = line.where, line.scene
            empty_scene = replace(scene, objects=(), observation=None)
            with blame(where, *UNREADABLE):
                arm = from_ref(scene.robot, on_step=say)
                if from_views is None:
                    rng = np.random.default_rng([seed, STAGE, scene.random_word])
                    frames, voxels, reason = look(scene, arm, Limits(share=share, views=max_views), noise, rng)
                else:
                    recorded = [trusted(f) for f in read_frames(from_views, scene=None if _is_one(from_views) else index)]
                    if why := misfit(recorded, scene.cabinet):
                        raise InputError(f"--from-views {from_views}: {why}")
                    frames = marked(arm, scene.robot.T_world_base, recorded)
                    voxels, reason = fuse(empty_scene, frames, axial_noise(frames, empty_scene.cabinet)), f"{len(frames)} recorded views"
                belief = believe(empty_scene, frames, voxels, by="mask" if by == "mask" else "geometry", target_box=box)
                if views is not None:
                    write_ply(write_frames(views, frames, scene=index) / CLOUD, frames)
            seen = observation(empty_scene, arm.home, belief)
            shares = known_after(empty_scene, frames, axial_noise(frames, empty_scene.cabinet))
            views_known = [(f.T_world_camera, k) for f, k in zip(frames, shares)]
            unknown = voxels.ranges(unknown_mask(voxels, belief.bodies))
            document = observation_to_json(seen.boxes, seen.regions, views_known, voxels.known, voxels.state.shape, unknown)
            found = "" if scene.target in seen.boxes else f", the target {scene.target} not among them"
            say(f"{scene.id}: {len(frames)} views, {100 * voxels.known:.1f} % known, {len(seen.boxes)} objects{found}; {reason}")
            write(replace(scene, observation=document))
            advance()
    return 0


def look(scene: Scene, arm: Robot, limits: Limits, noise: bool, rng: np.random.Generator) -> tuple[tuple[Frame, ...], Voxels, str]:
    """Take views of a scene with the synthetic camera, the arm at home first."""
    from perception.camera import DepthNoise
    from perception.mapping.voxels import unknown_voxels
    from perception.rendering.synthetic_camera import synthetic_camera
    from planning.motion.pick_place import Motions
    from planning.sensing.look_around import look_around

    model = DepthNoise() if noise else None
    camera = synthetic_camera(arm, scene, scene.poses(), noise=model, rng=rng)
    empty_scene = replace(scene, objects=(), observation=None)
    motions = Motions(arm, empty_scene)
    q, blocked = motions.start().q, motions.start_blocked()
    if blocked is not None:
        raise ValueError(f"the arm can't begin where the scene's q_start has it: {blocked}")
    nothing = unknown_voxels(scene.cabinet)
    looked = look_around(empty_scene, arm, camera, q, nothing, rng, limits=limits, noise_1m_m=model.axial_1m_m if model else 0.0)
    return looked.frames, looked.voxels, looked.reason


def fuse(empty_scene: Scene, frames: tuple[Frame, ...], noise: float) -> Voxels:
    """The map that recorded frames give."""
    return _maps(empty_scene, frames, noise)[-1]


def known_after(empty_scene: Scene, frames: tuple[Frame, ...], noise: float) -> list[float]:
    """The share known after each frame."""
    return [voxels.known for voxels in _maps(empty_scene, frames, noise)[1:]]


def _maps(empty_scene: Scene, frames: tuple[Frame, ...], noise: float) -> list[Voxels]:
    from perception.mapping.voxels import unknown_voxels

    maps = [unknown_voxels(empty_scene.cabinet)]
    for f in frames:
        maps.append(maps[-1].fuse(f.depth, f.intrinsics, f.T_world_camera, own=f.arm, noise_1m_m=noise))
    return maps


def parse_box(text: str, command: str = "sense") -> Array:
    """Six numbers with commas: centre and size, metres, in the world. Raises InputError."""
    import numpy as np

    try:
        box = np.array([float(v) for v in text.split(",")])
    except ValueError:
        box = np.zeros(0)
    if box.shape != (6,) or not np.isfinite(box).all() or (box[3:] <= 0).any():
        raise InputError(f"{command}: --target-box {text!r}: six numbers are needed, cx,cy,cz,dx,dy,dz: centre and positive size in metres")
    return box


def _is_one(folder: Path) -> bool:
    """Whether a folder is one recording, not a folder of them."""
    return (folder / "scene_camera.json").is_file()
