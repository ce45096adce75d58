"""A world of the user's own, MODULE:FUNCTION, for `retrieve plan --sense --world`; what it does wrong is told with its name."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.errors import InputError, did_you_mean, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator

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
        from perception.frames import Frame
        from perception.recorded import trusted

        frame: Frame = self._asked("take_frame", Frame)
        return trusted(frame)

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
        with _answering(f"--world {self._spec}: {method}"):
            answer = getattr(self._own, method)(*given)
        if not isinstance(answer, kind):
            wanted = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
            raise InputError(f"--world {self._spec}: {method}: returned a {type(answer).__name__}, and a {wanted} is expected")
        return answer


def own_world(spec: str, scene: Scene, robot: Robot) -> OwnWorld:
    """The object that FUNCTION(scene, robot) of MODULE returns; MODULE is a module's name or a Python file.

    Raises: InputError, with the module, the function and the exception.
    """
    make = _function(spec)
    with _answering(f"--world {spec}"):
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


def _function(spec: str) -> Callable[[Scene, Robot], Any]:
    module_name, colon, name = spec.rpartition(":")
    if not colon or not module_name or not name.isidentifier():
        raise InputError(f"--world {spec}: MODULE:FUNCTION is expected, e.g. my_cell:world or my_cell.py:world")
    with _answering(f"--world {spec}"):
        module = _from_file(Path(module_name)) if module_name.endswith(".py") else _by_name(module_name)
    found = getattr(module, name, None)
    if not callable(found):
        raise InputError(f"--world {spec}: {module_name} has no function {name!r}{did_you_mean(name, dir(module))}")
    return found  # type: ignore[no-any-return]


def _by_name(name: str) -> Any:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    return importlib.import_module(name)


def _from_file(file: Path) -> Any:
    if not file.is_file():
        raise InputError(f"--world: {file}: no such file")
    name = f"own_world_{file.stem}"
    found = importlib.util.spec_from_file_location(name, file)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules[name] = module  # dataclasses look their module up
    found.loader.exec_module(module)
    return module


@contextmanager
def _answering(where: str) -> Iterator[None]:
    """Turn whatever a user's code raises into one line; --debug shows the rest."""
    try:
        yield
    except InputError:
        raise
    except Exception as e:
        raise InputError(f"{where}: {type(e).__name__}: {one_line(e)}") from e
