"""URDFs as they are found: xacro, packages elsewhere, capsules, quaternions, soft limits, COLLADA, meshes in millimetres or concave."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import trimesh
from lxml import etree

from kinematics.collision.covers.levels import levels
from kinematics.robots import link_geometry
from kinematics.robots.derive import derive
from kinematics.robots.files import mesh_files, urdf
from kinematics.robots.link_geometry import collada_unit, read_mesh
from kinematics.robots.tree import LinkHull
from kinematics.transforms import Array, rotation_rpy

BOX = '<box size="0.1 0.1 0.1"/>'
TURNS = 'type="revolute"'
INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
LIMIT = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'


def arm(
    geometry: str = BOX, *, joint: str = f'<axis xyz="0 0 1"/>{LIMIT}', kind: str = "revolute", more: str = "", origin: str = ""
) -> str:
    """A URDF of a base and one link that turns on it."""
    return (
        f'<robot name="a"><link name="base"><collision><geometry>{BOX}</geometry></collision></link><joint name="turn" type="{kind}">'
        f'<parent link="base"/><child link="tip"/><origin xyz="0 0 0.5"/>{joint}</joint>'
        f'<link name="tip"><collision>{origin}<geometry>{geometry}</geometry></collision></link>{more}</robot>'
    )


def read(folder: Path, text: str, name: str = "a.urdf") -> tuple[etree._Element, tuple[str, ...]]:
    (folder / name).write_text(text)
    return urdf.read(folder / name)


def hulls(folder: Path, text: str, link: str = "tip") -> list[LinkHull]:
    """The hulls of a link, in its frame."""
    root, _ = read(folder, text)
    data = derive(urdf.to_string(root), "a", None, {})
    out, start = [], 0
    for name, (count, _) in zip(data["hull_link"], data["hull_counts"]):
        if name == link:
            out.append(LinkHull(link, data["hull_vertices"][start : start + count], np.empty((0, 3), np.int64)))
        start += count
    return out


def extent(found: list[LinkHull]) -> Array:
    points = np.concatenate([h.vertices for h in found])
    return np.asarray([points.min(0), points.max(0)])


def test_limits_of_many_turns_are_taken(tmp_path: Path) -> None:
    """A roll may turn five times, a slide go 60 m, and simulators write what turns without end as a million."""
    many = (("-31.5", "31.5", "revolute"), ("0", "60", "prismatic"), ("-1e6", "1e6", "revolute"))
    for lower, upper, kind in many:
        read(tmp_path, arm(joint=f'<limit lower="{lower}" upper="{upper}"/>', kind=kind))


# What makes no sense is one line ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (arm(joint=f'<axis xyz="0 0 0"/>{LIMIT}'), "joint 'turn': its axis is 0 0 0, which points nowhere"),
        (arm(joint='<limit lower="2" upper="-1"/>'), "joint 'turn': its lower limit 2 is above its upper limit -1; swap them"),
        (arm(joint='<limit lower="nan" upper="1"/>'), "joint 'turn': <limit lower='nan'> is not finite"),
        (arm(joint='<limit lower="-1" upper="one"/>'), "joint 'turn': <limit upper='one'> is no number"),
        (arm(joint='<limit lower="0" upper="0"/>'), "joint 'turn': its limits are both 0, so it can't move; make it fixed"),
        (arm(joint='<limit lower="-170" upper="90"/>'), "rad are 41 turns apart; are they in degrees? Then it is lower="),
        (arm(joint="<limit velocity='1'/>"), "joint 'turn': it has no limits; give it <limit lower"),
        (arm(joint=""), "joint 'turn': it has no limits"),
        (arm(joint="", kind="floating"), "joint 'turn': its type is 'floating'; revolute, continuous"),
        (arm().replace('<child link="tip"/>', '<child link="tipp"/>'), "joint 'turn': its child is the link 'tipp', which does not"),
        (arm().replace('<parent link="base"/>', '<parent link="w"/>'), "where the file is a part of a robot, give it <link name=\"w\"/>"),
        (arm().replace('<parent link="base"/>', ""), "joint 'turn': its parent is the link '', which does not exist"),
        (arm().replace('<parent link="base"/>', "").replace("<link", "<link/><link", 1), "its parent is the link '', which does not exist"),
        (arm(joint=f'{LIMIT}<mimic joint="trun"/>'), "joint 'turn': it mimics 'trun', which does not exist (did you mean 'turn'?)"),
        (arm(joint=f'{LIMIT}<mimic joint="turn"/>'), "joint 'turn' mimics itself"),
        (arm(more='<link name="tip"/>'), "there are 2 links called 'tip'"),
        (arm(more='<joint name="j" type="fixed"><parent link="base"/><child link="tip"/></joint>'), "link 'tip' has two parents"),
        (arm(more='<joint name="j" type="fixed"><parent link="tip"/><child link="base"/></joint>'), "closes a circle of links (base on"),
        (arm('<box size="0.1 0.1"/>'), "link 'tip': <box size='0.1 0.1'> must hold 3 numbers"),
        (arm('<sphere radius="-1"/>'), "link 'tip': <sphere radius='-1'> is not positive"),
        (arm(origin='<origin rpy="0 90 0"/>'), "<origin rpy='0 90 0'> is in rad; are these degrees? Then it is rpy=\"0 1.5708 0\""),
        (arm(origin='<origin quat_xyzw="0 0 0 0"/>'), "quat_xyzw '0 0 0 0' is no rotation"),
        (arm(joint='<limit lower="${-pi}" upper="3"/>'), "<limit lower='${-pi}'> is no number; is this xacro? Then its file's name ends"),
        (arm('<ellipsoid radii="1 1 1"/>'), "link 'tip': its <collision> has a <ellipsoid> for geometry; box, cylinder, sphere, capsule"),
        (arm('<cylinder length="1"/>'), "link 'tip': its <collision> has a <cylinder> without radius"),
        (arm('<capsule radius="1"/>'), "link 'tip': its <collision> has a <capsule> without length"),
        (arm("<mesh/>"), "link 'tip': its <collision> has a <mesh> without filename"),
        (arm('<box size="1 1 1"/><sphere radius="1"/>'), "has a <geometry> with <box> and <sphere>; give each a <collision> of its own"),
        (arm('<mesh filename="a.stl" scale="0 1 1"/>'), "link 'tip': <mesh scale='0 1 1'> leaves nothing of it"),
    ],
    ids=lambda value: None if str(value).startswith("<robot") else str(value)[:48],
)  # fmt: skip
def test_what_can_not_be_meant_is_one_line_with_the_file_and_the_joint(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=re.escape(says)) as e:
        read(tmp_path, text)
    assert str(e.value).startswith(f"{tmp_path / 'a.urdf'}: ")
    assert "\n" not in str(e.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (arm().removesuffix("</robot>"), "is broken, or cut off: line 1: Premature end of data in tag robot"),
        (arm().replace("</collision>", ""), "is broken, or cut off: line 1: Opening and ending tag mismatch"),
        ('<sdf version="1.7"><model name="x"/></sdf>', "is no URDF: its root element is <sdf>, not <robot>"),
    ],
)
def test_a_file_that_is_cut_off_or_something_else_is_not_read_in_part(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=re.escape(f"{tmp_path / 'a.urdf'} {says}")):
        read(tmp_path, text)


# Other words for what URDF 1.0 can say ---------------------------------------------------------------------------------------------------


def test_a_capsule_is_a_cylinder_with_two_round_ends(tmp_path: Path) -> None:
    """Turned and moved, as its origin says; the ends are no more than 2 % too long."""
    found = hulls(tmp_path, arm('<capsule radius="0.05" length="0.3"/>', origin='<origin xyz="1 0 0" rpy="0 1.5707963 0"/>'))
    low, high = extent(found)
    np.testing.assert_allclose(low, [1 - 0.2, -0.05, -0.05], atol=0.001)
    np.testing.assert_allclose(high, [1 + 0.2, 0.05, 0.05], atol=0.001)
    assert (low <= [0.8, -0.05, -0.05]).all()
    assert (high >= [1.2, 0.05, 0.05]).all()


def test_an_origin_may_be_a_quaternion(tmp_path: Path) -> None:
    rpy = (0.3, -0.8, 2.0)
    R = rotation_rpy(rpy)
    w = np.sqrt(1 + np.trace(R)) / 2
    xyzw = [(R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w), w]
    quaternion = " ".join(str(3 * v) for v in xyzw)  # of any length
    turned = hulls(tmp_path, arm(origin=f'<origin xyz="0 1 0" quat_xyzw="{quaternion}"/>'))
    same = hulls(tmp_path, arm(origin='<origin xyz="0 1 0" rpy="0.3 -0.8 2.0"/>'))
    np.testing.assert_allclose(extent(turned), extent(same), atol=1e-9)


@pytest.mark.parametrize(
    ("given", "read_as"),
    [("1 0 0 0.5", "1 0 0 0.5"), ("1 0 0", "1 0 0 1"), ("0.1 0.2 0.3 0 1", "0.1 0.2 0.3 1"), ("red", "0.7 0.7 0.7 1")],
)
def test_no_robot_is_refused_for_a_colour(given: str, read_as: str, tmp_path: Path) -> None:
    visual = f'<visual><geometry>{BOX}</geometry><material name="m"><color rgba="{given}"/></material></visual></link>'
    root, _ = read(tmp_path, arm().replace("</link>", visual, 1))
    assert [colour.get("rgba") for colour in root.iter("color")] == [read_as]


def test_a_link_has_a_name_and_nothing_else(tmp_path: Path) -> None:
    """Readers print a line for each other attribute, which the PR2 has."""
    root, _ = read(tmp_path, arm().replace('<link name="tip"', '<link name="tip" type="laser"'))
    assert [dict(link.attrib) for link in root.iter("link")] == [{"name": "base"}, {"name": "tip"}]


def test_a_robot_without_collision_geometry_is_as_large_as_it_is_drawn(tmp_path: Path) -> None:
    text = arm(origin='<origin xyz="1 0 0" rpy="0 1 0"/>')
    drawn = text.replace("collision>", "visual>")
    np.testing.assert_allclose(extent(hulls(tmp_path, drawn)), extent(hulls(tmp_path, text)))
    assert read(tmp_path, drawn)[1] == ("what is drawn is taken for the collision geometry that is missing of the links base, tip",)


def test_fingers_without_collision_geometry_are_as_large_as_they_are_drawn(tmp_path: Path) -> None:
    """And what carries them. Covers further up, or beside what has some, are drawn only."""
    names = ["base", "upper", "cover", "palm", "jaw", "screen"]
    links = "".join(f'<link name="{n}"><visual><geometry>{BOX}</geometry></visual></link>' for n in names)
    parents = {"upper": "base", "cover": "upper", "palm": "upper", "jaw": "palm", "screen": "base"}
    kinds = {"cover": 'type="fixed"', "screen": 'type="fixed"'}
    joints = "".join(
        f'<joint name="{child}" {kinds.get(child, TURNS)}><parent link="{parent}"/><child link="{child}"/>{LIMIT}</joint>'
        for child, parent in parents.items()
    )
    text = f'<robot name="a">{links}{joints}</robot>'
    only_base = text.replace("visual>", "collision>", 2)
    root, notes = read(tmp_path, only_base)
    assert [link.get("name") for link in root.iter("link") if link.find("collision") is not None] == ["base", "palm", "jaw"]
    assert notes == ("what is drawn is taken for the collision geometry that is missing of the links palm, jaw",)


@pytest.mark.parametrize(
    ("kind", "soft", "limits"),
    [
        ("revolute", 'soft_lower_limit="-0.5" soft_upper_limit="3"', (-0.5, 1)),
        ("revolute", 'soft_lower_limit="-2" soft_upper_limit="3"', (-1, 1)),
        ("revolute", 'k_velocity="3"', (-1, 1)),
        ("continuous", 'soft_lower_limit="-2" soft_upper_limit="2"', (-2, 2)),
    ],
)
def test_the_tighter_of_hard_and_soft_limits_holds(kind: str, soft: str, limits: tuple[float, float], tmp_path: Path) -> None:
    root, notes = read(tmp_path, arm(joint=f"{LIMIT}<safety_controller {soft}/>", kind=kind))
    data = derive(urdf.to_string(root), "a", None, {})
    assert tuple(data["limits"][0, :2]) == limits
    assert bool(notes) == (limits != (-1, 1))
    assert all("turn" in note for note in notes)


def test_xacro_is_expanded_with_packages_found_nearby(tmp_path: Path) -> None:
    """$(find …) needs no ROS."""
    package = tmp_path / "src" / "parts"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>my_parts</name></package>")
    (package / "size.xacro").write_text('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="r" value="0.25"/></robot>')
    text = arm('<sphere radius="${r}"/>').replace(
        '<robot name="a">',
        '<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="$(find my_parts)/size.xacro"/>',
    )
    root, _ = read(tmp_path, text, "a.urdf.xacro")
    assert root.find("link[@name='tip']/collision/geometry/sphere").get("radius") == "0.25"
    with pytest.raises(ValueError, match=r"xacro does not understand it: .*no package 'nowhere'.*; put it there, its folder"):
        read(tmp_path, text.replace("my_parts", "nowhere"), "a.urdf.xacro")


def test_xacro_takes_arguments_that_it_has(tmp_path: Path) -> None:
    names = '<xacro:arg name="radius" default="0.25"/><xacro:arg name="side" default="1"/>'
    declared = f'<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro">{names}'
    file = tmp_path / "a.urdf.xacro"
    file.write_text(arm('<sphere radius="$(arg radius)"/>').replace('<robot name="a">', declared))

    def radius(**arguments: str) -> str:
        root, notes = urdf.read(file, arguments)
        assert notes[0] == f"xacro arguments: radius:={arguments.get('radius', '0.25')} side:=1 (others: --xacro-arg)"
        return str(root.find("link[@name='tip']/collision/geometry/sphere").get("radius"))

    assert (radius(), radius(radius="0.5")) == ("0.25", "0.5")
    with pytest.raises(ValueError, match=r"no xacro argument 'raduis' \(did you mean 'radius'\?\): it has radius, side$"):
        urdf.read(file, {"raduis": "1"})
    file.with_suffix("").write_text(arm('<sphere radius="1"/>'))
    with pytest.raises(ValueError, match=r"a.urdf: arguments are for xacro, and this is none$"):
        urdf.read(file.with_suffix(""), {"radius": "1"})


def test_a_package_may_be_a_folder_without_a_package_xml(tmp_path: Path) -> None:
    """As data that were copied out of a workspace are."""
    package = tmp_path / "my_parts"
    (package / "robots").mkdir(parents=True)
    (package / "size.xacro").write_text('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="r" value="0.25"/></robot>')
    include = '<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="$(find my_parts)/size.xacro"/>'
    root, _ = read(package / "robots", arm('<sphere radius="${r}"/>').replace('<robot name="a">', include), "a.urdf.xacro")
    assert root.find("link[@name='tip']/collision/geometry/sphere").get("radius") == "0.25"


def test_macros_that_nobody_calls_are_no_robot(tmp_path: Path) -> None:
    macro = '<robot xmlns:xacro="http://ros.org/wiki/xacro" name="a"><xacro:macro name="m" params=""><link name="l"/></xacro:macro></robot>'
    with pytest.raises(ValueError, match=r"a.xacro has no links; it defines macros: give the file that calls them$"):
        read(tmp_path, macro, "a.xacro")


def test_without_the_package_xacro_one_line_says_what_to_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    says = r"this is xacro, and the package xacro is not installed: pip install xacro; or run: xacro a.urdf.xacro > a.urdf$"
    with pytest.raises(ValueError, match=says):
        read(tmp_path, arm().replace('name="a"', 'name="a" xmlns:xacro="x"'), "a.urdf.xacro")


# Where meshes are ------------------------------------------------------------------------------------------------------------------------


def write_mesh(file: Path, mesh: trimesh.Trimesh | None = None) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    (mesh or trimesh.creation.box((0.2, 0.1, 0.1))).export(file)
    return file


def mesh_of(root: etree._Element) -> Path:
    return Path(root.find("link[@name='tip']/collision/geometry/mesh").get("filename"))


@pytest.mark.parametrize("variable", ["ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", None])
def test_packages_are_found_on_the_search_paths_and_in_the_workspace(
    variable: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The package's folder is called otherwise than the package; the URDF is in another package."""
    for name in mesh_files.SEARCH_PATHS:
        monkeypatch.delenv(name, raising=False)
    elsewhere = tmp_path / ("ws/src/vendor" if variable is None else "opt/share") / "arm_support-main"
    mesh = write_mesh(elsewhere / "meshes" / "tip.stl")
    (elsewhere / "package.xml").write_text("<package><name>arm_support</name></package>")
    if variable is not None:
        monkeypatch.setenv(variable, f"/nowhere:{tmp_path / 'opt'}")
    folder = tmp_path / "ws" / "src" / "my_cell" / "urdf"
    folder.mkdir(parents=True)
    root, _ = read(folder, arm('<mesh filename="package://arm_support/meshes/tip.stl"/>'))
    assert mesh_of(root) == mesh


