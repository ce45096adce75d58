"""`retrieve sense`: look into the cabinet from the hand, and write the scenes with what was observed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kinematics.errors import InputError, blame, choose
from planning.io.files import UNREADABLE, read_scene_lines
from planning.io.observation_documents import observation_to_json
from planning.io.outputs import alone_in, naming
from planning.io.results import scene_writer
from retrieve_cli.terminal import announce_first_run, mesh_progress, progress, say, say_what_was_read
from retrieve_cli.version import version

if TYPE_CHECKING:
    import numpy as np

    from kinematics.robots.robot import Robot
    from kinematics.scene import Scene
    from kinematics.transforms import Array
    from perception.belief import Belief
    from perception.calibration import Calibration
    from perception.frames import Frame
    from perception.mapping.voxels import Voxels
    from planning.sensing.look_around import Limits

STAGE = 2  # this stage's word in the seeds of random generators
BY = ("mask", "geometry")
CLOUD = "cloud.ply"
HARDLY = 0.1  # a recording that shows less of the cabinet than this was told wrongly, as a rule
SPARSE = 0.3  # or more of its pixels than this measured nothing


@dataclass(frozen=True)
class _Job:
    """How to look, as the options of `retrieve sense` say it; box (6,) or pixel: where the target is, if anybody says so."""

    views: Path | None
    from_views: Path | None
    camera: Calibration | None
    max_views: int | None
    share: float | None
    noise: bool
    by: Literal["mask", "geometry"]
    box: Array | None
    pixel: tuple[int, int, int] | None
    seed: int
    smallest_m: float


@dataclass(frozen=True, eq=False)
class _Sight:
    """What the frames of one scene show. shares: of the space known after each frame; reason: why there are no more of them."""

    arm: Robot
    frames: tuple[Frame, ...]
    noise_1m_m: float
    voxels: Voxels
    shares: Sequence[float]
    belief: Belief
    reason: str


def run(
    *,
    scenes: Path | None,
    views: Path | None,
    from_views: Path | None,
    max_views: int | None,
    share: float | None,
    noise: bool,
    by: str,
    target_box: str | None,
    seed: int,
    out: Path | None,
    resume: bool = False,
    target_pixel: str | None = None,
    smallest_mm: float = 40.0,
    camera: Path | None = None,
) -> int:
    """Sense every scene; scene number i writes its frames to folder i of `views`, or takes them from folder i of `from_views`.

    A scene that lists no objects is given those that the recorded frames show.
    """
    choose("way to tell objects apart (--by)", by, BY)
    told_by: Literal["mask", "geometry"] = "mask" if by == "mask" else "geometry"
    box, pixel = None if target_box is None else parse_box(target_box), None if target_pixel is None else parse_pixel(target_pixel)
    if box is not None and pixel is not None:
        raise InputError("sense: --target-box and --target-pixel exclude each other: say once where the target is")
    if camera is not None and from_views is None:
        raise InputError("sense: --camera says the intrinsics of recorded frames: give them, --from-views DIR")
    lens = None if camera is None else calibrated(camera)
    job = _Job(views, from_views, lens, max_views, share, noise, told_by, box, pixel, seed, smallest_mm / 1e3)
    announce_first_run()
    asked = {"command": "sense", "version": version(), "seed": seed, "by": by, "noise": noise, "views": max_views, "share": share}
    asked |= {
        "target_box": target_box,
        "target_pixel": target_pixel,
        "smallest_mm": smallest_mm,
        "from_views": None if from_views is None else str(from_views.absolute()),
        "camera": None if camera is None else str(camera.absolute()),
    }
    with (
        nullcontext() if views is None else alone_in(views),
        scene_writer(out, asked=asked, resume=resume, tell=say) as write,
        progress("scenes", file=scenes, done=write.kept, out=out) as advance,
    ):
        lines = enumerate(read_scene_lines(scenes, "sense", on_mesh=mesh_progress))
        for index, line in write.left(lines, key=lambda numbered: numbered[1].key):
            if line.scene is None:
                raise InputError(line.error)
            say_what_was_read(line.where, line.scene)
            with blame(line.where, *UNREADABLE):
                sight = _look_at(job, line.scene, index)
            write(_described(job, line.scene, sight))
            advance()
    return 0


def _blind(scene: Scene) -> bool:
    """Whether nobody has told what is in the cabinet."""
    return all(b.source == "seen" for b in scene.objects)


def _look_at(job: _Job, scene: Scene, index: int) -> _Sight:
    """Take the frames of scene number `index`, or those that are recorded, and find the objects in them."""
    import numpy as np

    from kinematics.robots.load import from_ref
    from perception.belief import believe
    from perception.frames import write_frames, write_ply
    from perception.objects.prepared_frames import axial_noise
    from planning.sensing.recording import box_at_pixel, fused

    arm = from_ref(scene.robot, on_step=say)
    mapped: Voxels | None = None
    if job.from_views is not None:
        frames = recorded(arm, scene, job.from_views, index, job.camera)
        reason = f"{len(frames)} recorded views"
    elif _blind(scene):
        raise InputError("the scene lists no objects to look at: give recorded frames, --from-views DIR")
    else:
        rng = np.random.default_rng([job.seed, STAGE, scene.random_word])
        limits = limits_of(job.share, job.max_views, recording=job.views is not None)
        if job.views is None:
            frames, mapped, reason = look(scene, arm, limits, job.noise, rng)
        else:
            frames, mapped, reason = record(scene, arm, limits, job.noise, job.by, rng)
    noise_1m_m = axial_noise(frames, scene.cabinet)
    voxels, shares = fused(scene, frames, noise_1m_m)
    voxels = voxels if mapped is None else mapped
    target_box = job.box if job.pixel is None else box_at_pixel(frames, *_as_recorded(job, frames, *job.pixel))
    belief = believe(replace(scene, objects=(), observation=None), frames, voxels, by=job.by, target_box=target_box)
    if job.views is not None:
        with naming(job.views):
            write_ply(write_frames(job.views, frames, scene=index) / CLOUD, frames)
    return _Sight(arm, frames, noise_1m_m, voxels, shares, belief, reason)


def _described(job: _Job, scene: Scene, sight: _Sight) -> Scene:
    """The scene with what was observed, and with the bodies and the grasp that planning needs where nobody has told of objects."""
    from perception.belief import region_flags
    from planning.sensing.recording import may_hide, seen_bodies, seen_scene, with_grasp
    from planning.sensing.unknown_space import unknown_mask

    frames, voxels, belief, blind = sight.frames, sight.voxels, sight.belief, _blind(scene)
    if blind:
        bodies, pieces = seen_bodies(belief, scene)
        mapped, hidden = may_hide(scene, frames, sight.noise_1m_m, belief, bodies, pieces, job.smallest_m)
    else:
        mapped, hidden = voxels, unknown_mask(voxels, belief.bodies)
    views_known = [(f.T_world_camera, k) for f, k in zip(frames, sight.shares)]
    regions = region_flags(replace(scene, objects=(), observation=None), belief)
    camera = frames[-1].intrinsics if frames else None
    document = observation_to_json(belief.boxes, regions, views_known, voxels.known, mapped.state.shape, mapped.ranges(hidden), camera)
    sensed = with_grasp(sight.arm, seen_scene(scene, bodies, pieces, document)) if blind else replace(scene, observation=document)
    target = "" if sensed.target in belief.boxes else f", the target {scene.target} not among them" if scene.target else ", no target"
    say(f"{scene.id}: {len(frames)} views, {100 * voxels.known:.1f} % known, {len(belief.boxes)} objects{target}; {sight.reason}")
    if job.from_views is not None and not blind:
        say(f"{scene.id}: it lists objects of its own, and plans are made on those; with objects [] they are made on what was seen")
    if blind and voxels.known < HARDLY:
        say(f"{scene.id}: hardly any of the cabinet was seen: {_why_hardly(frames)}")
    if blind and sensed.grasp is not scene.grasp:
        say(f"{scene.id}: {'the grasp is fitted to' if scene.grasp else 'a grasp is proposed for'} the target as it was seen")
    elif blind and sensed.target is not None and sensed.grasp is None:
        say(f"{scene.id}: no grasp of the target as it was seen can be used; retrieve grasp says why, and takes grasps from elsewhere")
    return sensed


def _why_hardly(frames: Sequence[Frame]) -> str:
    """The likely cause: space is free only where all pixels of a place measured what is behind it."""
    import numpy as np

    missing = float(np.mean([np.mean(f.depth <= 0) for f in frames])) if frames else 0.0
    if missing > SPARSE:
        return (
            f"{100 * missing:.0f} % of the pixels measured nothing; was depth aligned to finer colour images? Coarser ones have fewer holes"
        )
    return "are depth_scale, cam_K and the poses (world to camera, mm) right?"


def calibrated(file: Path) -> Calibration:
    """What --camera FILE says, and a word where its lens is to be undone. Raises: InputError."""
    from perception.calibration import read_calibration

    with blame("sense: --camera", *UNREADABLE):
        camera = read_calibration(file)
    if camera.distortion:
        say(f"{camera.source}: its lens's distortion is taken out of depths and masks; for images that are rectified it must say zeros")
    return camera


def _as_recorded(job: _Job, frames: Sequence[Frame], frame: int, u: int, v: int) -> tuple[int, int, int]:
    """A pixel of a recorded image where it is once the lens's distortion is taken out."""
    from perception.distortion import pinhole_pixel

    if job.camera is None or not job.camera.distortion or frame >= len(frames):
        return frame, u, v
    return frame, *pinhole_pixel(frames[frame].intrinsics, job.camera.distortion, u, v)


