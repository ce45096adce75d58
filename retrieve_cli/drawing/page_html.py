"""The frame of the page that `page` fills: looks, light, camera and play controls around meshcat's viewer."""

from __future__ import annotations

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@TITLE@</title>
<style>
:root { --ink: #1d2733; --quiet: #66727f; --line: #dfe4ea; --card: rgba(255, 255, 255, .86); --good: #1b7f5c; --bad: #b3401f; }
* { box-sizing: border-box; }
body { margin: 0; background: radial-gradient(ellipse at 50% 40%, #fafbfc, #e9ecf0 60%, #d9dee5) fixed; color: var(--ink); overflow: hidden;
  font: 14px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
#pane { width: 100vw; height: 100vh; overflow: hidden; touch-action: none; }
#pane canvas { display: block; cursor: grab; }
#pane canvas:active { cursor: grabbing; }
#card, #bar { position: absolute; z-index: 2; background: var(--card); border: 1px solid rgba(255, 255, 255, .9); border-radius: 12px;
  box-shadow: 0 1px 2px rgba(29, 39, 51, .06), 0 8px 28px rgba(29, 39, 51, .10); backdrop-filter: blur(8px); }
#card { left: 16px; top: 16px; width: 272px; padding: 14px 18px 12px; }
#card h1 { font-size: 17px; line-height: 1.3; font-weight: 500; letter-spacing: -.01em; margin: 0 0 4px; }
#card h1 b { font-weight: 650; }
#card p { margin: 0; color: var(--quiet); font-size: 12px; }
#card p.good, #card p.bad { font-size: 13px; font-weight: 550; margin: 10px 0 2px; color: var(--good); }
#card p.bad { color: var(--bad); }
#card ol { list-style: none; margin: 8px -8px 8px; padding: 0; max-height: 40vh; overflow: auto; }
#card li { padding: 3px 8px; border-radius: 7px; display: flex; align-items: baseline; gap: 8px; transition: background .2s; }
#card li span { color: var(--quiet); font-size: 12px; }
#card li.now { background: rgba(29, 39, 51, .07); }
#card i { display: inline-block; width: 10px; height: 10px; border-radius: 3px; flex: none; }
#card h1 i { width: 12px; height: 12px; margin: 0 5px 0 2px; }
#bar { left: 16px; right: 16px; bottom: 16px; height: 48px; display: flex; align-items: center; gap: 14px; padding: 0 16px 0 10px; }
#bar button { border: 0; background: none; color: var(--ink); font: inherit; font-weight: 550; cursor: pointer; border-radius: 8px;
  height: 34px; min-width: 40px; padding: 0 8px; }
#bar button:hover { background: rgba(29, 39, 51, .07); }
#bar button:focus-visible, #time:focus-visible { outline: 2px solid #3b74b9; outline-offset: 2px; }
#play::before { content: ""; display: inline-block; width: 0; height: 14px; margin-left: 3px; border-left: 13px solid var(--ink);
  border-top: 8px solid transparent; border-bottom: 8px solid transparent; box-sizing: border-box; vertical-align: -2px; height: 16px; }
#play.playing::before { border: solid var(--ink); border-width: 0 4.5px; width: 13px; margin-left: 0; }
#line { position: relative; flex: 1; height: 34px; }
#line s { position: absolute; top: 14px; height: 6px; border-radius: 2px; opacity: .9; pointer-events: none; }
#line::before { content: ""; position: absolute; left: 0; right: 0; top: 14px; height: 6px; border-radius: 3px; background: #cfd6de; }
#time { -webkit-appearance: none; appearance: none; position: absolute; left: -8px; width: calc(100% + 16px); margin: 0; height: 34px;
  background: none; cursor: pointer; }
#time::-webkit-slider-thumb { -webkit-appearance: none; width: 16px; height: 16px; border-radius: 50%; background: #fff;
  border: 2.5px solid var(--ink); box-shadow: 0 1px 3px rgba(29, 39, 51, .3); }
#time::-moz-range-thumb { width: 11px; height: 11px; border-radius: 50%; background: #fff; border: 2.5px solid var(--ink); }
#clock, #stage { font-variant-numeric: tabular-nums; white-space: nowrap; font-size: 13px; }
#clock { color: var(--quiet); }
#stage { width: 150px; overflow: hidden; text-overflow: ellipsis; }
#plots { position: absolute; z-index: 2; left: 16px; right: 16px; bottom: 76px; background: var(--card);
  border: 1px solid rgba(255, 255, 255, .9); border-radius: 12px;
  box-shadow: 0 1px 2px rgba(29, 39, 51, .06), 0 8px 28px rgba(29, 39, 51, .10);
  backdrop-filter: blur(8px); padding: 8px 0; cursor: crosshair; font-size: 11px; line-height: 14px; touch-action: none; }
