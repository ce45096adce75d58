"""`retrieve show` and `retrieve demo`: pages that need nothing else and move as the plan says, stills that show the target, mistakes."""

from __future__ import annotations

import base64
import http.client
import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import documents
import numpy as np
import pytest
import trimesh
import umsgpack
from PIL import Image

from kinematics.robots.load import from_ref, load
from kinematics.transforms import rotation_from_wxyz
from perception.rendering.colours import TARGET_COLOUR
from planning.io.files import read_plans, read_scenes
from retrieve_cli.drawing.picture import Film, held_by, straightened
from retrieve_cli.drawing.plots import MOST_M
from retrieve_cli.drawing.visuals import visuals
from retrieve_cli.show import write_html

ROOT = Path(__file__).resolve().parents[3]
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The demo's folder and what it said."""
    folder = tmp_path_factory.mktemp("demo") / "out"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "retrieve_cli", "demo", "--out", folder, "--seed", "0"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    return folder, done.stderr


@pytest.fixture(scope="module")
def film(demo: tuple[Path, str]) -> Film:
    (_, scene), (_, plan) = next(read_scenes(demo[0] / "scene.jsonl")), next(read_plans(demo[0] / "plan.jsonl"))
    return Film(from_ref(scene.robot), scene, plan)


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    file = tmp_path / "scenes.jsonl"
    file.write_text(documents.lines(documents.scene("0-0"), documents.scene("0-1")))
    return file


def commands(html: str) -> list[dict[str, Any]]:
    """The messages that a page hands to meshcat's viewer."""
    block = html.split("for (const command of [")[1].split("])")[0]
    return [umsgpack.unpackb(base64.b64decode(m)) for m in re.findall(r'"([A-Za-z0-9+/=]+)"', block)]


def assert_needs_nothing_else(html: str) -> None:
    addresses = set(re.findall(r"(?:https?:|[\"'`(])//[\w.-]+\.[a-z]{2,}[^\"'` )]*", re.sub(r'"[A-Za-z0-9+/=]{100,}"', "", html)))
    assert addresses <= {"http://www.w3.org/1999/xhtml"}  # a namespace, never asked for
    assert not re.findall(r"<(?:script|img|link|iframe)[^>]*\b(?:src|href)=", html)
    assert not re.findall(r"@[A-Z]+@", html.split("<script>")[0] + html.split("</script>")[-1])


def target_pixels(file: Path) -> int:
    """Pixels of the target's hue."""
    hsv = np.asarray(Image.open(file).convert("HSV")).astype(int)
    hue = np.asarray(Image.new("RGB", (1, 1), tuple(round(255 * c) for c in TARGET_COLOUR)).convert("HSV")).astype(int)[0, 0, 0]
    return int(((np.abs(hsv[..., 0] - hue) < 8) & (hsv[..., 1] > 150) & (hsv[..., 2] > 100)).sum())


# The page ---------------------------------------------------------------------------------------------------------------------------------


def test_page_of_a_plan(demo: tuple[Path, str], film: Film) -> None:
    html = (demo[0] / "plan.html").read_text(encoding="utf-8")
    assert_needs_nothing_else(html)
    assert len(html) < 5e6
    assert 'id="play"' in html
    assert film.scene.id in html
    for move in film.done:
        assert f"{move.object} <span>to region {move.region}</span>" in html
    animation = [c for c in commands(html) if c["type"] == "set_animation"]
    assert len(animation) == 1
    assert len(animation[0]["animations"]) >= len(film.robot.arm_joints)


def curves(html: str) -> dict[str, list[np.ndarray]]:
    """The lines (N, 2) of a page's plots, by what they show: time in thousandths of the whole, then hundredths downwards."""
    out = {}
    for name, inside in re.findall(r'aria-label="(\w+) over time">(.*?)</svg>', html):
        paths = re.findall(r'<path d="M([^"]*)" (?:class="edge"|stroke)', inside)
        out[name] = [np.array([[float(x) for x in p.split()] for p in path.split(" L")]) for path in paths]
    return out