def test_file_uris_may_hold_escaped_spaces(tmp_path: Path) -> None:
    mesh = write_mesh(tmp_path / "my meshes" / "tip.stl")
    root, _ = read(tmp_path, arm(f'<mesh filename="{mesh.as_uri()}"/>'))
    assert "%20" in mesh.as_uri()
    assert mesh_of(root) == mesh


def test_mesh_names_may_be_relative_to_a_folder_above(tmp_path: Path) -> None:
    """To the root of what was copied, say; what lies beside the URDF comes first."""
    (tmp_path / "urdf").mkdir()
    (tmp_path / "meshes").mkdir()
    write_mesh(tmp_path / "meshes" / "tip.stl", trimesh.creation.box((0.2, 0.1, 0.1)))
    text = arm('<mesh filename="meshes/tip.stl"/>')
    np.testing.assert_allclose(np.ptp(extent(hulls(tmp_path / "urdf", text)), axis=0), [0.2, 0.1, 0.1])
    (tmp_path / "urdf" / "meshes").mkdir()
    write_mesh(tmp_path / "urdf" / "meshes" / "tip.stl", trimesh.creation.box((0.3, 0.1, 0.1)))
    np.testing.assert_allclose(np.ptp(extent(hulls(tmp_path / "urdf", text)), axis=0), [0.3, 0.1, 0.1])


