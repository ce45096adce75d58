"""What the raycaster draws, against Embree, against its own single rays, and against the surfaces themselves."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from ray_tree import cast_rays, inside

from kinematics.scene import Body
from kinematics.shapes import Box, ConvexMesh, Cylinder, Shape, box_corners
from kinematics.transforms import Array, inverse, rotation_about, transform
from perception.camera import Intrinsics, cloud, look_at, points_in_camera, ray_directions, realsense_d435i
from perception.rendering.lighting import Studio
from perception.rendering.polylines import Polyline
from perception.rendering.raycast import raycast
from perception.rendering.shading import Item, shade
from perception.rendering.surfaces import Mesh, Surfaces, join, moved, surfaces

CAMERA = realsense_d435i(160, 120)


def random_scene(seed: int, n: int = 14) -> tuple[list[Shape | Mesh | Array], Array]:
    """Shapes of every kind at random poses in front of the origin."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(3, 0.07)
    ring = trimesh.creation.torus(0.06, 0.02, major_sections=40, minor_sections=20)
    shapes: list[Shape | Mesh | Array] = []
    for i in range(n):
        kinds: list[Shape | Mesh | Array] = [
            Box(rng.uniform(0.03, 0.3, 3)),
            Cylinder(rng.uniform(0.02, 0.08), rng.uniform(0.05, 0.3)),
            rng.normal(0, 0.05, (30, 3)),
            Mesh(ball.vertices, ball.faces),
            Mesh(ring.vertices, ring.faces),
            ConvexMesh((box_corners(np.array([0.02, 0.03, 0.1])), box_corners(np.array([0.09, 0.03, 0.02])))),
        ]
        shapes.append(kinds[i % len(kinds)])
    R = [rotation_about(rng.normal(size=3), rng.uniform(0, np.pi)) for _ in shapes]
    return shapes, transform(np.array(R), rng.uniform([0.3, -0.4, -0.3], [1.2, 0.4, 0.3], (n, 3)))


def triangles(shape: Shape | Mesh | Array, T: Array) -> Array:
    """The shape as triangles (F, 3, 3) in the world; a cylinder as a prism of 512 sides, within 2 µm of it."""
    match shape:
        case Box():
            meshes = [trimesh.creation.box(shape.size_m)]
        case Cylinder():
            meshes = [trimesh.creation.cylinder(shape.radius_m, shape.height_m, sections=512)]
        case ConvexMesh():
            meshes = [trimesh.convex.convex_hull(p) for p in shape.parts]
        case Mesh():
            meshes = [trimesh.Trimesh(shape.vertices, shape.faces, process=False)]
        case _:
            meshes = [trimesh.convex.convex_hull(shape)]
    return np.concatenate([m.copy().apply_transform(T).triangles for m in meshes])


def embree(shapes: list[Shape | Mesh | Array], T: Array, T_world_camera: Array, camera: Intrinsics) -> tuple[Array, Array]:
    """Depth (H, W), 0 where nothing is, and index (H, W), -1 where nothing is."""
    pytest.importorskip("embreex")
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    corners = [triangles(s, t) for s, t in zip(shapes, T)]
    owner = np.repeat(np.arange(len(corners)), [len(c) for c in corners])
    scene = EmbreeScene()
    TriangleMesh(scene, np.concatenate(corners).astype(np.float32))
    d = (ray_directions(camera) @ T_world_camera[:3, :3].T).reshape(-1, 3).astype(np.float32)
    hit = scene.run(np.tile(T_world_camera[:3, 3].astype(np.float32), (len(d), 1)), d, output=True)
    seen = hit["primID"] >= 0
    shape = (camera.height, camera.width)
    return np.where(seen, hit["tfar"], 0.0).reshape(shape), np.where(seen, owner[hit["primID"]], -1).reshape(shape)


def away_from_silhouettes(index: Array, depth: Array) -> Array:
    """Where (H, W) all eight neighbours show the same body, and no fold of it."""
    clear = np.ones(index.shape, bool)
    for dv in (-1, 0, 1):
        for du in (-1, 0, 1):
            clear &= np.roll(index, (dv, du), (0, 1)) == index
            clear &= np.abs(np.roll(depth, (dv, du), (0, 1)) - depth) < 0.02
    clear[[0, -1]] = clear[:, [0, -1]] = False
    return clear


