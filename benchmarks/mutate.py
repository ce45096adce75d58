"""Mutation testing of the planner's heart: how many small changes of the code do its tests notice?

    python benchmarks/mutate.py                                     every mutant of every module
    python benchmarks/mutate.py planning/retrieval.py --sample 50 --seed 1
    python benchmarks/mutate.py --list planning/metrics.py

A mutant is the module with one expression or statement changed: a comparison turned or moved to its boundary, + for −, a number that is
larger by one, `min` for `max`, a statement left out, and so on (`mutation/mutants.py`). Docstrings, annotations and decorators are left as
they are. It is killed when one of its group's tests (`GROUPS`) fails, crashes, or takes ten times as long as it does on the code itself
(`mutation/trials.py`).

Mutants that can't be told from the code by any test stand in `mutate_equivalent.toml`, each with the reason; an entry goes by the text of
its line, not by its number. The script exits with 1 when a mutant survives that is not listed there, when a listed one is killed or does
not exist any more, or when fewer than 95 % are killed, the listed ones counted as survivors.

Results are kept in --results. A mutant that was killed is not asked again while the function that it changes and the test that killed it
stay as they are; one that survived, while that function and all the group's tests do. Remove the file after changes elsewhere.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import os
import pickle
import random
import sys
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mutation.mutants import HOME, Mutant, mutants, unchanged
from mutation.trials import Outcome, Seen, ask_from_start, ask_quickly, choose, outermost_changes, preload

EQUIVALENT = Path(__file__).with_name("mutate_equivalent.toml")
LEAST_KILLED = 0.95

Key = tuple[str, str, str, int]


@dataclass(frozen=True)
class Group:
    """Modules, and the tests that concern them; they alone decide whether the modules' mutants live."""

    modules: tuple[str, ...]
    tests: tuple[str, ...]


