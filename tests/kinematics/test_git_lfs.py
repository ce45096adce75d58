"""A pointer of Git LFS in a file's place is named wherever files are read: a clone without git-lfs has such."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from kinematics.robots.files.urdf import read
from kinematics.robots.limits import read_tables
from perception.calibration import read_calibration
from perception.image_files import read_grey
from perception.masks import read_json
from planning.io.checked import parse_json
from planning.io.grasp_files import _arrays
from planning.scenes.generation import load_spec
from retrieve_cli.scene import _read_yaml

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1611284\n"


def as_image(file: Path) -> object:
    return read_grey(file, None)


def as_spec(file: Path) -> object:
    return load_spec(str(file))


def as_line(file: Path) -> object:
    return parse_json(file.read_text().splitlines()[0], f"{file}:1")


@pytest.mark.parametrize(
    ("name", "reader"),
    [
        ("cell.yaml", _read_yaml),
        ("0.png", as_image),
        ("scene_camera.json", read_json),
        ("camera_info.yaml", read_calibration),
        ("arm.urdf", read),
        ("arm.urdf.xacro", read),
        ("limits.toml", read_tables),
        ("spec.toml", as_spec),
        ("grasps.npz", _arrays),
        ("scenes.jsonl", as_line),
    ],
)
def test_a_pointer_is_named(name: str, reader: Callable[[Path], object], tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_text(POINTER)
    with pytest.raises(ValueError, match=rf"{name}.* is a pointer of Git LFS.*`git lfs pull`"):
        reader(file)


def test_what_is_none_is_read(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text(json.dumps({"version": "https://git-lfs.github.com/spec/"}))
    assert read_json(file) == {"version": "https://git-lfs.github.com/spec/"}