def test_plots_show_what_the_plan_does(retrieve: Call, demo: tuple[Path, str], film: Film, tmp_path: Path, scene_file: Path) -> None:
    out = tmp_path / "plots.html"
    plan = ("show", demo[0] / "plan.jsonl", "--scenes", demo[0] / "scene.jsonl", "--html", out)
    assert retrieve(*plan, "--plots")[0] == 0
    html = out.read_text(encoding="utf-8")
    assert_needs_nothing_else(html)
    drawn, robot = curves(html), film.robot
    (clearance,) = drawn["clearance"]
    least = min(s.motion.clearance_m for s in film.stretches if s.motion.clearance_m is not None)
    assert f"least {1000 * least:.1f} mm" in html
    assert clearance[:, 0].min() == 0
    assert clearance[:, 0].max() == 1000
    assert 100 * (1 - least / MOST_M) > clearance[:, 1].max() - 1
    joints = [*robot.arm_joints, robot.gripper_joint]
    for k, j in enumerate(joints):
        for t, y in drawn["position"][k][:: len(drawn["position"][k]) // 20 + 1]:
            q = film.state_at(t / 1000 * film.length_s).q[j]
            assert 1 - y / 100 == pytest.approx((q - robot.lower[j]) / (robot.upper[j] - robot.lower[j]), abs=0.02)
    assert all(len(drawn[name]) == len(joints) for name in ("velocity", "acceleration"))
    assert retrieve(*plan)[0] == 0
    assert set(curves(out.read_text(encoding="utf-8"))) == {"clearance"}
    code, _, said = retrieve("show", scene_file, "--plots", "--html", out)
    assert code == 2
    assert "there is no plan whose joints could be plotted" in said


def test_page_of_a_scene(retrieve: Call, scene_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "scene.html"
    assert retrieve("show", scene_file, "--index", 1, "--html", out) == (0, "", "")
    html = out.read_text(encoding="utf-8")
    assert_needs_nothing_else(html)
    assert 'id="play"' not in html.split("<script>")[0]
    assert "0-1" in html
    sent = commands(html)
    assert not [c for c in sent if c["type"] == "set_animation"]
    drawn = {c["path"] for c in sent if c["type"] == "set_object"}
    assert {"/objects/box_0", "/objects/can_1", "/objects/box_2", "/target/ring", "/cabinet/back"} <= drawn


def test_page_moves_as_the_plan_says(demo: tuple[Path, str], film: Film) -> None:
    """The viewer's own rules, in Python: nested transforms, even turns between keys, seen or not. Every link and object, at many times."""
    sent = commands((demo[0] / "plan.html").read_text(encoding="utf-8"))
    at_rest = {c["path"]: np.array(c["matrix"]).reshape(4, 4).T for c in sent if c["type"] == "set_transform"}
    hidden = {c["path"] for c in sent if c["type"] == "set_property" and c["property"] == "visible" and not c["value"]}
    clips = {a["path"]: {t["name"]: t["keys"] for t in a["clip"]["tracks"]} for a in sent[-1]["animations"]}
    tree = film.robot.tree
    paths = {name: "/robot/" + "/".join(tree.names[k] for k in tree.path(i)) for i, name in enumerate(tree.names)}

    def pose(path: str, time: float) -> np.ndarray:
        T = np.eye(4)
        for end in [*[m.start() for m in re.finditer("/", path)][1:], len(path)]:
            here = at_rest.get(path[:end], np.eye(4)).copy()
            for name, keys in clips.get(path[:end], {}).items():
                if name == ".quaternion":
                    here[:3, :3] = slerp(keys, time)
                elif name == ".position":
                    here[:3, 3] = [np.interp(time, [k["time"] for k in keys], [k["value"][i] for k in keys]) for i in range(3)]
            T = T @ here
        return T

    def seen(path: str, time: float) -> bool:
        keys = clips.get(path, {}).get(".visible")
        return path not in hidden if keys is None else bool([k["value"] for k in keys if k["time"] <= time][-1])

    in_hand = {c["path"]: c["path"].split()[-1] for c in sent if c["type"] == "set_object" and re.search(r"/hand/held \d+ \w+$", c["path"])}
    assert sorted(in_hand.values()) == sorted(h.body for h in held_by(film))
    for time in np.random.default_rng(0).uniform(0, film.length_s, 60):
        state = film.state_at(time)
        links = film.link_poses(state.q)
        for name in {p.link for p in visuals(film.robot)} | {"hand"}:
            assert np.abs(pose(paths[name], time) - links[tree.index[name]]).max() < 1e-3, (name, time)
        for body in film.bodies(state):
            shown = [p for p in [f"/objects/{body.name}", *(p for p, n in in_hand.items() if n == body.name)] if seen(p, time)]
            assert len(shown) == 1, (body.name, time, shown)
            assert np.abs(pose(shown[0], time) - body.T_world_body).max() < 1e-3, (body.name, time)


def slerp(keys: list[dict[str, Any]], time: float) -> np.ndarray:
    """The rotation (3, 3) of a track of quaternions (x, y, z, w) at a time, the shorter way round."""
    times = np.array([k["time"] for k in keys])
    i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, max(len(times) - 2, 0)))
    a, b = (np.array(keys[min(j, len(keys) - 1)]["value"]) for j in (i, i + 1))
    share = np.clip((time - times[i]) / max(times[min(i + 1, len(times) - 1)] - times[i], 1e-9), 0, 1)
    b = b if a @ b >= 0 else -b
    angle = np.arccos(np.clip(a @ b, -1, 1))
    q = a if angle < 1e-6 else (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
    return rotation_from_wxyz([q[3], q[0], q[1], q[2]])


def test_page_of_a_plan_without_motions(film: Film, tmp_path: Path) -> None:
    assert film.plan is not None
    out = tmp_path / "stuck.html"
    write_html(film.scene, replace(film.plan, success=False, motions=(), moves=()), out)
    html = out.read_text(encoding="utf-8")
    assert "Not retrieved" in html
    assert 'id="play"' not in html.split("<script>")[0]


# Stills -----------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["before", "during", "after", "hand"])
def test_stills_of_the_demo(name: str, demo: tuple[Path, str]) -> None:
    file = demo[0] / f"{name}.png"
    with Image.open(file) as image:
        assert image.width == 1280
        assert image.height >= 720
        pixels = np.asarray(image.convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 1000
    assert target_pixels(file) > (300 if name == "during" else 1000)  # the arm may be in front while it works


def test_still_of_a_scene(retrieve: Call, scene_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "scene.png"
    assert retrieve("show", scene_file, "--png", out) == (0, "", "")
    assert target_pixels(out) > 1000
    assert not list(tmp_path.glob("*.part.*"))


def test_still_by_the_hands_camera(retrieve: Call, scene_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "hand.png"
    assert retrieve("show", scene_file, "--png", out, "--camera", "hand") == (0, "", "")
    assert np.asarray(Image.open(out)).std() > 1


# The film ---------------------------------------------------------------------------------------------------------------------------------


def test_film_ends_as_the_plan_does(film: Film) -> None:
    assert film.plan is not None
    assert film.length_s == pytest.approx(sum(m.t_s[-1] for m in film.plan.motions))
    end = film.state_at(film.length_s)
    assert end.held is not None
    assert end.held.body == film.scene.target
    for move in film.done:
        assert end.poses[move.object] == pytest.approx(move.T_world_to, abs=1e-3)
    assert [s.move for s in film.stretches] == sorted(s.move for s in film.stretches)
    assert {s.move for s in film.stretches} == set(range(len(film.done) + 1))
    for s in film.stretches:
        assert s.motion.held is None or s.motion.held.body == s.about


def test_joints_in_another_order(film: Film) -> None:
    motion = film.stretches[0].motion
    other = replace(motion, joint_names=motion.joint_names[::-1], q=motion.q[:, ::-1])
    assert (film.full(other) == motion.q).all()


def test_straight_runs_lose_their_points() -> None:
    line = np.linspace([0.0, 0, 0], [1, 0, 0], 50)
    corner = np.concatenate([line, np.linspace([1.0, 0, 0], [1, 1, 0], 50)])
    assert straightened(corner) == pytest.approx(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]]))
    assert len(straightened(np.zeros((5, 3)))) == 1


def test_every_robot_has_looks(robot: Any) -> None:
    pieces = visuals(robot)
    assert {p.link for p in pieces} >= {h.link for h in robot.hulls if h.link in robot.fingers}
    for piece in pieces:
        assert piece.faces.max() < len(piece.vertices)
        assert min(piece.colour) > 0.04
        assert max(piece.colour) < 0.96
        assert max(piece.colour) - min(piece.colour) < 0.4, "the strong colours are the objects'"
    visuals.cache_clear()
    for piece, kept in zip(pieces, visuals(robot), strict=True):
        assert (piece.link, piece.colour) == (kept.link, kept.colour)
        assert np.array_equal(piece.vertices, kept.vertices)
        assert np.array_equal(piece.faces, kept.faces)


@pytest.mark.parametrize(("plain_m", "drawn"), [(0.0, 1), (0.1, 2), (0.3, 1)])
def test_a_textured_mesh_is_left_out_where_its_link_has_more_that_is_plain(plain_m: float, drawn: int, tmp_path: Path) -> None:
    """Labels and cables are; UR20's arm, all of it textured but for its core, was no more than that core."""
    mesh = trimesh.creation.box((0.2, 0.2, 0.2))
    image = Image.new("RGB", (64, 64), (200, 20, 20))
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), image=image)
    mesh.export(tmp_path / "label.glb")
    looks = '<visual><geometry><mesh filename="label.glb"/></geometry></visual>'
    looks += f'<visual><geometry><box size="{plain_m} {plain_m} {plain_m}"/></geometry></visual>' if plain_m else ""
    text = (Path(__file__).resolve().parents[3] / "examples" / "04_own_arm" / "arm.urdf").read_text()
    (tmp_path / "arm.urdf").write_text(text.replace('<link name="palm">', f'<link name="palm">{looks}'))
    pieces = [p for p in visuals(load(str(tmp_path / "arm.urdf"))) if p.link == "palm"]
    assert len(pieces) == drawn
    reddest = max(pieces, key=lambda p: p.colour[0] - p.colour[1])
    assert (reddest.colour[0] - reddest.colour[1] > 0.1) == (plain_m < 0.2), "its texture's colour"


