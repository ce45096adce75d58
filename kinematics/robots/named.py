"""The named robots: what `robots.toml` says of them, and where the packages that ship them are installed."""

from __future__ import annotations

import tomllib
from importlib import metadata, resources
from pathlib import Path
from typing import Any


def named_robots() -> dict[str, dict[str, Any]]:
    """The table robots.toml: name to settings."""
    return tomllib.loads(resources.files("kinematics.robots").joinpath("robots.toml").read_text(encoding="utf-8"))


def installed(name: str) -> bool:
    """Whether the package that ships a named robot is installed."""
    return locate(named_robots()[name], "file") is not None


def locate(entry: dict[str, Any], which: str) -> Path | None:
    """A file of an installed distribution, or None."""
    if which not in entry:
        return None
    try:
        path = Path(str(metadata.distribution(entry["distribution"]).locate_file(entry[which])))
    except metadata.PackageNotFoundError:
        return None
    return path if path.is_file() else None