def test_a_missing_visual_mesh_is_noted_and_a_missing_collision_mesh_an_error(tmp_path: Path) -> None:
    visual = '<link name="v"><visual><geometry><mesh filename="nice.stl"/></geometry></visual></link>'
    joint = '<joint name="j" type="fixed"><parent link="tip"/><child link="v"/></joint>'
    root, notes = read(tmp_path, arm(more=visual + joint))
    assert notes == ("the visual mesh nice.stl of the link v does not exist; its collision geometry is drawn",)
    assert root.find("link[@name='v']/visual") is None
    more = visual.replace('"v"', '"w"') + joint.replace('"v"', '"w"').replace('"j"', '"k"')
    notes = read(tmp_path, arm(more=visual + joint + more))[1]
    assert notes == ("2 visual meshes, nice.stl the first, do not exist; of the links v, w collision geometry is drawn",)
    seen = arm().replace('<link name="tip">', '<link name="tip"><visual><geometry><mesh filename="nice.stl"/></geometry></visual>')
    (drawn,) = read(tmp_path, seen)[0].findall("link[@name='tip']/visual")
    assert drawn.find("geometry/box").get("size") == "0.1 0.1 0.1", "its collision geometry"
    with pytest.raises(ValueError, match=rf"link 'tip' names the mesh nice.stl, which does not exist: {tmp_path}/nice.stl$"):
        read(tmp_path, arm('<mesh filename="nice.stl"/>'))
    with pytest.raises(
        ValueError, match=rf"meshes/x.stl of the package 'p': looked in the folders above {tmp_path}; put the package's folder "
    ):
        read(tmp_path, arm('<mesh filename="package://p/meshes/x.stl"/>'))