def view_from(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return look_at(rng.uniform([-0.4, -0.6, -0.3], [0.1, 0.6, 0.5]), rng.uniform([0.7, -0.1, -0.1], [0.8, 0.1, 0.1]))


@pytest.mark.parametrize("seed", range(12))
def test_depth_and_ids_as_embree_sees_them(seed: int) -> None:
    shapes, T = random_scene(seed)
    T_world_camera = view_from(seed)
    view = raycast(surfaces(shapes, T), T_world_camera, CAMERA)
    depth, index = embree(shapes, T, T_world_camera, CAMERA)
    clear = away_from_silhouettes(index, depth)
    assert clear.mean() > 0.5
    assert (view.instance == index)[clear].all()
    assert np.abs(view.depth - depth)[clear].max() < 1e-4
    assert (view.instance == index).mean() > 0.997
    assert ((view.depth == 0) == (view.instance == -1)).all()


@pytest.mark.parametrize("seed", range(6))
def test_a_camera_among_and_inside_solids_as_embree_sees_it(seed: int) -> None:
    """Solids beside, behind and around the camera: nothing behind it shows, and from within the far side does."""
    shapes, T = random_scene(100 + seed, 24)
    T[:, :3, 3] -= [0.75, 0, 0]
    around: list[Shape | Mesh | Array] = [
        Box(np.array([0.5, 0.6, 0.4])),
        Cylinder(0.3, 0.5),
        np.random.default_rng(seed).normal(0, 0.3, (40, 3)),
    ]
    shapes[seed], T[seed, :3, 3] = around[seed % 3], 0.0
    T_world_camera = look_at(np.array([0.01, 0.02, 0.03]), np.random.default_rng(seed).normal(size=3))
    s = surfaces(shapes, T)
    assert seed in inside(s, T_world_camera[:3, 3])
    view = raycast(s, T_world_camera, CAMERA)
    depth, index = embree(shapes, T, T_world_camera, CAMERA)
    clear = away_from_silhouettes(index, depth)
    assert (view.instance >= 0).all()
    assert (view.instance == index)[clear].all()
    assert np.abs(view.depth - depth)[clear].max() < 1e-4


@pytest.mark.parametrize("seed", range(4))
def test_single_rays_agree_with_the_image(seed: int) -> None:
    shapes, T = random_scene(seed)
    s, T_world_camera = surfaces(shapes, T), view_from(seed)
    view = raycast(s, T_world_camera, CAMERA)
    d = (ray_directions(CAMERA) @ T_world_camera[:3, :3].T).reshape(-1, 3)
    t, index = cast_rays(s, np.tile(T_world_camera[:3, 3], (len(d), 1)), d)
    agree = index.reshape(view.instance.shape) == view.instance
    assert agree.mean() > 0.9999
    both = agree & (view.instance >= 0)
    assert np.abs(t.reshape(agree.shape) - view.depth)[both].max() < 1e-6
    assert np.isinf(t[index < 0]).all()


def surface_gap(shape: Shape, p: Array) -> Array:
    """Distance (N,) of points (N, 3) in the shape's frame from its surface, for points near it."""
    if isinstance(shape, Box):
        return np.abs((np.abs(p) - shape.half).max(1))
    assert isinstance(shape, Cylinder)
    return np.abs(np.maximum(np.hypot(p[:, 0], p[:, 1]) - shape.radius_m, np.abs(p[:, 2]) - shape.height_m / 2))


@pytest.mark.parametrize("seed", range(4))
def test_back_projected_points_lie_on_the_surfaces_that_made_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes: list[Shape | Mesh | Array] = [
        Box(rng.uniform(0.05, 0.2, 3)) if i % 2 else Cylinder(rng.uniform(0.02, 0.1), rng.uniform(0.05, 0.2)) for i in range(12)
    ]
    _, T = random_scene(seed, 12)
    T_world_camera = view_from(seed)
    view = raycast(surfaces(shapes, T), T_world_camera, CAMERA, normals=True)
    assert view.normals is not None
    points = cloud(view.depth, CAMERA, T_world_camera)
    owner, normal = view.instance[view.depth > 0], view.normals[view.depth > 0].astype(float)
    assert len(np.unique(owner)) >= 6
    assert np.allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-5)
    assert ((points - T_world_camera[:3, 3]) * normal).sum(1).max() < 1e-6  # towards the camera
    for i in np.unique(owner):
        p = points[owner == i]
        back = inverse(T[i])
        assert surface_gap(shapes[i], p @ back[:3, :3].T + back[:3, 3]).max() < 1e-6
        out = p + 1e-4 * normal[owner == i]  # a step along the normal leads out
        local = out @ back[:3, :3].T + back[:3, 3]
        assert surface_gap(shapes[i], local).min() > 0.9e-4