.plot { position: relative; height: 54px; margin: 3px 0; }
.plot svg { position: absolute; left: var(--x); width: var(--w); height: 100%; overflow: hidden; background: rgba(29, 39, 51, .035);
  border-radius: 4px; }
.plot path { fill: none; vector-effect: non-scaling-stroke; stroke-width: 1.4; stroke-linejoin: round; }
.plot .area { fill: rgba(59, 116, 185, .16); stroke: none; }
.plot .edge { stroke: #3b74b9; }
.plot .guide { stroke: rgba(29, 39, 51, .22); stroke-width: 1; stroke-dasharray: 3 4; }
.plot .name { position: absolute; left: calc(var(--x) + var(--w) + 62px); top: 0; color: var(--quiet); white-space: nowrap; }
.plot .name b { color: var(--ink); font-weight: 550; }
.plot .ends { position: absolute; left: calc(var(--x) + var(--w) + 8px); top: 0; bottom: 0; display: flex; flex-direction: column;
  justify-content: space-between; color: var(--quiet); font-variant-numeric: tabular-nums; }
.plot em { font-style: normal; }
#joints { list-style: none; display: flex; flex-wrap: wrap; gap: 2px 14px; margin: 2px 16px 4px var(--x); padding: 0; color: var(--quiet); }
#joints i { display: inline-block; width: 10px; height: 3px; border-radius: 2px; margin-right: 5px; vertical-align: 3px; }
#cursor { position: absolute; top: 8px; bottom: 8px; width: 1.5px; background: var(--ink); opacity: .7; pointer-events: none; }
.dg { display: none; z-index: 3; }
body.tools .dg { display: block; }
@media (max-width: 720px) { .plot .name { left: 4px; font-size: 8.5px; } .plot .name span { display: none; } }
@media (max-width: 720px) { #card { width: auto; right: 16px; } #card ol, #card p:last-child { display: none; } #stage { display: none; } }
@media print { #bar, #plots { display: none; } }
</style>
</head>
<body>
<div id="pane"></div>
<div id="card">@CAPTION@</div>
@PLOTS@
@CONTROLS@
<script>
@MESHCAT@
</script>
<script>
"use strict";
const film = @SETTINGS@;
const viewer = new MeshCat.Viewer(document.getElementById("pane"));
const THREE = MeshCat.THREE;
for (const command of [
@COMMANDS@
]) viewer.handle_command_bytearray(Uint8Array.from(atob(command), (c) => c.charCodeAt(0)));

// Light: a few suns close together, whose shadows blend into a soft one, and a sky.
const vector = (p) => new THREE.Vector3(p[0], p[1], p[2]);
const eye = vector(film.eye), focus = vector(film.focus), up = new THREE.Vector3(0, 0, 1);
for (const name of ["SpotLight", "PointLightNegativeX", "PointLightPositiveX", "FillLight", "AmbientLight"])
  viewer.set_property(["Lights", name], "visible", false);
viewer.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
viewer.renderer.shadowMap.type = THREE.PCFShadowMap;
const back = eye.clone().sub(focus).setZ(0).normalize(), left = back.clone().cross(up);
const SUNS = 4;
for (let i = 0; i < SUNS; i++) {
  const sun = new THREE.DirectionalLight(0xffffff, 0.52 / SUNS), turn = 2 * Math.PI * i / SUNS;
  sun.position.copy(focus).addScaledVector(up, 2.8);
  sun.position.addScaledVector(left, 1.2 + 0.16 * Math.cos(turn)).addScaledVector(back, 0.9 + 0.16 * Math.sin(turn));
  sun.target.position.copy(focus);
  sun.castShadow = true;
  sun.shadow.mapSize.set(1024, 1024);
  Object.assign(sun.shadow.camera, { left: -1.3, right: 1.3, top: 1.3, bottom: -1.3, near: 0.5, far: 7 });
  sun.shadow.bias = -0.0006;
  sun.shadow.normalBias = 0.006;
  sun.shadow.radius = 3;
  viewer.scene.add(sun, sun.target);
}
const fill = new THREE.DirectionalLight(0xf2f6ff, 0.16);
fill.position.copy(focus).addScaledVector(left, -1.5).addScaledVector(back, 2).addScaledVector(up, 0.8);
fill.target.position.copy(focus);
const sky = new THREE.HemisphereLight(0xffffff, 0xc2c6cc, 0.6);
sky.position.copy(up);
const floor = new THREE.Mesh(new THREE.CircleGeometry(6, 64), new THREE.ShadowMaterial({ opacity: 0.20 }));
floor.position.set(focus.x, focus.y, film.ground);
viewer.scene.add(fill, fill.target, sky, floor);
viewer.scene.traverse((o) => {
  o.castShadow = o.isLight ? o.castShadow : o.isMesh === true && !o.material.transparent && o.material.type === "MeshPhongMaterial";
  o.receiveShadow = o.castShadow || o === floor;
  o.frustumCulled = false;  // three.js measures packed coordinates wrongly
  if (o.material && o.material.depthTest === false) o.renderOrder = 2;
});

// Camera: the view that shows most of the target, as near as the window's shape allows.
const upright = (p) => new THREE.Vector3(p.x, p.z, -p.y);  // the viewer's camera lives where y is up
function stand() {
  viewer.camera.near = 0.02;
  viewer.camera.zoom = 1;
  viewer.camera.position.copy(upright(eye));
  viewer.controls.target.copy(upright(focus));
  viewer.controls.update();
}
function fit() {
  const plots = document.getElementById("plots"), line = document.getElementById("line");
  const w = window.innerWidth, h = window.innerHeight, card = w > 900 ? 150 : 0;
  const bar = Math.min(h / 2, film.length > 0 ? 64 + (plots ? plots.offsetHeight + 8 : 0) : 0);
  if (plots) {  // the plots' time is the time line's
    const span = line.getBoundingClientRect();
    plots.style.setProperty("--x", span.left - 17 + "px");
    plots.style.setProperty("--w", span.width + "px");
  }
  const across = film.halfWidth / (1 - card / w), high = film.halfHeight * 1.06 / (1 - bar / h);
  viewer.camera.fov = 2 * Math.atan(Math.max(high, across * h / w)) * 180 / Math.PI;
  viewer.camera.setViewOffset(w, h, -card / 2, bar / 2, w, h);  // the card and the bar cover as little as they can
  viewer.set_3d_pane_size(w, h);
}
stand();
fit();
window.addEventListener("resize", fit);
window.addEventListener("load", fit);

// Film.
const at = (id) => document.getElementById(id);
let time = 0, playing = false, speed = 1, rest = 0, before = null;
function show(t) {
  time = Math.max(0, Math.min(film.length, t));
  viewer.animator.seek(time);
  at("time").value = time;
  if (at("cursor")) at("cursor").style.left = "calc(var(--x) + " + time / film.length + " * var(--w))";
  at("clock").textContent = time.toFixed(1) + " / " + film.length.toFixed(1) + " s";
  let now = film.stages[0];
  for (const s of film.stages) if (s.t <= time) now = s;
  at("stage").textContent = now.stage + (now.about ? " · " + now.about : "");
  document.querySelectorAll("#card li").forEach((row, i) => row.classList.toggle("now", i === now.move));
}
function play(on) {
  playing = on;
  if (on && time >= film.length) show(0);
  at("play").classList.toggle("playing", on);
  before = null;
}
function step(stamp) {
  requestAnimationFrame(step);
  if (!playing) return;
  const passed = before === null ? 0 : Math.min(0.1, (stamp - before) / 1000);
  before = stamp;
  if (time < film.length) { show(time + passed * speed); rest = 0; }
  else if ((rest += passed) > 2.5) show(0);  // hold the end for a moment, then again
}
if (film.length > 0) {
  for (const action of viewer.animator.actions) action.play();
  at("play").onclick = () => play(!playing);
  at("time").oninput = () => { play(false); show(Number(at("time").value)); };
  const seek = (e) => {
    const span = at("line").getBoundingClientRect();
    play(false);
    show((e.clientX - span.left) / span.width * film.length);
  };
  if (at("plots")) {
    at("plots").onpointerdown = (e) => { at("plots").setPointerCapture(e.pointerId); seek(e); };
    at("plots").onpointermove = (e) => { if (e.buttons) seek(e); };
  }
  at("speed").onclick = () => {
    speed = { 1: 2, 2: 4, 4: 0.5, 0.5: 1 }[speed];
    at("speed").textContent = (speed === 0.5 ? "½" : speed) + "×";
  };
  const asked = /[#&]t=([0-9.]+)/.exec(location.hash);  // page.html#t=3.5 opens at that moment, and waits
  show(asked ? Number(asked[1]) : 0);
  play(!asked);
  requestAnimationFrame(step);
}
window.addEventListener("keydown", (e) => {
  if (e.key === " " && film.length > 0 && e.target.tagName !== "BUTTON") { e.preventDefault(); play(!playing); }
  if (e.key === "r") stand();
  if (e.key === "t") document.body.classList.toggle("tools");  // meshcat's own panel
  viewer.set_dirty();
});
</script>
</body>
</html>
"""