# The demo ---------------------------------------------------------------------------------------------------------------------------------


def test_demo_tells_its_story(demo: tuple[Path, str], film: Film) -> None:
    folder, said = demo
    assert {p.name for p in folder.iterdir()} == {
        "scene.jsonl", "plan.jsonl", "plan.html", "before.png", "during.png", "after.png", "hand.png"
    }  # fmt: skip
    assert film.plan is not None
    assert film.plan.success
    assert film.plan.verified
    assert len(film.done) >= 1
    assert f"{film.scene.target} is blocked: " in said
    for number, move in enumerate(film.done, 1):
        assert f"  {number}. {move.object} moves" in said
    assert f"{film.scene.target} comes out" in said


def test_demo_can_be_planned_again(demo: tuple[Path, str], film: Film, retrieve: Call, tmp_path: Path) -> None:
    again = tmp_path / "again.jsonl"
    assert retrieve("plan", demo[0] / "scene.jsonl", "--seed", 0, "-o", again)[0] == 0
    plan = next(read_plans(again))[1]
    assert film.plan is not None
    assert [m.q.tolist() for m in plan.motions] == [m.q.tolist() for m in film.plan.motions]


def test_demo_into_a_file(retrieve: Call, tmp_path: Path) -> None:
    file = tmp_path / "taken"
    file.write_text("")
    code, _, said = retrieve("demo", "--out", file)
    assert code == 2
    assert said == f"{file}: is a file, not a folder; name another one with --out\n"


