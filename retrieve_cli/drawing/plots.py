"""What a plan's page shows over time below its animation: the clearance, and on request the joints against their limits. As SVG."""

from __future__ import annotations

from html import escape

import numpy as np

from kinematics.collision.clearance import clearances
from kinematics.collision.stretches import Stretch
from kinematics.quintic_spline import evaluate
from kinematics.transforms import Array
from retrieve_cli.drawing.picture import Film

STEP_S = 0.02
MOST_M = 0.05
"""Clearances beyond this are drawn as this."""
WIDTH, HEIGHT = 1000, 100
"""Of each plot, in its own units; the page stretches it to the width of the time line."""
COLOURS = ("#3b74b9", "#c8553d", "#1b7f5c", "#8a63b0", "#b8860b", "#3f9aa6", "#7a5548")


def clearance_plot(film: Film) -> str:
    """The clearance over time, in mm, as a row of the page; empty without motions."""
    if not film.stretches:
        return ""
    times, values = list[Array](), list[Array]()
    for s in film.stretches:
        t = np.linspace(0, s.motion.t_s[-1], 2 + int(s.motion.t_s[-1] / STEP_S))
        q = film.full(s.motion, t)
        times.append(s.start_s + t)
        least = min(s.motion.clearance_m or 0.0, MOST_M)  # measured on all of the way; the curve's fingers are rounded
        stretch = Stretch(q, s.poses, s.motion.held, tuple(s.motion.allowed_contacts))
        values.append(np.maximum(clearances(film.robot, film.scene, stretch, MOST_M), least))
    t, mm = np.concatenate(times), 1000 * np.concatenate(values)
    x, y = _x(film, t), HEIGHT * (1 - mm / (1000 * MOST_M))
    area = f'<path d="{_path(x, y)} L{WIDTH} {HEIGHT} L0 {HEIGHT} Z" class="area"/><path d="{_path(x, y)}" class="edge"/>'
    guides = "".join(_guide(HEIGHT * (1 - level / (1000 * MOST_M))) for level in (10,))
    known = [1000 * s.motion.clearance_m for s in film.stretches if s.motion.clearance_m is not None]
    return _row("clearance", f"least {min([mm.min(), *known]):.1f} mm", f"{1000 * MOST_M:.0f} mm", "0", guides + area)


def joint_plots(film: Film) -> str:
    """Rows of the page: positions between their limits, velocities and accelerations as shares of theirs, a line a joint, and the legend.

    Raises: ValueError for a plan without velocities, as version 1 has them.
    """
    if not film.stretches:
        raise ValueError("there is no plan whose joints could be plotted")
    if any(s.motion.spline is None for s in film.stretches):
        raise ValueError("the plan has waypoints and no velocities; plan the scene anew, `retrieve plan` writes plan@2")
    robot = film.robot
    moving = [*robot.arm_joints, robot.gripper_joint]
    low, high = (np.array([limit[j] if np.isfinite(limit[j]) else sign * np.pi for j in moving])
                 for limit, sign in ((robot.lower, -1), (robot.upper, 1)))  # fmt: skip
    q, qd, qdd = (_sampled(film, order)[:, moving] for order in range(3))
    t = np.concatenate([s.start_s + _times(film, k) for k, s in enumerate(film.stretches)])
    shares = ((q - low) / (high - low), 0.5 + 0.5 * qd / robot.velocity[moving], 0.5 + 0.5 * qdd / robot.acceleration[moving])
    used = [float(np.abs(2 * share - 1).max()) for share in shares[1:]]
    said = ("between its limits", f"up to {100 * used[0]:.0f} % of the limit", f"up to {100 * used[1]:.0f} % of the limit")
    ends = (("upper", "lower"), ("+100 %", "−100 %"), ("+100 %", "−100 %"))
    rows = []
    for name, share, words, (top, bottom) in zip(("position", "velocity", "acceleration"), shares, said, ends):
        paths = [_path(_x(film, t), HEIGHT * (1 - column)) for column in share.T]
        lines = [f'<path d="{path}" stroke="{_colour(i)}"/>' for i, path in enumerate(paths)]
        rows.append(_row(name, words, top, bottom, _guide(HEIGHT / 2) + "".join(lines)))
    names = "".join(f'<li><i style="background:{_colour(i)}"></i>{escape(robot.joint_names[j])}</li>' for i, j in enumerate(moving))
    return f'<ul id="joints">{names}</ul>{"".join(rows)}'


def _times(film: Film, k: int) -> Array:
    motion = film.stretches[k].motion
    return np.linspace(0, motion.t_s[-1], 2 + int(motion.t_s[-1] / (STEP_S / 2)))


def _sampled(film: Film, order: int) -> Array:
    """Positions, velocities or accelerations (N, J) of the whole plan, in the robot's own order of joints."""
    out = []
    for k, s in enumerate(film.stretches):
        assert s.motion.spline is not None
        order_of = [s.motion.joint_names.index(name) for name in film.robot.joint_names]
        out.append(evaluate(s.motion.spline, _times(film, k), order)[:, order_of])
    return np.concatenate(out)


def _colour(i: int) -> str:
    return COLOURS[i % len(COLOURS)]


def _x(film: Film, t: Array) -> Array:
    return np.asarray(WIDTH * t / film.length_s)


def _path(x: Array, y: Array) -> str:
    """A polyline as SVG; points that lie in the middle of a level stretch are left out."""
    keep = np.ones(len(x), bool)
    keep[1:-1] = (np.abs(np.diff(y))[:-1] > 0.05) | (np.abs(np.diff(y))[1:] > 0.05)
    return "M" + " L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x[keep], np.clip(y, 0, HEIGHT)[keep]))


def _guide(y: float) -> str:
    return f'<path d="M0 {y:.1f} H{WIDTH}" class="guide"/>'


def _row(name: str, words: str, top: str, bottom: str, inside: str) -> str:
    return (
        f'<div class="plot"><span class="name"><b>{name}</b><span><br>{words}</span></span>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" role="img" aria-label="{name} over time">{inside}</svg>'
        f'<span class="ends"><em>{top}</em><em>{bottom}</em></span></div>'
    )
