"""How long a scene takes from its line in a file to the verified plan, and where the time goes, stage by stage.

    retrieve gen -n 40 --seed 777001 -o scenes.jsonl
    python benchmarks/whole_time.py scenes.jsonl [--policy neural] [--rounds 3]

Every scene is planned once before anything is counted, so that nothing is compiled or read meanwhile. Milliseconds of processor time, so
that a busy machine does not count; over the scenes, of each scene's median over the rounds. `motions` is what the other stages leave of the
loop: picks, RRT-Connect, shortcuts; `rest` is packing the scene and putting the plan together. `first` is what the second half of
the scenes took when they were planned for the first time: covers of shapes, and fingers as far open as these ask, were made then.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")  # before numpy is imported

import numpy as np

import planning.conclusion as conclusion
import planning.retrieval as retrieval
from planning.io.files import read_scene_lines
from planning.motion.pick_place import Motions
from planning.plan import Plan
from retrieve_cli.plan_job import Job
from retrieve_cli.plan_line import plan_scene

STAGES = ("choosing", "motions", "quickest", "trajectories", "verify", "verdict", "clearance", "travel", "rest")


class Clock:
    """Processor time by stage; what one stage spends inside another counts for the inner one alone."""

    def __init__(self) -> None:
        self.ms, self._open = dict.fromkeys(STAGES, 0.0), ["rest"]
        self._last = time.process_time()

    def switch(self, stage: str | None) -> None:
        """From now on it is this stage's time; None: that of the stage around the one that ends."""
        now = time.process_time()
        self.ms[self._open[-1]] += 1e3 * (now - self._last)
        self._last = now
        self._open.append(stage) if stage is not None else self._open.pop()

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its time counted for a stage."""

        def call(*args: Any, **kws: Any) -> Any:
            self.switch(stage)
            try:
                return function(*args, **kws)
            finally:
                self.switch(None)

        return call


def watch(clock: Clock) -> None:
    """Have the loop's parts tell the clock."""
    for owner, name, stage in (
        (conclusion, "replayed", "verify"),
        (conclusion, "first_touch", "verify"),
        (conclusion, "examine", "verdict"),
        (conclusion, "with_clearances", "clearance"),
        (conclusion, "hand_travels", "travel"),
        (Motions, "quickest", "quickest"),
        (Motions, "trajectories", "trajectories"),
        (Motions, "retrieve_target", "motions"),
        (Motions, "relocate", "motions"),
    ):
        setattr(owner, name, clock.timed(stage, getattr(owner, name)))
    thinking = retrieval.Stopwatch
    begin, end = thinking.__enter__, thinking.__exit__

    class Watched(thinking):  # type: ignore[misc,valid-type]
        """The loop has two: the first that it makes is for choosing."""

        made = 0

        def __init__(self) -> None:
            super().__init__()
            self.stage = ("choosing", "motions")[Watched.made % 2]
            Watched.made += 1

        def __enter__(self) -> None:
            clock.switch(self.stage)
            begin(self)

        def __exit__(self, *how: object) -> None:
            end(self, *how)
            clock.switch(None)

    retrieval.Stopwatch = Watched  # type: ignore[misc]


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    arguments.add_argument("scenes", type=Path)
    arguments.add_argument("--policy", default="neural")
    arguments.add_argument("--rounds", type=int, default=3)
    asked = arguments.parse_args()
    lines = [line for line in read_scene_lines(asked.scenes) if line.scene is not None]
    job = Job(asked.policy, "deep", 0, None, None, 5)
    plans, at_first = list[Plan](), np.empty(len(lines))
    for i, line in enumerate(lines):
        assert line.scene is not None
        began = time.process_time()
        plans.append(plan_scene(job, line.where, line.scene))
        at_first[i] = 1e3 * (time.process_time() - began)
    spent = np.empty((asked.rounds, len(lines), len(STAGES)))
    clock = Clock()
    watch(clock)
    for spent_now in spent:
        for i, line in enumerate(lines):
            assert line.scene is not None
            clock.__init__()  # type: ignore[misc]
            plan_scene(job, line.where, line.scene)
            clock.switch("rest")
            spent_now[i] = [clock.ms[stage] for stage in STAGES]
    each = np.median(spent, axis=0)
    table = np.column_stack([each, np.median(spent.sum(2), axis=0)])
    solved, verified = (np.mean([bool(x) for x in of]) for of in ([p.success for p in plans], [p.verified for p in plans]))
    print(f"{len(plans)} scenes, policy {asked.policy}: {100 * solved:.1f} % solved, {100 * verified:.1f} % verified")
    print(f"{'ms of processor time':22s}{'median':>9s}{'mean':>9s}{'p90':>9s}")
    for name, column in (*zip((*STAGES, "whole"), table.T), ("first", at_first[len(lines) // 2 :])):
        print(f"{name:22s}{np.median(column):9.1f}{column.mean():9.1f}{np.percentile(column, 90):9.1f}")


if __name__ == "__main__":
    main()