def test_normals_of_hulls_and_meshes() -> None:
    ball = trimesh.creation.icosphere(4, 0.1)
    for shape in (np.asarray(ball.vertices), Mesh(ball.vertices, ball.faces), Mesh(ball.vertices, ball.faces[:, ::-1])):
        T_world_camera = look_at(np.array([-0.5, 0.1, 0.2]), np.zeros(3))
        view = raycast(surfaces([shape], np.eye(4)[None]), T_world_camera, CAMERA, normals=True)
        assert view.normals is not None
        seen = view.depth > 0
        points = cloud(view.depth, CAMERA, T_world_camera)
        along = (view.normals[seen] * points).sum(1) / np.linalg.norm(points, axis=1)
        assert along.min() > 0.98
        assert (view.normals[~seen] == 0).all()


def test_an_empty_scene_and_a_camera_facing_away_see_nothing() -> None:
    nothing = surfaces([], np.zeros((0, 4, 4)))
    s = surfaces(*random_scene(0))
    away = look_at(np.array([-0.3, 0, 0]), np.array([-1.0, 0, 0]))
    for view in (raycast(nothing, np.eye(4), CAMERA, normals=True), raycast(s, away, CAMERA, normals=True)):
        assert view.depth.shape == view.instance.shape == (120, 160)
        assert view.depth.dtype == np.float32
        assert view.instance.dtype == np.int32
        assert (view.depth == 0).all()
        assert (view.instance == -1).all()
    t, index = cast_rays(nothing, np.zeros((3, 3)), np.ones((3, 3)))
    assert np.isinf(t).all()
    assert (index == -1).all()
    t, index = cast_rays(s, np.zeros((0, 3)), np.zeros((0, 3)))
    assert len(t) == len(index) == 0
    assert inside(nothing, np.zeros(3)) == []


def test_a_camera_on_a_face_or_along_one_sees_no_nonsense() -> None:
    s = surfaces([Box(np.array([0.2, 0.2, 0.2])), Cylinder(0.1, 0.2)], transform(p=np.array([[0.5, 0, 0], [0.9, 0, 0]])))
    for eye in ([0.4, 0, 0], [0.2, 0.1, 0], [0.2, 0.1, 0.1], [0.5, 0.1, 0.0], [0.9, 0.0, 0.1], [0.8, 0.0, 0.0]):
        view = raycast(s, look_at(np.array(eye, float), np.array([2.0, *eye[1:]])), CAMERA, normals=True)
        assert np.isfinite(view.depth).all()
        assert (view.depth >= 0).all()
        assert (view.depth < 1.2).all()
        points = points_in_camera(view.depth, CAMERA)[view.depth > 0]
        assert np.isfinite(points).all()


def test_rays_that_run_along_axes_and_start_inside() -> None:
    s = surfaces([Box(np.array([0.2, 0.4, 0.6])), Cylinder(0.1, 0.4)], transform(p=np.array([[0, 0, 0], [1.0, 0, 0]])))
    o = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 1], [1, 0, 0], [1, 0, 0], [-1, 0.2001, 0], [1, 0.1001, -1]])
    d = np.array([[2.0, 0, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, 1]])
    t, index = cast_rays(s, o, d)
    assert np.allclose(t[:5], [0.45, 0.2, 0.8, 0.2, 0.1])
    assert index.tolist() == [0, 0, 1, 1, 1, -1, -1]
    assert np.isinf(t[5:]).all()


def test_seams_between_triangles_let_no_ray_through() -> None:
    """A closed hull of many triangles before a wall: not one pixel of the wall shows within its outline."""
    ball = trimesh.creation.icosphere(4, 0.2)
    s = surfaces([Mesh(ball.vertices, ball.faces), Box(np.array([0.01, 4.0, 4.0]))], transform(p=np.array([[0.6, 0, 0], [1.0, 0, 0]])))
    for seed in range(5):
        eye = np.random.default_rng(seed).uniform([-0.2, -0.2, -0.2], [0.1, 0.2, 0.2])
        T_world_camera = look_at(eye, np.array([0.6, 0, 0]))
        view = raycast(s, T_world_camera, realsense_d435i(320, 240))
        rays = ray_directions(realsense_d435i(320, 240)) @ T_world_camera[:3, :3].T
        nearest = np.linalg.norm(np.cross(np.array([0.6, 0, 0]) - eye, rays), axis=-1) / np.linalg.norm(rays, axis=-1)
        assert (view.instance[nearest < 0.198] == 0).all()
        assert (view.instance[nearest > 0.2] == 1).all()


