"""Where a cabinet stands for an arm, what is put into it, and that the arm takes that from almost everywhere in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from six_joints import arm, box, joint

from kinematics.robots.load import load
from kinematics.robots.robot import Robot
from kinematics.scene import Body, Cabinet, RobotRef, Scene
from kinematics.shapes import Cylinder, box_corners
from kinematics.transforms import Array, rotation_about, transform
from planning import plan_scene
from planning.grasping.cup_grasps import grasps_on
from planning.motion.cell.arm import arm_at
from planning.motion.handling.object_grasps import _holds_round, headings_of
from planning.motion.pick_place import Motions
from planning.motion.settings import UNCONSTRAINED
from planning.scenes.fitting import fit as fitting
from planning.scenes.fitting import trials
from planning.scenes.fitting.fit import SCENES, THINNER, Fitted, _facing, fit
from planning.scenes.fitting.places import BESIDE_M, Place, _amid, is_beside, promising
from planning.scenes.fitting.sizes import cut, fewer, not_too_slim, of_one_kind, scaled, slimmed
from planning.scenes.fitting.trials import ALONG, Trial, held_heights, not_held, one_shape, share, solved
from planning.scenes.generation import NoScene, Spec, generate, load_spec
from planning.verdict import judge_grasp

SPEC = load_spec("paper")


def _joint(name: str, kind: str, parent: str, child: str, at: str, axis: str, most: float) -> str:
    least = -most if kind == "revolute" else 0.0
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/><axis xyz="{axis}"/>'
        f'<limit lower="{least}" upper="{most}" velocity="1" effort="1"/></joint>'
    )


def _hand(palm: str) -> str:
    """An arm of six joints whose fingers are 50 mm long and open 80 mm, on such a palm."""
    links = "".join(f'<link name="l{i}">{box("0.05 0.05 0.15", "0 0 0.09")}</link>' for i in range(1, 6))
    joints = "".join(
        _joint(f"a{i}", "revolute", f"l{i - 1}" if i else "base", f"l{i}" if i < 5 else "palm", "0 0 0.2", f"0 {i % 2} {1 - i % 2}", 2.5)
        for i in range(6)
    )
    links = links.replace('name="l5"', 'name="l0"')
    fingers = "".join(f'<link name="{f}">{box("0.02 0.01 0.05", f"0 {y} 0.025")}</link>' for f, y in (("f1", 0.005), ("f2", -0.005)))
    slides = "".join(_joint(f"j{f}", "prismatic", "palm", f, "0 0 0.05", f"0 {y} 0", 0.04) for f, y in (("f1", 1), ("f2", -1)))
    base = f'<link name="base">{box("0.1 0.1 0.1", "0 0 0")}</link>'
    return f'<robot name="r">{base}{links}{joints}<link name="palm">{palm}</link>{fingers}{slides}</robot>'


ARM = _hand(box("0.04 0.2 0.04", "0 0 0.03"))


def block(size: tuple[float, float, float], at: tuple[float, float, float]) -> Array:
    return np.asarray(box_corners(np.array(size) / 2) + np.array(at))


def test_a_cabinet_stands_within_a_frame_that_is_fixed_to_the_base() -> None:
    """Posts on both sides and a beam above, all of which reach further ahead than its front."""
    depth, width, height = SPEC.cabinet_size_m
    aside, above = width / 2 + SPEC.cabinet_wall_m + 2 * BESIDE_M, 0.1 + height + SPEC.cabinet_wall_m + 2 * BESIDE_M
    frame = [block((2.0, 0.02, 2.0), (0.5, s * (aside + 0.01), 0.5)) for s in (1, -1)] + [block((2.0, 2.0, 0.02), (0.5, 0.0, above + 0.01))]
    assert is_beside(SPEC, Place(0.3, 0.1), frame)
    assert not is_beside(SPEC, Place(0.3, 0.1 + 1.5 * BESIDE_M), frame)
    assert not is_beside(SPEC, Place(0.3, 0.1), [*frame, block((0.02, 0.02, 0.3), (0.3 + depth / 2, 0.0, 0.2))])
    assert is_beside(SPEC, Place(0.3, 0.1), [])


def test_above_a_table_that_the_arm_stands_on_there_are_places_too(tmp_path: Path) -> None:
    """A table that is as high as the arm is long, and reaches further ahead than the arm: before it nothing is in reach."""
    file, table, reach = tmp_path / "arm.urdf", 1.2, 0.9
    on_it = f'<link name="floor">{box(f"2 2 {table}", f"0 0 {table / 2}")}</link>'
    stands = f'<joint name="s" type="fixed"><parent link="floor"/><child link="base"/><origin xyz="0 0 {table + 0.05}"/></joint>'
    file.write_text(ARM.replace("</robot>", f"{on_it}{stands}</robot>"))
    ref = RobotRef(np.eye(4), urdf=str(file))
    scene = trials.with_shapes(SPEC, ref, [one_shape(SPEC, 0.5, boxes=False)])
    *before, above = promising(arm_at(load(str(file)), np.eye(4)), SPEC, scene, reach)
    assert all(place.front > 1.0 for places in before for place in places)
    assert above
    assert all(place.front < 1.0 and place.floor > table + SPEC.cabinet_wall_m for place in above)


def test_a_cabinet_that_is_small_beside_the_reach_finds_a_place(tmp_path: Path) -> None:
    """As an industrial arm of 3 m has it, and one with a small gripper: so near together are the places that some lie in it."""
    file = tmp_path / "arm.urdf"
    file.write_text(ARM)
    here, small = arm_at(load(str(file)), np.eye(4)), replace(scaled(SPEC, 0.25), grasp_bearing_share=1.0)
    scene = trials.with_shapes(small, RobotRef(np.eye(4), urdf=str(file)), [one_shape(small, 0.5, boxes=False)])
    places = next(promising(here, small, scene, 1.2), [])
    assert places
    full = [(place.front, place.floor) for place in places if place.depth == place.width == 1.0]
    assert full[0][0] > min(front for front, _ in full)  # nor at the edge of where it reaches: of KR 210 the cabinet hung 2.6 m high
    assert full[0][1] < max(floor for _, floor in full)


def test_amid_are_places_with_others_as_good_around() -> None:
    worths = np.full((5, 5), 1.0)
    rings = [[0, 0, 0, 0, 0], [0, 1, 1, 1, 0], [0, 1, 2, 1, 0], [0, 1, 1, 1, 0], [0, 0, 0, 0, 0]]
    np.testing.assert_array_equal(_amid(worths), rings)
    worths[2, 2], worths[0, 0] = 2.0, -np.inf
    rings[1][1] = rings[2][2] = 0
    np.testing.assert_array_equal(_amid(worths), rings)


def _on_rail(along: str, limits: tuple[float, float]) -> str:
    """The arm on a slide of 2 m."""
    rail = joint("rail", "prismatic", "stand", "base", "0 0 0.2", along, limits)
    return ARM.replace("</robot>", f'<link name="stand">{box("0.05 0.05 0.05")}</link>{rail}</robot>')


@pytest.mark.parametrize(("along", "across"), [("0 1 0", (0.0,)), ("1 0 0", (np.pi / 2, 3 * np.pi / 2)), ("0 0 1", (0.0,))])
@pytest.mark.parametrize("limits", [(-1.0, 1.0), (0.0, 2.0)])
def test_an_arm_on_a_rail_works_across_it_from_its_middle(
    along: str, across: tuple[float, ...], limits: tuple[float, float], tmp_path: Path
) -> None:
    """Its hand is most often at the rail's ends, where the cabinet stood; a lift is no rail."""
    (tmp_path / "arm.urdf").write_text(_on_rail(along, limits))
    robot = load(str(tmp_path / "arm.urdf"))
    here = arm_at(robot, np.eye(4))
    assert any(_facing(here) == pytest.approx(yaw) for yaw in across)
    x, y, z = (float(v) for v in along.split())
    np.testing.assert_allclose(robot.pivot(np.eye(4)), sum(limits) / 2 * np.array([x, y]), atol=1e-9)
    assert len(robot.rails) == (0 if z else 1)


