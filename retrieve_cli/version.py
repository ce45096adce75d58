"""Which version of the program this is."""

from __future__ import annotations

from pathlib import Path


def version() -> str:
    """The version of this program: of the checkout it runs from, else of the installed distribution."""
    project = Path(__file__).resolve().parent.parent / "pyproject.toml"
    if project.is_file():
        import tomllib

        return str(tomllib.loads(project.read_text(encoding="utf-8"))["project"]["version"])
    from importlib.metadata import version as installed

    return installed("retrieve")
