"""Objects from views: boxes by mask and by geometry alone, noise, stray pixels, and what the unseen may hide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photographs import CABINET, CAMERA, EYES, TURNED, best_matches, box, can, photograph, placed, without_masks

from kinematics.scene import Cabinet, object_box
from kinematics.transforms import apply, inverse
from perception.camera import DepthNoise, look_at, realsense_d435i
from perception.mapping.voxels import FREE, unknown_voxels
from perception.objects.clustering import cluster_instances
from perception.objects.prepared_frames import axial_noise, prepare
from perception.objects.segment import grown, iou, lie_densely, match, object_pixels, segment, standing_box

SHELF = (
    box("box_0", 0.15, 0.2, [0.06, 0.05, 0.12], 0.4),
    can("can_1", 0.2, 0.0),
    box("box_2", 0.34, -0.04, [0.05, 0.07, 0.22], -0.3),
    can("can_3", 0.45, 0.25, 0.035, 0.2),
    can("can_4", 0.3, -0.25, 0.025, 0.1),
)


@pytest.mark.parametrize("cabinet", [CABINET, TURNED], ids=["square", "turned"])
def test_by_mask_a_box_is_the_objects_own(cabinet: Cabinet) -> None:
    bodies = placed(SHELF, cabinet)
    boxes = segment(photograph(bodies, cabinet), cabinet, by="mask")
    assert set(boxes) == {b.name for b in bodies}
    for b in bodies:
        assert iou(boxes[b.name], object_box(b)) > 0.85
        assert (np.abs(boxes[b.name][:3] - object_box(b)[:3]) < 0.006).all()


@pytest.mark.parametrize("cabinet", [CABINET, TURNED], ids=["square", "turned"])
def test_geometry_alone_finds_each_object_once(cabinet: Cabinet) -> None:
    bodies = placed(SHELF, cabinet)
    boxes = segment(without_masks(photograph(bodies, cabinet)), cabinet, by="geometry")
    assert list(boxes) == [f"object_{k}" for k in range(len(bodies))]
    assert min(best_matches(bodies, boxes)) > 0.8
    front = [float((inverse(cabinet.T_world_cabinet) @ np.append(b[:3], 1))[0]) for b in boxes.values()]
    assert front[0] == min(front)


def test_geometry_alone_looks_at_no_mask() -> None:
    frames = photograph(placed(SHELF, CABINET))
    wrong = [replace(f, instance=np.zeros_like(f.instance)) for f in frames]
    a, b = segment(without_masks(frames), CABINET, by="geometry"), segment(wrong, CABINET, by="geometry")
    assert list(a) == list(b)
    assert all(np.array_equal(a[k], b[k]) for k in a)


def test_noise_is_measured_and_mended() -> None:
    bodies, noise = placed(SHELF, CABINET), DepthNoise()
    frames = photograph(bodies, CABINET, noise, camera=realsense_d435i(640, 480))
    assert axial_noise(photograph(bodies), CABINET) == 0.0
    assert axial_noise(frames, CABINET) == pytest.approx(noise.axial_1m_m, rel=0.25)
    by_mask = segment(frames, CABINET, by="mask")
    assert np.median([iou(by_mask[b.name], object_box(b)) for b in bodies]) > 0.7
    found = segment(without_masks(frames), CABINET, by="geometry")
    assert len(found) == len(bodies)
    assert np.median(best_matches(bodies, found)) > 0.7


TOUCHING = {
    "cans side by side": (can("a", 0.25, 0.03), can("b", 0.25, -0.03)),
    "one before the other": (can("a", 0.2, 0.0), can("b", 0.26, 0.0)),
    "box and can": (box("a", 0.25, 0.03, [0.06, 0.06, 0.15]), can("b", 0.25, -0.03)),
    "set back by 3 cm": (box("a", 0.25, 0.03, [0.06, 0.06, 0.15]), box("b", 0.28, -0.03, [0.06, 0.06, 0.15])),
    "flush, one lower": (box("a", 0.25, 0.03, [0.06, 0.06, 0.15]), box("b", 0.25, -0.03, [0.06, 0.06, 0.10])),
    "a wide one before a tall one": (box("a", 0.2, 0.0, [0.04, 0.2, 0.1]), box("b", 0.245, 0.0, [0.05, 0.05, 0.2])),
}


@pytest.mark.parametrize("case", TOUCHING)
def test_touching_objects_are_told_apart(case: str) -> None:
    bodies = placed(TOUCHING[case], CABINET)
    boxes = segment(without_masks(photograph(bodies)), CABINET, by="geometry")
    assert len(boxes) == 2
    assert min(best_matches(bodies, boxes)) > 0.75


def test_boxes_that_are_flush_all_over_leave_no_trace_and_stay_one() -> None:
    bodies = placed((box("a", 0.25, 0.03, [0.06, 0.06, 0.15]), box("b", 0.25, -0.03, [0.06, 0.06, 0.15])), CABINET)
    (found,) = segment(without_masks(photograph(bodies)), CABINET, by="geometry").values()
    assert iou(found, object_box(placed([box("both", 0.25, 0.0, [0.06, 0.12, 0.15])], CABINET)[0])) > 0.9


def test_the_two_visible_halves_of_one_box_behind_a_post_are_one() -> None:
    bodies = placed((box("post", 0.12, 0.0, [0.03, 0.03, 0.3]), box("wide", 0.3, 0.0, [0.06, 0.12, 0.14])), CABINET)
    frames = photograph(bodies, eyes=[(-0.15, 0.0, 0.1), (-0.15, 0.0, 0.12)])
    row = frames[0].instance[int(CAMERA.cy) + 5]
    runs = np.count_nonzero(np.diff((row == 1).astype(int)) == 1)
    assert runs == 2  # the post does divide it in the picture
    boxes = segment(without_masks(frames), CABINET, by="geometry")
    assert len(boxes) == 2
    widths = sorted(b[4] for b in boxes.values())
    assert widths[1] == pytest.approx(0.12, abs=0.01)


def test_a_wide_box_is_one() -> None:
    bodies = placed([box("cereal", 0.3, 0.0, [0.07, 0.25, 0.25])], CABINET)
    boxes = segment(without_masks(photograph(bodies)), CABINET, by="geometry")
    assert len(boxes) == 1
    assert best_matches(bodies, boxes)[0] > 0.9


def test_pixels_between_an_object_and_what_is_behind_it_are_dropped() -> None:
    bodies = placed([can("can", 0.2, 0.0)], CABINET)
    frames, rng = photograph(bodies), np.random.default_rng(0)
    clean = segment(frames, CABINET)["can"]
    flying = []
    for f in frames:
        depth, own = f.depth.copy(), f.instance == 0
        rim = own & ~(np.roll(own, 1, 1) & np.roll(own, -1, 1))
        depth[rim] += rng.uniform(0.0, 0.2, np.count_nonzero(rim)).astype(np.float32)
        flying.append(replace(f, depth=depth))
    assert np.abs(segment(flying, CABINET)["can"] - clean).max() < 0.015  # they lie up to 20 cm behind
    assert len(segment(without_masks(flying), CABINET, by="geometry")) == 1


def test_the_points_of_an_object_are_those_of_its_pixels_frame_by_frame() -> None:
    """Also where a frame has other names, or in another order, and where a mask has numbers that are nobody's."""
    frames = photograph(placed(SHELF, CABINET), eyes=EYES[:3])
    assert frames[1].instance is not None
    assert frames[2].instance is not None
    frames[1] = replace(frames[1], instance=np.where(frames[1].instance == 4, 99, frames[1].instance), names=frames[1].names[:4])
    swapped = np.array([1, 0, 2, 3, 4, -1])[frames[2].instance].astype(np.int32)
    frames[2] = replace(frames[2], instance=swapped, names=tuple(frames[2].names[i] for i in (1, 0, 2, 3, 4)))
    views = prepare(frames, CABINET)
    found = object_pixels(views)
    assert sorted(found) == sorted(b.name for b in SHELF)
    for name, (points, pixels) in found.items():
        own = [i & (f.instance == f.names.index(name)) if name in f.names else i & False for f, i in zip(frames, views.inside)]
        cloud = np.concatenate([p[mine] for p, mine in zip(views.points, own)]).astype(float)
        source = [(k, pixel) for k, mine in enumerate(own) for pixel in np.flatnonzero(mine)]
        dense = lie_densely(cloud)
        assert np.array_equal(points, cloud[dense])
        assert np.array_equal(pixels, np.array(source)[dense])