def test_an_stl_file_without_triangles_is_left_out_and_noted(tmp_path: Path) -> None:
    """Kinova's EndEffector_Link.STL is no more than a head."""
    (tmp_path / "end.STL").write_bytes(bytes(80))
    end = '<link name="e"><collision><geometry><mesh filename="end.STL"/></geometry></collision></link>'
    root, notes = read(tmp_path, arm(more=end + '<joint name="j" type="fixed"><parent link="tip"/><child link="e"/></joint>'))
    assert notes == ("the mesh end.STL of the link e has no triangles, and is left out",)
    assert len(root.find("link[@name='e']")) == 0


def test_a_mesh_that_git_lfs_did_not_fetch_is_named(tmp_path: Path) -> None:
    (tmp_path / "tip.stl").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1611284\n")
    with pytest.raises(ValueError, match=r"tip.stl is a pointer of Git LFS, .*git lfs pull"):
        hulls(tmp_path, arm('<mesh filename="tip.stl"/>'))


# What meshes mean ------------------------------------------------------------------------------------------------------------------------


def test_a_mesh_in_millimetres_is_an_error_that_names_the_link(tmp_path: Path) -> None:
    write_mesh(tmp_path / "tip.stl", trimesh.creation.box((200, 80, 80)))
    says = r"link 'tip': its mesh .*tip.stl is 200 m long; is it in millimetres\? Then its <mesh> needs scale=\"0.001 0.001 0.001\""
    with pytest.raises(ValueError, match=says):
        hulls(tmp_path, arm('<mesh filename="tip.stl"/>'))
    found = hulls(tmp_path, arm('<mesh filename="tip.stl" scale="0.001 0.001 0.001"/>'))
    np.testing.assert_allclose(extent(found), [[-0.1, -0.04, -0.04], [0.1, 0.04, 0.04]])


