"""What `gen` makes: the same bytes for the same seed, scenes within their spec, blocked at first and solvable when emptied; and `plan`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from conftest import Json
from documents import SCHEMAS

from kinematics.collision.fcl_solids import gap, shape_solids
from kinematics.robots.load import to_ref
from kinematics.robots.robot import Robot
from kinematics.scene import APPROACHES, Body, RobotRef, Scene
from kinematics.shapes import Cylinder
from kinematics.transforms import inverse, transform
from planning.io.scene_documents import scene_from_json, scene_to_json
from planning.motion.pick_place import Motions
from planning.plan import Blocked
from planning.scenes.generation import SPECS, NoScene, Spec, generate, load_spec

ROOT = Path(__file__).resolve().parents[3]
N, SEED = 4, 5  # scenes of each spec
MEASURED = {"planning_time_s", "motion_time_s"}


def retrieve(*args: str | Path, stdin: str = "") -> str:
    """Run the program in a process of its own; hashes are salted differently each time."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONHASHSEED"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "retrieve_cli", *map(str, args)],
        input=stdin, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def five() -> str:
    return retrieve("gen", "-n", "5", "--seed", "3")


def make(ur5e: Robot, spec: Spec, index: int, seed: int = SEED) -> Scene:
    return generate(spec, ur5e, to_ref(ur5e), seed, index)


@pytest.fixture(scope="module", params=SPECS)
def made(request: pytest.FixtureRequest, ur5e: Robot) -> tuple[Spec, list[Scene]]:
    """A few scenes of each spec that ships; of those with large cabinets, where valid ones are rare, two."""
    spec = load_spec(request.param)
    return spec, [make(ur5e, spec, i) for i in range(N if spec.cabinet_size_to_m is None else 2)]


# Same seed, same bytes ------------------------------------------------------------------------------------------------------------------


def test_same_seed_same_scenes_and_fewer_are_the_beginning_of_more(five: str) -> None:
    assert retrieve("gen", "-n", "5", "--seed", "3") == five
    three = retrieve("gen", "-n", "3", "--seed", "3")
    assert three.count("\n") == 3
    assert five.startswith(three)


def test_another_seed_other_scenes(five: str) -> None:
    other = json.loads(retrieve("gen", "-n", "1", "--seed", "4"))
    assert other["seed"] == [4, 0]
    assert all(other["objects"] != json.loads(line)["objects"] for line in five.splitlines())


def test_a_scene_depends_on_nothing_but_its_number(five: str, ur5e: Robot) -> None:
    """Made alone, and in this process, scene 4 is the fifth line."""
    alone = json.dumps(scene_to_json(make(ur5e, load_spec("paper"), 4, 3)), ensure_ascii=False)
    assert alone == five.splitlines()[4]


@pytest.mark.parametrize("policy", ["random", "local"])
def test_same_seed_same_plans_apart_from_the_measured_times(policy: str, five: str) -> None:
    some = "".join(five.splitlines(keepends=True)[:3])
    runs = [retrieve("plan", "--policy", policy, "--seed", "7", stdin=some).splitlines() for _ in range(2)]
    once, again = ([_without(json.loads(line), MEASURED) for line in lines] for lines in runs)
    assert len(once) == 3
    assert [json.dumps(plan) for plan in once] == [json.dumps(plan) for plan in again]
    assert any(plan["motions"] for plan in once)


def _without(document: Json, names: set[str]) -> Json:
    assert names <= document.keys()
    return {k: v for k, v in document.items() if k not in names}


# What a scene is ------------------------------------------------------------------------------------------------------------------------


def test_scenes_keep_to_the_schema_and_read_back(made: tuple[Spec, list[Scene]]) -> None:
    schema = json.loads((SCHEMAS / "scene.schema.json").read_text())
    for scene in made[1]:
        document = scene_to_json(scene)
        jsonschema.validate(document, schema)
        back = scene_to_json(scene_from_json(json.loads(json.dumps(document))))
        assert _rounded(back) == _rounded(document)  # a quaternion may come back with another last bit


def _rounded(value: Any) -> Any:
    match value:
        case float():
            return round(value, 12) + 0.0
        case list():
            return [_rounded(v) for v in value]
        case dict():
            return {k: _rounded(v) for k, v in value.items()}
    return value


