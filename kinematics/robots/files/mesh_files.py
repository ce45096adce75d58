"""Where a URDF's mesh files are: beside it, in the packages of the folders above it, in the workspace, on the ROS search paths."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

SCHEMES = ("package://", "model://")
SEARCH_PATHS = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH")
"""Environment variables that hold folders with packages in or below them, the first one first."""
DEEP, LEVELS, MOST = 5, 6, 20_000
"""How deep below a folder packages are sought, in how many of the folders above a URDF, and how many folders are opened at most."""


def find_mesh(name: str, urdf: Path) -> Path:
    """A mesh's absolute path. Raises: FileNotFoundError with the places that were looked at."""
    name = name.strip().replace("\\", "/")
    if name.startswith(SCHEMES):
        package, _, rest = unquote(name.partition("://")[2]).partition("/")
        rest = rest.lstrip("/")
        found = _in_package(package, rest, urdf)
        if found is None:
            paths = [variable for variable in SEARCH_PATHS if os.environ.get(variable)]
            where = ", and ".join([f"the folders above {urdf.parent.absolute()}", *paths])
            home = find_package(package, urdf)
            mend = (
                f"; put the package's folder beside the URDF, or the one that holds it on {SEARCH_PATHS[0]}"
                if home is None
                else _spelt(home / rest)
            )
            raise FileNotFoundError(f"{rest} of the package {package!r}: looked in {where}{mend}")
        return found
    plain = unquote(name.removeprefix("file:").removeprefix("//")) if name.startswith("file:") else name
    path = (urdf.parent / plain).resolve()
    above = (folder / plain for folder in _workspace(urdf))  # relative to a package's root, say
    found = path if path.is_file() else None if Path(plain).is_absolute() else next((p for p in above if p.is_file()), None)
    if found is None:
        raise FileNotFoundError(f"{path}{_spelt(path)}")
    return found


def _spelt(path: Path) -> str:
    """Words on a file that is there in other capitals: some systems don't tell them apart, and others do."""
    there = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
    other = next((name for name in there if name != path.name and name.lower() == path.name.lower()), None)
    return f"; there is {other}: capitals count" if other else ""


def find_package(package: str, near: Path) -> Path | None:
    """A package's folder, from a file that is near it: the search paths first, then the workspace around the file."""
    on_paths = (Path(p) for variable in SEARCH_PATHS for p in os.environ.get(variable, "").split(os.pathsep) if p)
    for folder in on_paths:
        for candidate in (folder / "share" / package, folder / package, folder):
            if candidate.is_dir() and _name(candidate) == package:
                return candidate
        if package in (packages := _packages(folder)):
            return packages[package]
    for folder in _workspace(near):
        if package in (packages := _packages(folder)):
            return packages[package]
    above = (candidate for folder in _workspace(near) for candidate in (folder, folder / package))  # data without a package.xml
    return next((candidate for candidate in above if candidate.name == package and candidate.is_dir()), None)


def _in_package(package: str, rest: str, urdf: Path) -> Path | None:
    """A file of a package: most often the package, or its root, is a folder above the URDF."""
    for folder in urdf.resolve().parents:
        for candidate in (folder / package / rest, folder / rest):
            if candidate.is_file():
                return candidate
    home = find_package(package, urdf)
    return home / rest if home is not None and (home / rest).is_file() else None


def _workspace(near: Path) -> Iterator[Path]:
    """Folders above a file that may hold its workspace: not the user's home, nor any that holds it."""
    home = Path.home() if "HOME" in os.environ else Path("/")
    for folder in [p for p in near.resolve().parents if p != p.parent][:LEVELS]:
        if folder == home or folder in home.parents:
            return
        yield folder


@lru_cache(maxsize=32)
def _packages(top: Path) -> dict[str, Path]:
    """The packages (folders with a package.xml) in a folder, by name; the least deep ones win."""
    found, opened, level = dict[str, Path](), 0, [top]
    for _ in range(DEEP + 1):
        below = list[Path]()
        for folder in level:
            opened += 1
            if opened > MOST:
                return found
            try:
                entries = sorted(os.scandir(folder), key=lambda e: e.name)
            except OSError:
                continue
            if any(e.name == "package.xml" for e in entries):
                found.setdefault(_name(folder), folder)
                continue  # packages hold no packages
            below += [Path(e.path) for e in entries if not e.name.startswith(".") and e.is_dir(follow_symlinks=True)]
        level = below
    return found


def _name(folder: Path) -> str:
    """A package's name, as its package.xml has it, else the folder's."""
    from lxml import etree

    try:
        root = etree.fromstring((folder / "package.xml").read_bytes(), etree.XMLParser(recover=True))
    except (OSError, etree.XMLSyntaxError):
        return folder.name
    return (root.findtext("name") or folder.name).strip() if root is not None else folder.name