@pytest.mark.parametrize("up", ["Z_UP", "Y_UP", "X_UP"])
def test_collada_files_say_their_unit_and_their_axis_that_is_up_is_not_heeded(up: str, tmp_path: Path) -> None:
    """As in RViz and MoveIt: PR2's say Y_UP, Denso's too, and lie as the STL files beside them do."""
    file = write_mesh(tmp_path / "tip.dae", trimesh.creation.box((1.0, 2.0, 3.0)))
    text = re.sub(r"<asset>.*?</asset>", "", file.read_text(), flags=re.S)
    file.write_text(re.sub(r"(<COLLADA[^>]*>)", rf'\1<asset><unit meter="0.01"/><up_axis>{up}</up_axis></asset>', text, count=1))
    np.testing.assert_allclose(np.ptp(read_mesh(file, (1.0, 1.0, 1.0)).points, axis=0), [0.01, 0.02, 0.03], atol=1e-9)
    assert collada_unit(file) == 0.01


def test_gltf_meshes_of_drakes_models_are_turned_and_others_are_not(tmp_path: Path) -> None:
    """Drake takes the y axis of glTF for up, as the format has it; others ship links in their own frame."""
    mesh = write_mesh(tmp_path / "drake_models" / "tip.glb", trimesh.creation.box((0.1, 0.2, 0.3)))
    write_mesh(tmp_path / "other" / "tip.glb", trimesh.creation.box((0.1, 0.2, 0.3)))
    assert mesh.is_file()
    sizes = [np.ptp(extent(hulls(tmp_path, arm(f'<mesh filename="package://{p}/tip.glb"/>'))), axis=0) for p in ("drake_models", "other")]
    np.testing.assert_allclose(sizes, [[0.1, 0.3, 0.2], [0.1, 0.2, 0.3]], atol=1e-6)