def test_scenes_are_blocked_at_first_and_solvable_when_emptied(made: tuple[Spec, list[Scene]], ur5e: Robot) -> None:
    """Judged with other random numbers than gen used."""
    for scene in made[1]:
        cluttered = Motions(ur5e, scene)
        assert isinstance(cluttered.retrieve_target(cluttered.start(), np.random.default_rng(99)), Blocked), scene.id
        empty = Motions(ur5e, Scene(**{**vars(scene), "objects": (scene.body(scene.target),)}))
        assert not isinstance(empty.retrieve_target(empty.start(), np.random.default_rng(99)), Blocked), scene.id


def test_scenes_keep_to_their_spec(made: tuple[Spec, list[Scene]]) -> None:
    spec, scenes = made
    for scene in scenes:
        cabinet = scene.cabinet
        largest = spec.cabinet_size_m if spec.cabinet_size_to_m is None else spec.cabinet_size_to_m
        assert np.all((spec.cabinet_size_m <= cabinet.size_m) & (cabinet.size_m <= largest))
        np.testing.assert_array_equal(cabinet.T_world_cabinet[:3, 3], [spec.cabinet_front_m, 0.0, spec.cabinet_floor_m])
        assert (cabinet.wall_m, scene.regions_n, scene.approaches) == (spec.cabinet_wall_m, spec.regions_n, spec.moves_approaches)
        assert spec.objects_count[0] <= len(scene.objects) <= spec.objects_count[1]
        for body in scene.objects:
            half, target = body.shape.half, body.name == scene.target
            if not spec.objects_household:
                low, high = spec.target_half_width_m if target else spec.objects_half_width_m
                assert np.all((low <= half[:2]) & (half[:2] <= high))
                assert spec.objects_height_m[0] <= 2 * half[2] <= spec.objects_height_m[1]
                assert body.name.startswith("can_" if isinstance(body.shape, Cylinder) else "box_")
            near, far = np.multiply(spec.target_depth_share, cabinet.size_m[0]) if spec.target_depth_share else spec.target_depth_m
            T = inverse(cabinet.T_world_cabinet) @ body.T_world_body
            np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-12)  # upright
            assert T[2, 3] == pytest.approx(half[2], abs=1e-12)  # on the floor
            assert not target or near <= T[0, 3] <= far
        assert len({b.name for b in scene.objects}) == len(scene.objects)
        solids = [*scene.objects, *cabinet.walls()[2:]]
        for i, body in enumerate(scene.objects):
            assert min(_gap(body, other) for other in solids[i + 1 :]) >= spec.objects_gap_m - 1e-6
        T_hand = scene.grasp.T_world_hand
        assert abs(T_hand[2, 2]) < 1e-9  # horizontal, its x up
        np.testing.assert_allclose(T_hand[:3, 0], [0, 0, 1], atol=1e-9)
        target = scene.body(scene.target)
        assert scene.grasp.width_m == pytest.approx(2 * min(target.shape.half[:2], key=lambda h: abs(2 * h - scene.grasp.width_m)))


def _gap(a: Body, b: Body) -> float:
    one, two = ([s.move(x.T_world_body) for s in shape_solids(x.name, x.shape)] for x in (a, b))
    return min(gap(p, q, 1.0) for p in one for q in two)


def test_the_target_has_no_fixed_place_in_the_list(made: tuple[Spec, list[Scene]], ur5e: Robot) -> None:
    places = {[b.name for b in scene.objects].index(scene.target) for scene in made[1]}
    assert len(places) > 1


# Specs ----------------------------------------------------------------------------------------------------------------------------------


def test_the_specs_that_ship() -> None:
    assert SPECS == ("paper", "paper-any", "shelf", "hard", "hard-any", "lab-s", "lab-l")
    paper, anyhow, shelf = map(load_spec, SPECS[:3])
    np.testing.assert_array_equal(paper.cabinet_size_m, [0.56, 0.86, 0.50])
    assert paper.moves_approaches == ("horizontal",)
    assert set(anyhow.moves_approaches) == set(APPROACHES)
    assert _values(paper, "moves") == _values(anyhow, "moves")
    assert shelf.cabinet_size_m[2] == 0.35
    assert load_spec(str(ROOT / "planning" / "scenes" / "specs" / "shelf.toml")).cabinet_floor_m == shelf.cabinet_floor_m
    hard, hard_any = load_spec("hard"), load_spec("hard-any")
    assert {k for k, v in vars(hard).items() if not np.array_equal(v, getattr(shelf, k))} == {"objects_count", "target_depth_m"}
    assert {k for k, v in vars(hard_any).items() if not np.array_equal(v, getattr(anyhow, k))} == {"objects_count", "target_depth_m"}