def test_the_robots_own_pixels_are_no_object() -> None:
    bodies = placed([can("can", 0.3, 0.1)], CABINET)
    hand = placed([box("hand", 0.1, -0.1, [0.05, 0.05, 0.2])], CABINET)
    frames = [
        replace(f, arm=f.instance == 1, names=("can",), instance=np.where(f.instance == 0, 0, -1).astype(np.int32))
        for f in photograph([*bodies, *hand])
    ]
    for by in ("mask", "geometry"):
        boxes = segment(frames, CABINET, by=by)
        assert len(boxes) == 1
        assert best_matches(bodies, boxes)[0] > 0.8


@pytest.mark.parametrize("by", ["mask", "geometry"])
def test_what_shows_nothing_gives_no_objects(by: str) -> None:
    empty = photograph([])
    assert segment(empty, CABINET, by=by) == {}
    assert segment([], CABINET, by=by) == {}
    blind = [replace(f, depth=np.zeros_like(f.depth)) for f in empty]
    assert segment(blind, CABINET, by=by) == {}
    inside_a_wall = replace(
        empty[0], T_world_camera=CABINET.T_world_cabinet @ look_at(np.array([-0.1, 0, -0.01]), np.array([0.3, 0, -0.01]))
    )
    assert segment([inside_a_wall], CABINET, by=by) == {} or by == "geometry"