def recorded(arm: Robot, scene: Scene, folder: Path, index: int, camera: Calibration | None = None) -> tuple[Frame, ...]:
    """The frames of scene number `index` in a folder, without what the camera made up. camera: in the place of their cam_K.

    Raises: InputError where they can't fit.
    """
    from perception.frames import read_frames
    from perception.recorded import misfit, trusted
    from perception.rendering.synthetic_camera import marked
    from perception.seen_through import without_seen_through

    base = scene.robot.T_world_base
    frames = marked(arm, base, [trusted(f) for f in read_frames(folder, scene=None if _is_one(folder) else index, camera=camera)])
    if why := misfit(frames, scene.cabinet, base, lambda doubt: say(f"{scene.id}: {doubt}")):
        raise InputError(f"--from-views {folder}: {why}")
    return tuple(without_seen_through(frames))


def limits_of(share: float | None, max_views: int | None, *, recording: bool) -> Limits:
    """When to stop: sooner for a first idea of a scene than for a recording, which is planned on without another look."""
    from planning.sensing.look_around import MAX_VIEWS, SHARE, Limits
    from planning.sensing.survey import RECORDING

    if not recording:
        return Limits(share=SHARE if share is None else share, views=max_views or MAX_VIEWS)
    return replace(RECORDING, share=RECORDING.share if share is None else share, views=max_views or RECORDING.views)