def test_a_telescope_is_no_rail(tmp_path: Path) -> None:
    """Of an arm that stretches out along a slide only the wrist is on it: it works where the slide leads."""
    links = "".join(f'<link name="{name}">{box("0.05 0.05 0.05")}</link>' for name in ("base", "mast", "w1", "w2"))
    hand = ARM[ARM.index('<link name="palm">') :]
    joints = (
        joint("lift", "prismatic", "base", "mast", "0 0 0.1", "0 0 1", (0.0, 1.0))
        + joint("out", "prismatic", "mast", "w1", "0 0 0.1", "0 1 0", (0.0, 0.8))
        + joint("yaw", "revolute", "w1", "w2", "0 0 0.1", "0 0 1", (-2.0, 2.0))
        + joint("pitch", "revolute", "w2", "palm", "0 0.1 0.1", "1 0 0", (-2.5, 2.5))
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="stretch">{links}{joints}{hand}')
    assert not load(str(tmp_path / "arm.urdf")).rails


@pytest.mark.parametrize("boxes", [True, False])
def test_objects_of_one_kind_alone(boxes: bool) -> None:
    """A spec of household objects keeps those of the kind; one that has none of it keeps what it has."""
    assert of_one_kind(SPEC, boxes=boxes).objects_box_share == float(boxes)
    lab = load_spec("lab-s")
    kinds = {len(kind.size_m) for kind in lab.objects_household}
    assert kinds == {2, 3}
    assert {len(kind.size_m) for kind in of_one_kind(lab, boxes=boxes).objects_household} == {3 if boxes else 2}
    only = replace(lab, objects_household=tuple(kind for kind in lab.objects_household if len(kind.size_m) == (2 if boxes else 3)))
    assert of_one_kind(only, boxes=boxes).objects_household == only.objects_household


def test_slimmer_objects_are_as_high_and_as_many() -> None:
    slim = slimmed(SPEC, 0.5)
    assert slim.objects_half_width_m == tuple(0.5 * half for half in SPEC.objects_half_width_m)
    assert slim.target_half_width_m == tuple(0.5 * half for half in SPEC.target_half_width_m)
    assert (slim.objects_height_m, slim.objects_count) == (SPEC.objects_height_m, SPEC.objects_count)
    assert slimmed(SPEC, 1.0) is SPEC


def _opening(robot: Robot, **said: object) -> Robot:
    return replace(robot, opening=replace(robot.opening, **said))  # type: ignore[arg-type]


def test_no_object_is_slimmer_than_the_fingers_close(tmp_path: Path) -> None:
    """OpenManipulator-X closes to 20 mm: objects scaled for its reach were 18 mm wide, and no scene was solved."""
    (tmp_path / "arm.urdf").write_text(ARM)
    robot = load(str(tmp_path / "arm.urdf"))
    low, high = SPEC.objects_half_width_m
    apart = _opening(robot, width_m=np.linspace(low + high, 0.08, len(robot.opening.width_m)))
    for pair in ((spec := not_too_slim(SPEC, apart)).objects_half_width_m, spec.target_half_width_m):
        assert (low + high) / 2 < pair[0] <= pair[1]
    assert spec.objects_half_width_m[1] == high
    assert not_too_slim(SPEC, robot) is SPEC
    assert not_too_slim(SPEC, _opening(apart, cup_m=0.03)) is SPEC
    wider = _opening(robot, width_m=robot.opening.width_m + 0.5)  # none of them is held: the spec keeps its widest, and not_held says why
    assert not_too_slim(SPEC, wider).objects_half_width_m == (high, high)


def test_a_cup_wider_than_any_face_is_told_as_a_cup(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    robot = load(str(tmp_path / "arm.urdf"))
    wrong = not_held(SPEC, _opening(robot, cup_m=0.2), RobotRef(np.eye(4), urdf=str(tmp_path / "arm.urdf")), boxes=True)
    assert wrong is not None
    assert "the cup is 200 mm across and takes flat faces that are wider" in wrong


def test_a_hand_with_a_near_palm_holds_slim_objects_only(tmp_path: Path) -> None:
    """Between fingers that open 80 mm, the palm ends 25 mm behind the middle of the pads: what is thicker than twice that touches it."""
    (tmp_path / "arm.urdf").write_text(ARM)
    robot = load(str(tmp_path / "arm.urdf"))
    assert robot.opening.max_m == pytest.approx(0.08, abs=1e-3)
    ref = RobotRef(np.eye(4), urdf=str(tmp_path / "arm.urdf"))
    wrong = not_held(SPEC, robot, ref, boxes=False)
    assert wrong is not None
    assert "palm would touch the target itself" in wrong
    assert not_held(slimmed(SPEC, 0.5), robot, ref, boxes=False) is None


def test_a_box_is_held_before_the_feet_of_fingers_shaped_like_an_l(tmp_path: Path) -> None:
    """OnRobot's 2FG7: between its pads feet come 14 mm further in. Boxes were put onto them, so that a fit left all boxes out."""
    foot, pad = box("0.02 0.028 0.008", "0 0.016 0.004"), box("0.02 0.01 0.05", "0 0.025 0.025")
    left, right = (
        f'<link name="f1">{foot}{pad}</link>',
        f'<link name="f2">{foot.replace("0 0.0", "0 -0.0")}{pad.replace("0 0.0", "0 -0.0")}</link>',
    )
    slides = "".join(joint(f"j{f}", "prismatic", "palm", f, "0 0 0.01", f"0 {y} 0", (0.0, 0.02)) for f, y in (("f1", 1), ("f2", -1)))
    (tmp_path / "arm.urdf").write_text(arm(f"{left}{right}{slides}"))
    robot = load(str(tmp_path / "arm.urdf"))
    np.testing.assert_allclose(robot.opening.width_m[[0, -1]], [0.04, 0.08], atol=1e-3)
    feet_m = -0.027  # 35 mm behind the hand frame, 15 mm behind the tips, begins the palm; the feet are 8 mm high
    np.testing.assert_allclose(robot.opening.pad_z_m - robot.opening.depth_m, feet_m, atol=1e-3)
    for half in (0.022, 0.027, 0.034):
        wide = replace(SPEC, objects_half_width_m=(half, half), target_half_width_m=(half, half))
        assert not_held(wide, robot, RobotRef(np.eye(4), urdf=str(tmp_path / "arm.urdf")), boxes=True) is None


def test_a_smaller_cabinet_holds_fewer_objects_and_its_target_stands_less_deep() -> None:
    small = cut(SPEC, 0.5, 0.75)
    np.testing.assert_allclose(small.cabinet_size_m, SPEC.cabinet_size_m * [0.5, 0.75, 1.0])
    assert small.target_depth_m == tuple(0.5 * depth for depth in SPEC.target_depth_m)
    assert (SPEC.objects_count, small.objects_count) == ((4, 10), (3, 4))
    assert (fewer(SPEC, 0.1).objects_count, fewer(SPEC, 1.0).objects_count) == ((3, 3), SPEC.objects_count)
    assert fewer(replace(SPEC, objects_count=(1, 4)), 0.25).objects_count == (1, 3)
    assert cut(SPEC, 1.0, 1.0) is SPEC


# ------------------------------------------------------------------------------------------------------------------------- small arms


def _small(*, beside_m: float, lean: float, scale: float) -> str:
    """Pan, three joints in a plane and a roll, as on arms of hobbyists: a jaw that turns closes on a fixed one, which is beside the roll's
    axis. lean: of the jaw where it is shut, rad."""
    lengths, axes = (0.1, 0.28, 0.28, 0.06, 0.04), ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1")
    m = [scale * length for length in lengths]
    links = "".join(f'<link name="l{i}">{box(f"{0.1 * scale} {0.1 * scale} {0.8 * m[i]}", f"0 0 {m[i] / 2}")}</link>' for i in range(5))
    at = (0.05 * scale, *m[:4])
    joints = "".join(_joint(f"a{i}", "revolute", f"l{i - 1}" if i else "base", f"l{i}", f"0 0 {at[i]}", axes[i], 2.6) for i in range(5))
    palm = f'<joint name="flange" type="fixed"><parent link="l4"/><child link="palm"/><origin xyz="0 {beside_m} {m[4]}"/></joint>'
    fixed = f'<link name="palm">{box("0.02 0.05 0.02", "0 0.01 0")}{box("0.014 0.006 0.06", "0 -0.008 0.03")}</link>'
    jaw = f'<link name="jaw">{box("0.014 0.006 0.05", "0 0 0.03")}</link>'
    hinge = (
        f'<joint name="grip" type="revolute"><parent link="palm"/><child link="jaw"/><origin xyz="0 0.012 0.005" rpy="{lean} 0 0"/>'
        '<axis xyz="-1 0 0"/><limit lower="0" upper="0.9" velocity="1" effort="1"/></joint>'
    )
    base = f'<link name="base">{box("0.06 0.06 0.05", "0 0 0.025")}</link>'
    return f'<robot name="small">{base}{links}{joints}{palm}{fixed}{jaw}{hinge}</robot>'


@pytest.fixture(scope="module", params=[(0.0, 0.1, 0.6), (0.01, 0.25, 0.5)], ids=["in line", "beside"])
def small(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    beside, lean, scale = request.param
    file = tmp_path_factory.mktemp("small") / "small.urdf"
    file.write_text(_small(beside_m=beside, lean=lean, scale=scale))
    return load(str(file))


@pytest.fixture(scope="module")
def fitted(small: Robot) -> Fitted:
    """Thinned till six scenes are solved instead of sixteen, which takes a third of the time."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(fitting, "SCENES", 6)
        return fit(load_spec("paper-any"), small, RobotRef(np.eye(4), urdf=small.name))


def _stood_at_random(spec: Spec, rng: np.random.Generator) -> tuple[Cabinet, Body]:
    """A cylinder of the spec's sizes that stands in its cabinet wherever the spec lets it."""
    cabinet = Cabinet(spec.cabinet_size_m, transform(p=[spec.cabinet_front_m, 0.0, spec.cabinet_floor_m]), spec.cabinet_wall_m)
    shape = Cylinder(rng.uniform(*spec.objects_half_width_m), rng.uniform(*spec.objects_height_m))
    (depth, width, _), least = cabinet.size_m, shape.radius_m + spec.objects_gap_m
    p = [rng.uniform(least, depth - least), rng.uniform(least - width / 2, width / 2 - least), shape.height_m / 2]
    return cabinet, Body("can", shape, cabinet.T_world_cabinet @ transform(p=p))


def test_a_small_arm_takes_objects_from_almost_everywhere_in_its_cabinet(small: Robot, fitted: Fitted) -> None:
    """Wherever `gen` may put one, of whichever size: not only where the fit looked."""
    rng, taken = np.random.default_rng(5), []
    for _ in range(15):
        cabinet, body = _stood_at_random(fitted.spec, rng)
        scene = Scene("s", replace(fitted.ref, mount=False), cabinet, (body,), "can", None, 10, fitted.spec.moves_approaches)
        motions = Motions(small, scene, settings=UNCONSTRAINED)
        taken.append(bool(motions.picks(motions.start(), "can")[0]))
    assert np.mean(taken) >= 0.8
    assert fitted.share >= 0.8


def test_no_object_is_lower_than_the_hand_can_take(small: Robot, fitted: Fitted) -> None:
    """Objects from a few millimetres on: those that the arm takes begin higher."""
    low = replace(fitted.spec, objects_height_m=(0.004, 0.12))
    shares = held_heights(low, small, fitted.ref, boxes=False)
    assert shares is not None
    assert 0.0 < shares[0] < shares[1]
    trial = Trial(low, small, fitted.ref, [one_shape(low, height, boxes=False) for height in (0.0, shares[0])])
    assert [any(trial.takes(i, (along, 0.0)) for along in ALONG) for i in range(2)] == [False, True]
    assert share(low, small, fitted.ref).share <= share(replace(low, objects_height_m=(0.06, 0.1)), small, fitted.ref).share


def test_what_holds_something_round_is_asked_once_for_all_hands_round_it(small: Robot) -> None:
    """And it is what the verdict says of each, wherever the body stands."""
    ref, rng, said = RobotRef(np.eye(4), urdf=small.name), np.random.default_rng(2), []
    headings = headings_of(arm_at(small, np.eye(4)))
    for _ in range(6):
        at = transform(rotation_about((0, 0, 1), rng.uniform(-3, 3)), [*(0.28 * np.array([1.0, rng.uniform(-0.8, 0.8)])), 0.13])
        body = Body("can", Cylinder(0.010, 0.06), at)
        far = Scene("s", replace(ref, mount=False), Cabinet(np.full(3, 4.0), transform(p=[-2.0, 0.0, 0.10]), 0.02), (body,), "can", None)
        toward = float(np.arctan2(at[1, 3], at[0, 3]))
        for grasp in grasps_on(body, small, ("horizontal", "diagonal", "downward"), 0.10, toward, headings=headings):
            said.append(_holds_round(small, body, 0.10, grasp))
            assert said[-1] == (judge_grasp(small, far, grasp) is None)
    assert len(said) > 100


# ----------------------------------------------------------------------------------------------------------------- scenes can be solved


def test_objects_are_as_many_as_leave_all_scenes_solved(small: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of the ways to thin them, the thickest, of which all scenes are solved; the last where none is."""
    ref, asked = RobotRef(np.eye(4), urdf=small.name), list[tuple[int, int]]()

    def up_to(most: int) -> Spec:
        def fake(spec: Spec, robot: Robot, ref: RobotRef, n: int) -> list[bool]:
            asked.append(spec.objects_count)
            return [True] * (n - 1) + [spec.objects_count[1] <= most]

        monkeypatch.setattr(fitting, "solved", fake)
        return fitting._thinned(SPEC, small, ref, lambda _: None)

    assert up_to(10).objects_count == SPEC.objects_count
    assert asked == [SPEC.objects_count]
    assert up_to(7).objects_count == fewer(SPEC, THINNER[2][0]).objects_count
    assert up_to(0).objects_count == fewer(SPEC, THINNER[-1][0]).objects_count
    assert len(asked) == 1 + 3 + len(THINNER)


def test_objects_are_not_made_so_few_that_nothing_is_blocked(small: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kinova's Gen3 lite has slim objects in a large cabinet: of three, none was ever in the way, and no scene came of it."""
    done = dict(zip((round(10 * count) for count, _ in THINNER[1:]), (9, 12, 3, 0)))

    def fake(spec: Spec, robot: Robot, ref: RobotRef, n: int) -> list[bool]:
        first = done[10] if spec.objects_gap_m > SPEC.objects_gap_m else 5
        many = next((k for k in done if fewer(SPEC, k / 10).objects_count == spec.objects_count), 10)
        solved_first = first if many == 10 else done[many]
        return [True] * solved_first + [False] * (n - solved_first)

    monkeypatch.setattr(fitting, "solved", fake)
    said = list[str]()
    best = fitting._thinned(SPEC, small, RobotRef(np.eye(4), urdf=small.name), said.append)
    assert best.objects_count == fewer(SPEC, 0.7).objects_count
    assert len(said) == len(THINNER)


def test_a_scene_is_solved_where_what_is_in_the_way_can_be_put_down(small: Robot, fitted: Fitted) -> None:
    """Of a cabinet with a single region, its middle, objects can be picked as before, and put nowhere as a rule."""
    free = list(solved(fitted.spec, small, fitted.ref, 6))
    assert len(free) == 6
    assert sum(free) >= 5
    assert sum(solved(replace(fitted.spec, regions_n=1), small, fitted.ref, 6)) <= 3


def test_scenes_that_cannot_be_drawn_are_not_solved(small: Robot, fitted: Fitted, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object, **__: object) -> Scene:
        raise NoScene("none")

    monkeypatch.setattr(trials, "generate", none)
    assert list(solved(fitted.spec, small, fitted.ref, SCENES)) == SCENES * [False]


def test_fresh_scenes_of_a_fitted_spec_are_planned_and_verified(small: Robot, fitted: Fitted) -> None:
    """Not those by which it was fitted."""
    plans = []
    for i in range(4):
        scene = generate(fitted.spec, small, fitted.ref, 77, i)
        plans.append(plan_scene(scene, policy="lookahead", seed=0))
    assert sum(bool(plan.success and plan.verified) for plan in plans) >= 3