@pytest.mark.parametrize("nothing", ['<box size="0 0 0"/>', '<sphere radius="0.0"/>'])
def test_solids_of_no_size_are_none(nothing: str, tmp_path: Path) -> None:
    """Elite's EC66 has such a box on its flange."""
    flange = f'<link name="f"><visual><geometry>{nothing}</geometry></visual><collision><geometry>{nothing}</geometry></collision></link>'
    joint = '<joint name="j" type="fixed"><parent link="tip"/><child link="f"/></joint>'
    root, _ = read(tmp_path, arm(more=flange + joint))
    assert len(root.find("link[@name='f']")) == 0
    assert len(root.find("link[@name='tip']")) == 1


def test_a_flat_link_has_a_cover(tmp_path: Path) -> None:
    """A marker that is printed on a sheet: its mesh is two triangles."""
    corners = np.array([[-0.03, -0.03, 0.0], [0.03, -0.03, 0.0], [0.03, 0.03, 0.0], [-0.03, 0.03, 0.0]]) @ rotation_rpy((0.3, 0.5, 0.7)).T
    write_mesh(tmp_path / "marker.stl", trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]))
    (found,) = hulls(tmp_path, arm('<mesh filename="marker.stl"/>'))
    balls = levels(found.vertices).coarse
    assert (np.linalg.norm(corners[:, None] - balls.centres, axis=2) <= balls.radii).any(1).all()
    assert np.ptp(found.vertices @ rotation_rpy((0.3, 0.5, 0.7)), axis=0) == pytest.approx([0.06, 0.06, 2 * link_geometry.FLAT_M], abs=1e-5)