def _in(folder: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{folder}/{name}.py" for name in names)


VERDICT = {
    "contact": "contact_by_hand start", "course": "course", "cup": "cup", "figures": "figures", "fingers": "fingers",
    "grasp": "grasp_by_hand grasp", "gripper": "gripper", "hand": "hand", "judge": "judge_by_hand", "ledger": "ledger",
    "limits": "verdict_limits", "pads": "pads_by_hand parts_over_a_pad", "pairs": "pairs",
    "polygons": "polygons", "polyhedra": "polyhedra standing", "standing": "standing judge_by_hand", "start": "start", "sweep": "sweep",
    "__init__": "judge_by_hand",
    "faults": "figures gripper ledger judge_by_hand pads_by_hand cup contact_by_hand standing",
}  # fmt: skip
"""The verdict's modules, each with its own tests: none needs all of them, and the fewer are loaded, the sooner a mutant is asked."""
GROUPS = (
    Group(
        _in("planning/policies", "search", "lookahead", "hopeless", "neural", "regions", "unsolvable", "rrt", "local", "random", "__init__")
        + _in("planning", "relaxed_plan", "retrieval", "conclusion", "episodes", "metrics"),
        ("tests/planning/policies", *_in("tests/planning", "test_relaxed_plan", "test_retrieval", "test_episodes", "test_metrics")),
    ),
    Group(
        _in(
            "planning/grasping",
            "finger_grasps",
            "candidates",
            "antipodal",
            "mesh_grasps",
            "many_lines",
            "hand_poses",
            "line_contacts",
            "pads",
            "sampling",
            "cup_grasps",
        ),
        ("tests/planning/grasping",),
    ),
    *(
        Group(_in("planning/verdict", module), _in("tests/planning/verdict", *(f"test_{name}" for name in tests.split())))
        for module, tests in VERDICT.items()
    ),
    Group(("kinematics/robots/plain_urdf.py",), ("tests/kinematics/robots/test_plain_urdf.py",)),
    Group(("planning/motion/checking/verify.py",), ("tests/planning/motion/checking/test_verify_rules.py",)),
    Group(
        _in("planning/motion/handling", "neighbourhoods", "shrunk_scene"),
        _in("tests/planning/motion/handling", "test_neighbourhoods", "test_shrunk_scene"),
    ),
    Group(("planning/motion/cell/supports.py",), ("tests/planning/motion/cell/test_supports.py",)),
)
MODULES = {module: group for group in GROUPS for module in group.modules}


@dataclass(frozen=True)
class Equivalent:
    """A mutant that no test can tell from the code, and why."""

    module: str
    line: str
    change: str
    nth: int
    why: str

    @property
    def key(self) -> tuple[str, str, str, int]:
        return self.module, self.line, self.change, self.nth


def read_equivalent(file: Path = EQUIVALENT) -> list[Equivalent]:
    """The listed survivors. Raises ValueError for an entry without a reason."""
    found = []
    for module, entries in tomllib.loads(file.read_text()).items():
        for e in entries:
            if not str(e.get("why", "")).strip():
                raise ValueError(
                    f"{file.name}: {module}: {e.get('change')}: `why` is missing; say why no test can tell this mutant from the code"
                )
            found.append(Equivalent(module, e["line"], e["change"], int(e.get("nth", 1)), e["why"]))
    return found


class Results:
    """What is known of mutants, kept in a file; each outcome is added as soon as it is there."""

    def __init__(self, file: Path) -> None:
        self.file = file
        file.parent.mkdir(parents=True, exist_ok=True)

    def read(self, group: Group, asked: Sequence[Mutant]) -> dict[Key, Outcome]:
        """The outcomes of some mutants that hold still: what they change is the same, and the test that killed, or all where none did."""
        found, mutants_by = dict[Key, Outcome](), {m.key: m for m in asked}
        for line in self.file.read_text().splitlines() if self.file.is_file() else ():
            r = json.loads(line)
            mutant = mutants_by.get((r["module"], r["line"], r["change"], r["nth"]))
            if mutant is not None and r["hash"] == _hash(group, mutant, r["by"]):
                found[mutant.key] = Outcome(r["how"], r["by"], r["seconds"])
        return found

    def add(self, group: Group, mutant: Mutant, outcome: Outcome) -> None:
        what = {"module": mutant.module, "line": mutant.line, "change": mutant.change, "nth": mutant.nth}
        fate = {"how": outcome.how, "by": outcome.by, "seconds": round(outcome.seconds, 2)}
        with self.file.open("a") as out:
            out.write(json.dumps({**what, **fate, "hash": _hash(group, mutant, outcome.by)}, ensure_ascii=False) + "\n")


def _hash(group: Group, mutant: Mutant, by: str) -> str:
    """A hash of the function, class or statement that a mutant changes, and of the test `by`, or of all the group's tests."""
    changed = next((text for first, last, _, text in _statements(HOME / mutant.module) if first <= mutant.number <= last), "")
    if by:
        file, _, test = by.partition("::")
        tests = "".join(text for _, _, name, text in _statements(HOME / file) if name == test.partition("[")[0])
    else:
        tests = _text_of(group.tests)
    return hashlib.sha256((changed + tests).encode()).hexdigest()[:16]


@cache
def _statements(file: Path) -> list[tuple[int, int, str, str]]:
    """The first and last line of a file's outermost statements, the name of what they define, if they do, and their text."""
    lines = file.read_text().splitlines() if file.is_file() else []
    found = []
    for node in ast.parse("\n".join(lines)).body:
        first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", ()))])
        last = node.end_lineno or first
        found.append((first, last, str(getattr(node, "name", "")), "\n".join(lines[first - 1 : last])))
    return found


@cache
def _text_of(tests: tuple[str, ...]) -> str:
    files = [f for t in tests for f in ([HOME / t] if t.endswith(".py") else sorted((HOME / t).rglob("*.py")))]
    return "".join(f.read_text() for f in files)


def examine(group: Group, chosen: Sequence[Mutant], results: Results, *, quickly: bool = False) -> dict[Key, Outcome]:
    """What became of the chosen mutants of a group. quickly: of those that can be asked in forks; none is asked from the start.

    Raises: ValueError when a test fails on the code as it is.
    """
    known = results.read(group, chosen)

    def note(mutant: Mutant, outcome: Outcome) -> None:
        known[mutant.key] = outcome
        results.add(group, mutant, outcome)

    asked = [m for m in chosen if m.key not in known]
    if not asked:
        return known
    preload(group.modules[0].split("/")[0], group.tests)
    seen, left = list[Seen](), {m.key: m for m in asked}
    for told in _from_process(lambda tell: ask_quickly(group.modules, group.tests, asked, tell)):
        if isinstance(told, list):
            seen = told
            print(f"{len(seen)} tests, {sum(s.whole_s for s in seen):.0f} s of processor time; {len(asked)} mutants", file=sys.stderr)
        elif told[1].how != "survived":
            note(left.pop(told[0]), told[1])
        elif quickly:
            known[told[0]] = told[1]
    if quickly:
        return known
    whole = {m: unchanged(m) for m in group.modules}
    print(f"{len(left)} mutants are left to be asked from the start", file=sys.stderr)
    for m in left.values():
        note(m, ask_from_start(m, choose(seen, m, outermost_changes(whole[m.module], m.code))))
    return known


def _from_process(work: Callable[[Callable[[object], None]], None]) -> Iterator[list[Seen] | tuple[Key, Outcome]]:
    """What `work` tells, called in a process of its own. Raises ValueError with the text of the one that it ends with."""
    listen, say = os.pipe()
    child = os.fork()
    if child == 0:
        with os.fdopen(say, "wb", buffering=0) as out:
            try:
                work(lambda told: out.write(pickle.dumps(told)) and None)
            except ValueError as e:
                out.write(pickle.dumps(e))
            finally:
                os._exit(0)
    os.close(say)
    try:
        with os.fdopen(listen, "rb") as told:
            while told.peek(1):
                if isinstance(word := pickle.load(told), ValueError):
                    raise word
                yield word
    finally:
        os.waitpid(child, 0)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("modules", nargs="*", default=list(MODULES), help="by default all of those that `GROUPS` names")
    parser.add_argument("--sample", type=int, help="so many mutants of each module, drawn with --seed, instead of all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--results", type=Path, default=Path("out/mutants.jsonl"), help="where results are kept; what is there is not run again"
    )
    parser.add_argument("--tests", action="append", help="ask these alone, quickly: less is loaded, so a mutant takes a fifth of the time")
    parser.add_argument("--quickly", action="store_true", help="ask in forks only, which counts some as survivors that are none")
    parser.add_argument("--list", action="store_true", help="print the mutants and run nothing")
    asked = parser.parse_args(argv)
    if unknown := [m for m in asked.modules if m not in MODULES]:
        parser.error(f"no tests are named for {unknown[0]}: add it to GROUPS; there are {', '.join(MODULES)}")
    return asked


def main(argv: Sequence[str] | None = None) -> int:
    asked = _arguments(argv)
    listed: dict[str, list[Equivalent]] = defaultdict(list)
    for e in read_equivalent():
        listed[e.module].append(e)
    wrong, all_killed, all_tried, results = list[str](), 0, 0, Results(asked.results)
    quickly = asked.quickly or asked.tests is not None
    if not asked.list:
        print("| module | mutants | tried | killed | listed | unlisted | killed of tried | s a mutant |\n|---|--:|--:|--:|--:|--:|--:|--:|")
    for group in GROUPS:
        every = {module: mutants(module) for module in group.modules if module in asked.modules}
        if asked.list:
            for m in (m for of_module in every.values() for m in of_module):
                print(f"{m.module}:{m.number}: {m.line}\n    {m.change}" + f" ({m.nth})" * (m.nth > 1))
            continue
        group = group if asked.tests is None else Group(tuple(every), tuple(asked.tests))
        drawn = {module: _draw(of_module, asked.sample, asked.seed) for module, of_module in every.items()}
        try:
            outcomes = examine(group, [m for of_module in drawn.values() for m in of_module], results, quickly=quickly) if drawn else {}
        except ValueError as e:
            print(e, file=sys.stderr)
            return 2
        for module, of_module in drawn.items():
            tried = [m for m in of_module if m.key in outcomes]
            with_reason = {e.key for e in listed[module]}
            alive = {m.key for m in tried if outcomes[m.key].how == "survived"}
            killed, mean_s = len(tried) - len(alive), sum(outcomes[m.key].seconds for m in tried) / max(1, len(tried))
            all_killed, all_tried = all_killed + killed, all_tried + len(tried)
            wrong += _find_wrong(every[module], tried, outcomes, with_reason)
            print(f"| {module} | {len(every[module])} | {len(tried)} | {killed} | {len(alive & with_reason)} "
                  f"| {len(alive - with_reason)} | {killed / max(1, len(tried)):.1%} | {mean_s:.2f} |", flush=True)  # fmt: skip
    if asked.list:
        return 0
    share = all_killed / max(1, all_tried)
    print(f"| all | | {all_tried} | {all_killed} | | | {share:.1%} | |")
    print(*wrong, sep="\n")
    return int(bool(wrong) or share < LEAST_KILLED)


def _draw(every: Sequence[Mutant], most: int | None, seed: int) -> list[Mutant]:
    return list(every) if most is None else sorted(random.Random(seed).sample(every, min(most, len(every))), key=lambda m: m.number)


def _find_wrong(every: Sequence[Mutant], tried: Sequence[Mutant], outcomes: dict[Key, Outcome], with_reason: set[Key]) -> list[str]:
    """What is not as it should be with a module's mutants, a sentence each."""
    found = [
        f"{m.module}: survives: {m.number}: {m.line}   [{m.change}] ({m.nth})"
        for m in tried
        if outcomes[m.key].how == "survived" and m.key not in with_reason
    ]
    found += [
        f"{m.module}: listed as equivalent, but killed by {outcomes[m.key].by or outcomes[m.key].how}: {m.line}   [{m.change}] ({m.nth})"
        for m in tried
        if outcomes[m.key].how != "survived" and m.key in with_reason
    ]
    gone = with_reason - {m.key for m in every}
    return found + [
        f"{module}: listed, but there is no such mutant: {line}   [{change}] ({nth})" for module, line, change, nth in sorted(gone)
    ]


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if "PYTHONHASHSEED" not in os.environ:  # sets have the same order in every run
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, "PYTHONHASHSEED": "0"})
    sys.exit(main())
