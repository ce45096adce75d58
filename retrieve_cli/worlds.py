"""A world of the user's own, MODULE:FUNCTION, for `retrieve plan --sense --world`; what it does wrong is told with its name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from kinematics.errors import InputError
from retrieve_cli.own_code import answering, own_function

if TYPE_CHECKING:
    from kinematics.robots.robot import Robot
    from kinematics.scene import Scene
    from perception.frames import Frame
    from planning.plan import Motion
    from planning.sensing.world import Stopped

METHODS = ("take_frame", "execute", "where")


class OwnWorld:
    """A user's object, each of its methods answering for what it raises and for what it returns."""

    def __init__(self, spec: str, own: Any) -> None:
        self._spec, self._own = spec, own
        if (intrinsics := getattr(own, "intrinsics", None)) is not None:
            self.intrinsics = intrinsics

    def take_frame(self) -> Frame:
        """Without what a depth camera makes up."""
        from perception.frames import Frame, checked
        from perception.recorded import trusted

        frame: Frame = self._asked("take_frame", Frame)
        with answering(f"--world {self._spec}: take_frame"):
            return trusted(checked(frame))

    def execute(self, motions: Sequence[Motion]) -> Stopped | None:
        from planning.sensing.world import Stopped

        stopped = self._asked("execute", (Stopped, type(None)), motions)
        if stopped is not None and not (isinstance(stopped.motion, int) and 0 <= stopped.motion < len(motions)):
            what = stopped.motion if isinstance(stopped.motion, int) else f"a {type(stopped.motion).__name__}"
            how = "Stopped takes the motion's number, from 0, and why"
            raise InputError(f"--world {self._spec}: execute: it stopped in motion {what}, of {len(motions)}; {how}")
        return stopped  # type: ignore[no-any-return]

    def where(self) -> Mapping[str, float]:
        """Where the arm's joints (J,) and what is held are, as the user's world says."""
        return self._asked("where", Mapping)  # type: ignore[no-any-return]

    def _asked(self, method: str, kind: Any, *given: object) -> Any:
        with answering(f"--world {self._spec}: {method}"):
            answer = getattr(self._own, method)(*given)
        if not isinstance(answer, kind):
            wanted = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
            raise InputError(f"--world {self._spec}: {method}: returned a {type(answer).__name__}, and a {wanted} is expected")
        return answer


def own_world(spec: str, scene: Scene, robot: Robot) -> OwnWorld:
    """The object that FUNCTION(scene, robot) of MODULE returns; MODULE is a module's name or a Python file.

    Raises: InputError, with the module, the function and the exception.
    """
    make = own_function("--world", spec)
    with answering(f"--world {spec}"):
        own = make(scene, robot)
    if missing := [m for m in METHODS if not callable(getattr(own, m, None))]:
        raise InputError(f"--world {spec}: a {type(own).__name__} has no {' and no '.join(missing)}; a world has {', '.join(METHODS)}")
    return OwnWorld(spec, own)


def as_it_is(world: OwnWorld, scene: Scene, robot: Robot) -> Scene:
    """The cell as a plan in a real world begins with it: the arm where it is, no objects, and a name for the target if it has none."""
    from dataclasses import replace

    from planning.sensing.world import configuration

    q = configuration(robot, world.where())
    here = replace(scene.robot, q_start=dict(zip(robot.joint_names, map(float, q))))
    return replace(scene, robot=here, objects=(), observation=None, target=scene.target or "target")