def test_a_frame_is_taken_apart_once_and_every_triangle_lies_in_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    frame = trimesh.creation.box((0.9, 0.9, 0.1)).difference(trimesh.creation.box((0.7, 0.7, 1.0)))
    write_mesh(tmp_path / "frame.stl", frame)
    found = hulls(tmp_path, arm('<mesh filename="frame.stl"/>'))
    parts = [trimesh.convex.convex_hull(h.vertices) for h in found]
    assert 4 <= len(parts) <= link_geometry.FRAME_PARTS + 4
    assert not any(p.contains([[0.0, 0.0, 0.0]])[0] for p in parts)
    points, _ = trimesh.sample.sample_surface(frame, 2000, seed=1)
    depth = np.min(
        [np.max(p.face_normals @ points.T - np.sum(p.face_normals * p.triangles[:, 0], 1)[:, None], axis=0) for p in parts], axis=0
    )
    assert depth.max() < 1e-6
    assert sum(p.volume for p in parts) < 1.3 * frame.volume
    monkeypatch.setattr(link_geometry, "_TAKE_APART", "raise SystemExit(1)")
    link_geometry._mesh_parts.cache_clear()
    again = hulls(tmp_path, arm('<mesh filename="frame.stl"/>'))
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(found, again, strict=True)), "from the disk"


def test_a_mesh_that_the_process_for_several_did_not_come_to_is_taken_apart_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(link_geometry, "_TAKE_APART", link_geometry._TAKE_APART.replace("len(given.files) // 4", "1"))
    frames = [trimesh.creation.box((size, size, 0.1)).difference(trimesh.creation.box((0.7, 0.7, 1.0))) for size in (0.9, 0.92)]
    for k, frame in enumerate(frames):
        write_mesh(tmp_path / f"frame{k}.stl", frame)
    meshes = [link_geometry.read_mesh(tmp_path / f"frame{k}.stl", (1.0, 1.0, 1.0)) for k in range(2)]
    first, second = link_geometry._taken_apart([(mesh, link_geometry.PARTS) for mesh in meshes])
    assert first is not None
    assert second is None
    (parts, notes), (kept, _) = (link_geometry._mesh_parts(tmp_path / f"frame{k}.stl", (1.0, 1.0, 1.0), False) for k in (1, 0))
    assert len(parts) >= 4
    assert notes == ()
    assert all(np.array_equal(a, b) for a, b in zip(first, kept, strict=True)), "from the disk"


def test_where_nothing_can_be_taken_apart_a_note_says_how_much_the_hull_fills(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = trimesh.creation.box((0.9, 0.9, 0.1)).difference(trimesh.creation.box((0.7, 0.7, 1.0)))
    write_mesh(tmp_path / "frame.stl", frame)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(link_geometry, "_TAKE_APART", "raise SystemExit(1)")
    root, _ = read(tmp_path, arm('<mesh filename="frame.stl"/>'))
    data = derive(urdf.to_string(root), "a", None, {})
    assert list(data["notes"]) == ["link tip: frame.stl fills 40 % of its convex hull and can't be taken apart: its hull stands for it"]
    assert list(data["hull_link"]).count("tip") == 1


def test_a_hollow_but_convex_link_stays_one_hull(tmp_path: Path) -> None:
    outer, inner = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.18, 0.18, 0.18))
    inner.invert()
    write_mesh(tmp_path / "shell.stl", trimesh.util.concatenate([outer, inner]))
    assert len(hulls(tmp_path, arm('<mesh filename="shell.stl"/>'))) == 1