def test_nothing_but_noise_is_told_so() -> None:
    rng = np.random.default_rng(0)
    frames = [replace(f, depth=rng.uniform(0.2, 1.0, f.depth.shape).astype(np.float32)) for f in photograph([])]
    assert segment(frames, CABINET, by="mask") == {}
    with pytest.raises(ValueError, match="noise, or the cameras' poses are wrong"):
        segment(without_masks(frames), CABINET, by="geometry")


def test_images_of_different_sizes_go_together() -> None:
    bodies = placed(SHELF, CABINET)
    frames = [*photograph(bodies, eyes=EYES[:4]), *photograph(bodies, eyes=EYES[4:], camera=realsense_d435i(200, 120))]
    assert len(segment(without_masks(frames), CABINET, by="geometry")) == len(bodies)


def test_masks_must_be_there_and_the_word_must_be_known() -> None:
    frames = photograph(placed(SHELF, CABINET))
    with pytest.raises(ValueError, match="frame 0 has no mask"):
        segment(without_masks(frames), CABINET, by="mask")
    with pytest.raises(ValueError, match="not by 'colour'"):
        segment(frames, CABINET, by="colour")


def test_every_box_stands_on_the_floor() -> None:
    points = np.array([[0.2, 0.0, 0.1], [0.25, 0.05, 0.18]])
    assert standing_box(points, CABINET) == pytest.approx([0.525, 0.025, 0.19, 0.05, 0.05, 0.18])
    turned = standing_box(points, TURNED)
    corners = apply(TURNED.T_world_cabinet, points)
    assert turned[2] - turned[5] / 2 == pytest.approx(0.2)
    assert turned[0] + turned[3] / 2 == pytest.approx(corners[:, 0].max())