def test_household_objects_are_what_their_names_say(ur5e: Robot) -> None:
    """Kinds keep their proportions and their names; x_g is no wider than the gripper."""
    spec = load_spec("lab-s")
    kinds = {kind.name: np.array(kind.size_m) for kind in spec.objects_household}
    scene = make(ur5e, spec, 0, seed=9)
    for body in scene.objects:
        kind = kinds[body.name.rsplit("_", 1)[0]]
        own = np.array([body.shape.radius_m, body.shape.height_m]) if isinstance(body.shape, Cylinder) else 2 * body.shape.half
        scale = own / kind
        assert scale.max() - scale.min() < 1e-9
        assert 0.9 <= scale[0] <= 1.1
    assert scene.x_g.width_m < ur5e.opening.max_m


def _values(spec: Spec, but: str) -> dict[str, Any]:
    return {k: np.asarray(v).tolist() for k, v in vars(spec).items() if not k.startswith(but)}


@pytest.mark.parametrize(("which", "says"), [("ppaer", r"'ppaer' \(did you mean 'paper'\?\): "), ("none.toml", "spec 'none.toml': ")])
def test_an_unknown_spec(which: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        load_spec(which)


def test_nothing_is_higher_than_its_cabinet(ur5e: Robot) -> None:
    """Where a spec's heights go beyond the ceiling, what fits is drawn: plan refuses the rest."""
    for index in range(3):
        scene = make(ur5e, replace(load_spec("paper"), objects_height_m=(0.08, 0.7), objects_count=(4, 4)), index, seed=4)
        assert all(2 * body.shape.half[2] < scene.cabinet.size_m[2] for body in scene.objects)


def test_a_spec_that_is_never_valid_is_given_up(ur5e: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a number of samples, not of seconds; each is told. (The judge is a stand-in: the real one would take half a minute.)"""
    told: list[str] = []
    monkeypatch.setattr("planning.scenes.generation._judge", lambda *_: "unsolvable")
    says, at = "robot ur5e can't reach into this cabinet, level as x_g is, or nothing ever blocks the target", transform(p=ur5e.base_p)
    with pytest.raises(NoScene, match=f"{says}$"):
        generate(load_spec("paper"), ur5e, RobotRef(at, "ur5e"), 0, 0, on_step=told.append)
    assert set(told) == {"unsolvable"}
    with pytest.raises(NoScene, match=f"{says}; --fit puts the cabinet where it reaches$"):
        generate(load_spec("paper"), ur5e, RobotRef(at, urdf="my.urdf"), 0, 0)


@pytest.fixture
def own_spec(tmp_path: Path) -> Callable[..., Spec]:
    """The paper's spec with some of its text replaced, read back from a file."""

    def write(*changes: tuple[str, str]) -> Spec:
        text = (ROOT / "planning" / "scenes" / "specs" / "paper.toml").read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new, 1)
        file = tmp_path / "own.toml"
        file.write_text(text, encoding="utf-8")
        return load_spec(str(file))

    return write


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            [("[target]", "[objects.household]\ncup = [0.03, 0.1]\n\n[target]")],
            r"objects.box_share says what objects.household says otherwise",
        ),
        ([("box_share = 0.5", "")], r"objects.box_share is missing"),
    ],
)
def test_a_spec_says_things_in_one_way_only(own_spec: Callable[..., Spec], changes: list[tuple[str, str]], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        own_spec(*changes)


@pytest.mark.parametrize(("kinds", "says"), [("cup = [0.03]", r"cup: \[0.03\] is neither the sides"), ("", r"\{\} is no table of kinds")])
def test_kinds_of_objects_have_sizes(tmp_path: Path, kinds: str, says: str) -> None:
    text = (ROOT / "planning" / "scenes" / "specs" / "lab-s.toml").read_text(encoding="utf-8")
    before, after = text.split("[objects.household]")[0], text[text.index("[target]") :]
    (tmp_path / "own.toml").write_text(f"{before}[objects.household]\n{kinds}\n\n{after}", encoding="utf-8")
    with pytest.raises(ValueError, match=says):
        load_spec(str(tmp_path / "own.toml"))


def test_a_spec_of_ones_own(ur5e: Robot, own_spec: Callable[..., Spec]) -> None:
    spec = own_spec(("count = [4, 10]", "count = [3, 3]"), ("box_share = 0.5", "box_share = 0.0"), ("n = 10", "n = 4"))
    scene = make(ur5e, spec, 0)
    assert len(scene.objects) == 3
    assert all(isinstance(b.shape, Cylinder) for b in scene.objects)
    assert len(scene.regions()) == 16