# Mistakes ---------------------------------------------------------------------------------------------------------------------------------


@pytest.fixture
def plan_file(tmp_path: Path) -> Path:
    file = tmp_path / "plans.jsonl"
    file.write_text(documents.lines(documents.plan("0-1"), documents.plan("9-9")))
    return file


def test_a_plan_needs_its_scene(retrieve: Call, plan_file: Path) -> None:
    code, out, said = retrieve("show", plan_file, "--png", "x.png")
    assert (code, out) == (2, "")
    assert said == f"{plan_file}:1: a plan is shown in its scene: name the file that has scene 0-1, with --scenes FILE\n"


def test_the_scene_is_not_there(retrieve: Call, plan_file: Path, scene_file: Path) -> None:
    code, _, said = retrieve("show", plan_file, "--index", 1, "--scenes", scene_file, "--png", "x.png")
    assert code == 2
    assert said.startswith(f"{scene_file}: none of its 2 scenes is 9-9, for which the plan at {plan_file}:2 was made")


def test_the_plan_is_for_another_robot(retrieve: Call, plan_file: Path, scene_file: Path, tmp_path: Path) -> None:
    code, _, said = retrieve("show", plan_file, "--scenes", scene_file, "--html", tmp_path / "x.html")
    assert code == 2
    assert said == f"{plan_file}:1: the plan moves the joints shoulder, elbow, finger; the scene's robot is ur5e\n"


