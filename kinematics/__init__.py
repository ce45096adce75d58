"""Where things are and whether they touch: robots, scenes, forward and inverse kinematics, collision. Knows no goal.

Numba caches compiled code per file and does not notice a change in a function that it calls in another file. So compiled code is kept
apart by a hash of the sources, under the user's cache folder; set before numba is imported, which happens in the modules below.
"""

from __future__ import annotations

import hashlib as _hashlib
import os as _os
from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import TYPE_CHECKING


def _sources() -> str:
    home = _Path(__file__).resolve().parent.parent
    files = sorted(f for name in ("kinematics", "perception", "planning") for f in (home / name).rglob("*.py"))
    texts = [f.read_bytes() for f in files]
    compiled = [text for text in texts if b"numba" in text or b"kinematics.jit" in text]
    return _hashlib.sha256(b"".join([str(home).encode(), *compiled])).hexdigest()[:16]


_cache = _Path(_os.environ.get("XDG_CACHE_HOME") or _Path.home() / ".cache") / "retrieve"
_os.environ.setdefault("NUMBA_CACHE_DIR", str(_cache / f"compiled-{_sources()}"))

if TYPE_CHECKING:
    from kinematics.errors import InputError, RetrieveError
    from kinematics.robots.robot import Robot, load, named_robots
    from kinematics.scene import Body, Cabinet, Grasp, Held, RobotRef, Scene, State
    from kinematics.shapes import Box, ConvexMesh, Cylinder, load_mesh

__all__ = [
    "Body",
    "Box",
    "Cabinet",
    "ConvexMesh",
    "Cylinder",
    "Grasp",
    "Held",
    "InputError",
    "RetrieveError",
    "Robot",
    "RobotRef",
    "Scene",
    "State",
    "load",
    "load_mesh",
    "named_robots",
]

_WHERE = {
    "Body": "kinematics.scene",
    "Box": "kinematics.shapes",
    "Cabinet": "kinematics.scene",
    "ConvexMesh": "kinematics.shapes",
    "Cylinder": "kinematics.shapes",
    "Grasp": "kinematics.scene",
    "Held": "kinematics.scene",
    "InputError": "kinematics.errors",
    "RetrieveError": "kinematics.errors",
    "Robot": "kinematics.robots.robot",
    "RobotRef": "kinematics.scene",
    "Scene": "kinematics.scene",
    "State": "kinematics.scene",
    "load": "kinematics.robots.robot",
    "load_mesh": "kinematics.shapes",
    "named_robots": "kinematics.robots.robot",
}


def __getattr__(name: str) -> object:
    """What `__all__` offers is imported when it is first asked for, so that importing the package costs nothing."""
    if name in _WHERE:
        return getattr(_import_module(_WHERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