def test_packing_keeps_ids_and_poses() -> None:
    shapes, T = random_scene(3)
    bodies = [Body(f"b{i}", s, t) for i, (s, t) in enumerate(zip(shapes, T)) if isinstance(s, Box | Cylinder | ConvexMesh)]
    by_body, T_world_camera = surfaces([b.shape for b in bodies], np.array([b.T_world_body for b in bodies])), view_from(3)
    b = raycast(by_body, T_world_camera, CAMERA)
    assert set(b.instance.ravel()) <= {-1, *range(len(bodies))}

    hulls = [np.random.default_rng(i).normal(0, 0.05, (20, 3)) for i in range(3)]
    frames = transform(p=np.array([[0.0, 0, 0], [0.5, 0.1, 0], [0.6, -0.1, 0.05]]))
    arm = surfaces(hulls, frames[[1, 2, 1]])
    both = raycast(join(by_body, arm), T_world_camera, CAMERA)
    alone = raycast(arm, T_world_camera, CAMERA)
    ours = both.instance >= len(bodies)
    assert ours.any()
    assert (both.instance[ours] - len(bodies) == alone.instance[ours]).all()
    assert (both.depth[ours] == alone.depth[ours]).all()

    shifted = np.array([transform(p=[0.1, 0, 0]) @ b.T_world_body for b in bodies])
    c = raycast(moved(by_body, shifted), transform(p=[0.1, 0, 0]) @ T_world_camera, CAMERA)
    assert np.abs(c.depth - b.depth)[(c.instance == b.instance)].max() < 1e-6
    assert (c.instance == b.instance).mean() > 0.999


def test_inside_knows_every_kind() -> None:
    ball = trimesh.creation.icosphere(2, 0.1)
    kinds: list[Shape | Mesh | Array] = [
        Box(np.full(3, 0.2)),
        Cylinder(0.1, 0.2),
        np.asarray(ball.vertices),
        Mesh(ball.vertices, ball.faces),
    ]
    s: Surfaces = surfaces(kinds, np.repeat(transform(rotation_about((1, 1, 0), 0.4), [0.5, 0.0, 0.0])[None], 4, 0))
    assert inside(s, np.array([0.52, 0.01, 0.03])) == [0, 1, 2, 3]
    assert inside(s, np.array([0.52, 0.01, 0.4])) == []


def test_a_still_shows_its_items_and_repeats() -> None:
    """Colours where they belong, the see-through pane blended, the line drawn, shadow on the ground; the same bytes twice."""
    T_world_camera = look_at(np.array([-0.9, 0.0, 0.5]), np.array([0.0, 0.0, 0.1]))
    camera = Intrinsics(160, 120, 150.0, 150.0, 79.5, 59.5)
    red = Item(Box(np.full(3, 0.2)), transform(p=[0, 0, 0.1]), (0.9, 0.1, 0.1))
    pane = Item(Box(np.array([0.01, 1.0, 1.0])), transform(p=[-0.3, 0, 0.1]), (0.5, 0.6, 0.9), alpha=0.2)
    path = Polyline(np.array([[-0.2, -0.2, 0.35], [-0.2, 0.2, 0.35]]), (0.0, 0.0, 1.0))
    studio = Studio(ground_z=0.0, key_lights=8, sky_lights=16)

    def still(items: list[Item], lines: list[Polyline]) -> Array:
        return shade(items, T_world_camera, camera, lines, studio=studio).astype(float)

    plain, full = still([red], []), still([red, pane], [path])
    assert full.tobytes() == still([red, pane], [path]).tobytes()
    middle = plain[60, 80]
    assert middle[0] > 2 * middle[1]
    assert full[60, 80, 2] > middle[2] + 5  # the bluish pane lies over it
    assert (full[..., 2] - full[..., 0]).max() > 120  # the line
    empty = still([], [])
    darker = (empty - plain).mean(-1)
    assert darker[70:, 100:].max() > 10  # a shadow to the right of the box
    assert empty.min() > 180