def test_the_line_is_not_there(retrieve: Call, scene_file: Path) -> None:
    code, _, said = retrieve("show", scene_file, "--index", 2, "--png", "x.png")
    assert code == 2
    assert said == f"{scene_file}: there is no line for --index 2: it has 2 lines, and the first is --index 0\n"


def test_the_plan_moves_what_is_not_there(film: Film, tmp_path: Path) -> None:
    fewer = replace(film.scene, objects=tuple(b for b in film.scene.objects if b.name != film.done[0].object))
    with pytest.raises(ValueError, match="which scene"):
        write_html(fewer, film.plan, tmp_path / "x.html")


@pytest.mark.parametrize("option", ["--html", "--png"])
def test_the_folder_is_not_there(option: str, retrieve: Call, scene_file: Path, tmp_path: Path) -> None:
    code, _, said = retrieve("show", scene_file, option, tmp_path / "no" / f"x.{option[2:]}")
    assert code == 2
    assert "does not exist; make it first" in said


def test_a_still_is_a_png(retrieve: Call, scene_file: Path, tmp_path: Path) -> None:
    code, _, said = retrieve("show", scene_file, "--png", tmp_path / "x.jpg")
    assert code == 2
    assert "ends in .png" in said


# Live -------------------------------------------------------------------------------------------------------------------------------------


@contextmanager
def ending(process: subprocess.Popen[str]) -> Iterator[None]:
    """Nothing is left running when a test fails."""
    try:
        yield
    finally:
        process.kill()


def test_live_viewer_serves_the_page_until_it_is_interrupted() -> None:
    live = subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "retrieve_cli", "show", "-"],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell ignores it for what runs in the background
    )  # fmt: skip
    with live, ending(live):
        assert live.stdin is not None
        assert live.stderr is not None
        live.stdin.write(documents.lines(documents.scene()))
        live.stdin.close()
        said = live.stderr.readline()
        port = re.fullmatch(r"open http://127\.0\.0\.1:(\d+)/ in a browser; Ctrl-C ends\n", said)
        assert port, said
        for path, status in (("/", 200), ("/favicon.ico", 404)):
            connection = http.client.HTTPConnection("127.0.0.1", int(port[1]), timeout=20)
            connection.request("GET", path)
            answer = connection.getresponse()
            content = answer.read().decode()
            connection.close()
            assert answer.status == status
            assert ("MeshCat" in content) == (status == 200)
        live.send_signal(signal.SIGINT)
        assert live.wait(20) == 130
        assert live.stderr.read() == ""


def test_no_name_gets_out_of_the_page() -> None:
    from retrieve_cli.drawing.page import in_script

    evil = {"</script><script>alert(1)</script>": "@MESHCAT@ <!-- & \u2028"}
    text = in_script(evil)
    assert not set("<>&") & set(text)
    assert json.loads(text) == evil