def test_a_robot_without_a_name_has_the_files_and_a_default_namespace_is_no_obstacle(tmp_path: Path) -> None:
    """Open Manipulator's has no name; Drake's files have a namespace."""
    text = re.sub("<robot[^>]*>", '<robot xmlns="http://drake.mit.edu">', arm(), count=1)
    root, _ = read(tmp_path, text)
    assert root.get("name") == "a"
    assert "xmlns" not in urdf.to_string(root)
    assert urdf.to_string(root).replace('name="a"', "") == urdf.to_string(read(tmp_path, arm())[0]).replace('name="a"', "")


@pytest.mark.parametrize("nothing", ["<collision/>", "<collision><geometry/></collision>", "<visual/>"])
def test_elements_without_geometry_are_nothing(nothing: str, tmp_path: Path) -> None:
    """MATLAB's PR2 and Baxter have some."""
    without = urdf.to_string(read(tmp_path, arm())[0])
    assert urdf.to_string(read(tmp_path, arm().replace('<link name="base">', f'<link name="base">{nothing}'))[0]) == without


def test_a_mimic_of_a_mimic_follows_the_first(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """yourdfpy takes the second for one that stands still, and says so."""
    more = "".join(
        f'<link name="{name}"/><joint name="{name}" type="revolute"><parent link="base"/><child link="{name}"/>{LIMIT}{mimic}</joint>'
        for name, mimic in (
            ("first", '<mimic joint="second" multiplier="-2" offset="0.5"/>'),
            ("second", '<mimic joint="turn" multiplier="0.5" offset="0.1"/>'),
        )
    )
    root, _ = read(tmp_path, arm(more=more))
    mimic = root.find("joint[@name='first']/mimic")
    assert dict(mimic.attrib) == {"joint": "turn", "multiplier": "-1.0", "offset": "0.3"}
    derive(urdf.to_string(root), "a", None, {})
    assert not caplog.records


@pytest.mark.parametrize("name", ["package://odd//m.stl", "file:{folder}/m.stl", "meshes\\..\\m.stl", " m.stl "])
def test_odd_names_of_meshes_are_understood(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "odd"
    (folder / "meshes").mkdir(parents=True)
    write_mesh(folder / "m.stl")
    root, _ = read(folder, arm(f'<mesh filename="{name.format(folder=folder)}"/>'))
    assert mesh_of(root) == folder / "m.stl"


@pytest.mark.parametrize("name", ["m.stl", "package://odd/m.stl"])
def test_a_mesh_in_other_capitals_is_named(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "odd"
    folder.mkdir()
    (folder / "package.xml").write_text("<package><name>odd</name></package>")
    write_mesh(folder / "M.STL")
    with pytest.raises(ValueError, match=r"which does not exist: .*; there is M.STL: capitals count"):
        read(folder, arm(f'<mesh filename="{name}"/>'))


def test_of_a_mesh_in_another_format_it_is_said_what_to_make_of_it(tmp_path: Path) -> None:
    (tmp_path / "m.3ds").write_text("MM")
    with pytest.raises(ValueError, match=r"mesh file .*m.3ds can't be read, .*; convert it to one of .stl, .obj, "):
        hulls(tmp_path, arm('<mesh filename="m.3ds"/>'))


@pytest.mark.parametrize(
    "inertial",
    [
        '<mass value="1"/>',
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>',
        '<mass value="1"/><inertia ixx="1"/>',
        '<mass value="x"/>',
    ],
)
def test_links_whose_inertia_is_not_whole_are_read_by_others_too(inertial: str, tmp_path: Path) -> None:
    """Pinocchio left the fingers of airo-models' Schunk EGK 40 out, their links altogether."""
    text = arm().replace('<link name="tip">', f'<link name="tip"><inertial>{inertial}</inertial>')
    cleaned = urdf.to_string(read(tmp_path, text)[0])
    assert cleaned == urdf.to_string(read(tmp_path, arm())[0])
    assert pinocchio.buildModelFromXML(cleaned).existFrame("tip")
    whole = f'<inertial><mass value="1"/>{INERTIA}</inertial>'
    kept = urdf.to_string(read(tmp_path, arm().replace('<link name="tip">', f'<link name="tip">{whole}'))[0])
    assert "<inertia " in kept
