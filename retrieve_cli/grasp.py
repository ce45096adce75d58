"""`retrieve grasp`: proposes x_g for a scene's target, or takes it from a grasp network's file; the best first, others as alternatives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.errors import InputError, blame, choose
from planning.io.files import read_scenes
from planning.io.results import scene_writer
from retrieve_cli.terminal import announce_first_run, mesh_progress, say

if TYPE_CHECKING:
    from kinematics.scene import Grasp, Scene
    from kinematics.transforms import Array
    from planning.target_grasps.proposals import Proposals


def run(
    *, scenes: Path | None, source: Path | None, convention: str | None, frame: str, most: int, png: Path | None, out: Path | None
) -> None:
    """Write every scene with its grasps; draw the first one's where `png` says.

    source: a file of grasps, in the frame `frame`; without it they are proposed on the target's shape.
    """
    from planning.io.grasp_files import CONVENTIONS
    from planning.target_grasps.proposals import propose, with_grasps

    if (source is None) != (convention is None):
        raise InputError(f"grasp: --from and --convention go together; the conventions are {', '.join(CONVENTIONS)}")
    if convention is not None:
        choose("convention", convention, CONVENTIONS)
    if png is not None and png.suffix.lower() != ".png":
        raise InputError(f"grasp: {png}: a still is a PNG file; give it a name that ends in .png")
    announce_first_run()
    first: Scene | None = None
    with scene_writer(out) as write:
        for where, scene in read_scenes(scenes, "grasp", on_mesh=mesh_progress):
            with blame(where):
                from kinematics.robots.load import from_ref

                arm = from_ref(scene.robot, on_step=say)
                if source is None or convention is None:
                    found = propose(arm, scene, most=most)
                else:
                    found = imported(scene, source, convention, frame, most)
                done = with_grasps(scene, found)
            tell(where, done, found)
            write(done)
            first = first or done
    if png is not None and first is not None:
        from retrieve_cli.show import draw_png

        draw_png(first, png)


def imported(scene: Scene, source: Path, convention: str, frame: str, most: int) -> Proposals:
    """The grasps of a file that hold the scene's target. Raises: InputError, ValueError."""
    from kinematics.robots.load import from_ref
    from planning.io.grasp_files import read_grasps
    from planning.target_grasps.imported import onto_target

    return onto_target(from_ref(scene.robot), scene, read_grasps(source, convention), frame_pose(scene, frame), most=most)


def frame_pose(scene: Scene, frame: str) -> Array:
    """T_world_frame (4, 4) of `world`, `base`, `view:K` (a sensed scene's view number K) or x,y,z,qw,qx,qy,qz. Raises InputError."""
    import numpy as np

    from kinematics.transforms import rotation_from_wxyz, transform

    if frame == "world":
        return np.eye(4)
    if frame == "base":
        return scene.robot.T_world_base
    if frame.startswith("view:"):
        views = scene.observation["views"] if scene.observation else None
        number = frame.removeprefix("view:")
        if not isinstance(views, list) or not number.isdigit() or int(number) >= len(views):
            have = f"views 0 to {len(views) - 1}" if isinstance(views, list) and views else "no views: retrieve sense makes some"
            raise InputError(f"grasp: --frame {frame}: scene {scene.id} has {have}")
        pose = views[int(number)]["T_world_camera"]
        return transform(rotation_from_wxyz(np.array(pose["q_wxyz"], float)), pose["p"])
    try:
        numbers = np.array([float(v) for v in frame.split(",")])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (7,) or not np.isfinite(numbers).all() or abs(np.linalg.norm(numbers[3:]) - 1) > 1e-3:
        raise InputError(f"grasp: --frame {frame}: world, base, view:K or x,y,z,qw,qx,qy,qz, the camera's pose in the world, is expected")
    return transform(rotation_from_wxyz(numbers[3:] / np.linalg.norm(numbers[3:])), numbers[:3])


def tell(where: str, scene: Scene, found: Proposals) -> None:
    """What was found, on stderr: the best few in words."""
    say(f"{where}: {scene.target_name}: {found}")
    for rank, (grasp, score) in enumerate(found.grasps[:3], 1):
        say(f"  {rank}. score {score:.2f}: {1000 * grasp.width_m:.0f} mm wide, the hand looks {looks(grasp)}")


def looks(grasp: Grasp) -> str:
    """Where a hand looks, in words: yaw in the world, and how far down; straight down or up, the yaw along which its fingers close."""
    import numpy as np

    closing, ahead = grasp.T_world_hand[:3, 1], grasp.T_world_hand[:3, 2]
    down = float(np.degrees(np.arcsin(np.clip(-ahead[2], -1, 1))))
    if abs(down) > 89.5:
        along = round(float(np.degrees(np.arctan2(closing[1], closing[0])))) % 180
        return f"straight {'down' if down > 0 else 'up'}, its fingers close along yaw {along}°"
    yaw = round(float(np.degrees(np.arctan2(ahead[1], ahead[0]))))
    return f"along yaw {yaw}°, {down:.0f}° down" if round(down) else f"along yaw {yaw}°, level"