def record(
    scene: Scene, arm: Robot, limits: Limits, noise: bool, by: Literal["mask", "geometry"], rng: np.random.Generator
) -> tuple[tuple[Frame, ...], Voxels, str]:
    """Take the views of a scene that a plan needs with the synthetic camera, the arm at home first."""
    from perception.camera import DepthNoise
    from planning.sensing.belief_state import BeliefState
    from planning.sensing.settings import SensingSettings
    from planning.sensing.survey import survey
    from planning.sensing.world import SimulatedWorld

    model = DepthNoise() if noise else None
    world = SimulatedWorld(arm, scene, rng, model, by)
    mind = BeliefState(arm, scene, rng, SensingSettings(by, model.axial_1m_m if model else 0.0))
    if mind.start_blocked is not None:
        raise ValueError(f"the arm can't begin where the scene's q_start has it: {mind.start_blocked}")
    reason = survey(mind, world, limits)
    return tuple(mind.frames), mind.voxels, reason


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


def parse_pixel(text: str) -> tuple[int, int, int]:
    """Frame, column and row; the frame is 0 where only two numbers are given. Raises InputError."""
    try:
        numbers = [int(v) for v in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or min(numbers) < 0:
        raise InputError(f"sense: --target-pixel {text!r}: two or three whole numbers are needed, U,V or FRAME,U,V: column and row")
    frame, u, v = [0, *numbers][-3:]
    return frame, u, v


def _is_one(folder: Path) -> bool:
    """Whether a folder is one recording, not a folder of them."""
    return (folder / "scene_camera.json").is_file()
