"""`retrieve show`: a scene or a plan as a page, as a still picture, or live in the browser."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.errors import InputError, blame, did_you_mean
from planning.io.files import read_either, read_scene_lines
from planning.io.outputs import is_special, write_text
from retrieve_cli.terminal import mesh_progress, say

if TYPE_CHECKING:
    from kinematics.scene import Scene
    from planning.plan import Plan
    from retrieve_cli.drawing.picture import Film

FIRST_PORT, PORTS = 7000, 100
"""meshcat's own choice, and how many ports are tried before any free one."""


def run(
    *,
    file: Path | None,
    index: int,
    scenes: Path | None,
    html: Path | None,
    png: Path | None,
    camera: str,
    plots: bool,
    parts: bool = False,
) -> None:
    """Show line `index` of a file: write `html` and `png` where asked, else serve the page until Ctrl-C. plots: of the joints, too.

    parts: of meshes, the convex parts that stand for them.
    """
    if png is not None and png.suffix.lower() != ".png":
        raise InputError(f"show: {png}: a still is a PNG file; give it a name that ends in .png")
    if html is not None:
        check_page(html, "show")
    where, scene, plan = _find(file, index, scenes)
    with blame(where):
        film = _film(scene, plan, parts)
    if png is not None:
        from retrieve_cli.drawing.still import write_png

        write_png(film, png, camera=camera)
    if html is not None:
        with blame(where):
            write_text(html, page_of(film, plots=plots))
    if html is None and png is None:
        with blame(where):
            content = page_of(film, plots=plots)
        _serve(content)


def check_page(out: Path, command: str) -> None:
    """Raises: InputError where a page's name says that it is something else; /dev/null and pipes have no name to speak of."""
    if out.suffix.lower() not in (".html", ".htm") and not is_special(out):
        raise InputError(f"{command}: {out}: the page is an HTML file; give it a name that ends in .html")


def write_html(scene: Scene, plan: Plan | None, out: Path) -> None:
    """Write a page that needs nothing else: the scene in 3D, and the plan as an animation. Raises InputError like `outputs.replacing`."""
    write_text(out, page_of(_film(scene, plan)))


def draw_png(scene: Scene, out: Path) -> None:
    """Write a still of a scene from the side. Raises InputError like `write_png`."""
    from retrieve_cli.drawing.still import write_png

    write_png(_film(scene, None), out)


def page_of(film: Film, *, plots: bool = False) -> str:
    """The page of a film. Raises: ValueError for plots of what has none."""
    from retrieve_cli.drawing.page import page

    return page(film, plots=plots)


def _film(scene: Scene, plan: Plan | None, parts: bool = False) -> Film:
    """Raises ValueError when the robot can't be loaded, or the plan is not for it."""
    from kinematics.robots.load import from_ref
    from retrieve_cli.drawing.picture import Film

    film = Film(from_ref(scene.robot, on_step=say), scene, plan, parts)
    names = {b.name for b in scene.objects}
    for motion in plan.motions if plan else ():
        film.full(motion)
        if motion.held and motion.held.body not in names:
            raise ValueError(f"the plan holds {motion.held.body!r}, which scene {scene.id} does not have")
    for move in plan.moves if plan else ():
        if move.object not in names:
            raise ValueError(f"the plan moves {move.object!r}, which scene {scene.id} does not have")
    return film


def _find(file: Path | None, index: int, scenes: Path | None) -> tuple[str, Scene, Plan | None]:
    """Where it stands, the scene and, if the line is one, the plan."""
    from kinematics.scene import Scene

    lines = list(islice(read_either(file, on_mesh=mesh_progress), index + 1))
    if len(lines) <= index:
        count = "1 line" if len(lines) == 1 else f"{len(lines)} lines"
        raise InputError(f"{_name(file)}: there is no line for --index {index}: it has {count}, and the first is --index 0")
    where, value = lines[index]
    if isinstance(value, Scene):
        return where, value, None
    if scenes is None:
        raise InputError(f"{where}: a plan is shown in its scene: name the file that has scene {value.scene}, with --scenes FILE")
    if file is None and str(scenes) == "-":
        raise InputError("show: plan and scenes can't both come from stdin; give one of them as a file")
    known = []
    for line in read_scene_lines(scenes, "show", on_mesh=mesh_progress):
        if line.id == value.scene:
            if line.scene is None:
                raise InputError(line.error)
            return where, line.scene, value
        known.append(line.id)
    hint = did_you_mean(value.scene, known)
    raise InputError(f"{scenes}: none of its {len(known)} scenes is {value.scene}, for which the plan at {where} was made{hint}")


def _name(file: Path | None) -> str:
    return "stdin" if file is None or str(file) == "-" else str(file)


def _serve(page: str) -> None:
    """The page, for the browser on this machine, until Ctrl-C: no second process, and no copy on the disk."""
    from functools import partial
    from http.server import ThreadingHTTPServer

    content = page.encode()
    for port in (*range(FIRST_PORT, FIRST_PORT + PORTS), 0):
        try:
            server = ThreadingHTTPServer(("127.0.0.1", port), partial(_handler(), content))
            break
        except OSError:
            if port == 0:
                raise
    with server:
        say(f"open http://127.0.0.1:{server.server_port}/ in a browser; Ctrl-C ends")
        server.serve_forever()


def _handler() -> type:
    from http.server import BaseHTTPRequestHandler
    from typing import Any

    class Page(BaseHTTPRequestHandler):
        def __init__(self, content: bytes, *args: Any) -> None:
            self.content = content
            super().__init__(*args)

        def do_GET(self) -> None:
            found = self.path.split("?")[0] in ("/", "/index.html")
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(self.content) if found else 0))
            self.end_headers()
            if found:
                self.wfile.write(self.content)

        def log_message(self, *_: object) -> None:
            """Requests are nobody's business."""

    return Page