def test_the_target_is_the_box_that_has_most_in_common() -> None:
    boxes = {"near": np.array([0.5, 0, 0.1, 0.1, 0.1, 0.2]), "far": np.array([0.8, 0, 0.1, 0.1, 0.1, 0.2])}
    assert match(boxes, np.array([0.77, 0.01, 0.1, 0.1, 0.1, 0.2])) == "far"
    assert match(boxes, np.array([0.77, 0.9, 0.1, 0.1, 0.1, 0.2])) is None
    assert match({}, boxes["far"]) is None
    assert iou(boxes["near"], boxes["near"]) == pytest.approx(1)
    assert iou(np.array([0, 0, 0, 2, 2, 2.0]), np.array([1, 0, 0, 2, 2, 2.0])) == pytest.approx(1 / 3)


def test_a_box_grows_into_the_unseen_but_not_into_the_seen() -> None:
    seen = np.array([0.5, 0.0, 0.16, 0.02, 0.06, 0.12])  # a front face, 2 cm of depth
    nothing = unknown_voxels(CABINET)
    everything = replace(nothing, state=np.full_like(nothing.state, FREE))
    assert np.allclose(grown(seen, everything), seen)
    state = everything.state.copy()
    index = nothing.index(np.array([[0.51, -0.03, 0.105], [0.60, 0.03, 0.215]]))
    state[index[0, 0] : index[1, 0], index[0, 1] : index[1, 1] + 1, : index[1, 2] + 1] = 0
    deeper = grown(seen, replace(nothing, state=state))
    assert deeper[3] == pytest.approx(0.06)  # as deep as it is wide
    assert deeper[0] - deeper[3] / 2 == pytest.approx(0.49)  # not forwards
    assert np.allclose(deeper[[1, 2, 4, 5]], seen[[1, 2, 4, 5]])
    blind = grown(seen, nothing)
    assert (blind[3:] >= seen[3:]).all()
    assert blind[2] - blind[5] / 2 == pytest.approx(0.1)  # the floor stays the floor
    assert blind[5] <= seen[5] + 0.06 + 1e-9


def test_a_box_never_grows_through_a_wall() -> None:
    seen = np.array([0.3 + 0.56 - 0.015, 0.43 - 0.015, 0.16, 0.02, 0.02, 0.12])
    box = grown(seen, unknown_voxels(CABINET))
    assert box[0] + box[3] / 2 <= 0.86 + 0.005
    assert box[1] + box[4] / 2 <= 0.43 + 0.005


def test_a_map_of_the_same_frames_lets_grown_boxes_hold_the_objects() -> None:
    bodies = placed(SHELF, CABINET)
    frames = photograph(bodies, eyes=EYES[:2])
    voxels = unknown_voxels(CABINET)
    for f in frames:
        voxels = voxels.fuse(f.depth, f.intrinsics, f.T_world_camera)
    tight, wide = segment(frames, CABINET), segment(frames, CABINET, voxels)
    assert len(tight) == len(SHELF)
    for name in tight:
        low, high = wide[name][:3] - wide[name][3:] / 2, wide[name][:3] + wide[name][3:] / 2
        assert (low <= tight[name][:3] - tight[name][3:] / 2 + 1e-9).all()
        assert (high >= tight[name][:3] + tight[name][3:] / 2 - 1e-9).all()


def test_labels_fit_the_pixels() -> None:
    frames = photograph(placed(SHELF, CABINET))
    found = cluster_instances(prepare(without_masks(frames), CABINET)).frames
    for k in range(len(SHELF)):
        own = np.concatenate([(f.instance == k).ravel() for f in frames])
        other = np.concatenate([f.instance.ravel() for f in found])
        names, counts = np.unique(other[own & (other >= 0)], return_counts=True)
        assert counts.max() > 0.85 * np.count_nonzero(own)
        assert counts.max() > 0.97 * counts.sum()
        assert len(names)
