"""Mutation testing of the planner's heart: how many small changes of the code do its tests notice?

    python benchmarks/mutate.py                                     every mutant of every module
    python benchmarks/mutate.py planning/retrieval.py --sample 50 --seed 1
    python benchmarks/mutate.py --list planning/metrics.py

A mutant is the module with one expression or statement changed: a comparison turned or moved to its boundary, + for −, a number that is
larger by one, `min` for `max`, a statement left out, and so on (`OPERATORS`). It is killed when one of the module's tests (`TESTS`) fails,
crashes, or takes ten times as long as it does on the code itself. Docstrings, type annotations and decorators are left as they are.

Mutants that can't be told from the code by any test stand in `mutate_equivalent.toml`, each with the reason; an entry goes by the text of
its line, not by its number. The script exits with 1 when a mutant survives that is not listed there, when a listed one is killed or does
not exist any more, or when fewer than 95 % are killed, the listed ones counted as survivors.

Each mutant runs in a process of its own that is forked from one in which numpy, numba and the packages below the module are loaded already.
Results are kept in --results and are not asked for again while the module, its tests and the packages stay as they are.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import marshal
import os
import random
import resource
import select
import signal
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.abc import InspectLoader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from time import perf_counter
from types import CodeType, ModuleType

HOME = Path(__file__).resolve().parent.parent
EQUIVALENT = Path(__file__).with_name("mutate_equivalent.toml")
PACKAGES = ("kinematics", "perception", "planning", "retrieve_cli")
LEAST_KILLED = 0.95

TESTS = {
    "planning/retrieval.py": ("tests/planning/test_retrieval.py",),
    "planning/metrics.py": ("tests/planning/test_metrics.py",),
    "planning/grasping/finger_grasps.py": ("tests/planning/grasping/test_finger_grasps.py",),
    "planning/grasping/hand_poses.py": ("tests/planning/grasping/test_hand_poses.py", "tests/planning/grasping/test_finger_grasps.py"),
    "planning/grasping/line_contacts.py": ("tests/planning/grasping/test_finger_grasps.py",),
    "planning/grasping/pads.py": ("tests/planning/grasping/test_pad_size.py", "tests/planning/grasping/test_finger_grasps.py"),
    "planning/grasping/sampling.py": ("tests/planning/grasping/test_sampling.py", "tests/planning/grasping/test_finger_grasps.py"),
    "planning/motion/verify.py": ("tests/planning/motion/test_verify_rules.py",),
    "planning/policies/__init__.py": ("tests/planning/policies/test_by_name.py",),
    "planning/policies/lookahead.py": ("tests/planning/policies/test_lookahead.py",),
    "planning/relaxed_plan.py": ("tests/planning/test_relaxed_plan.py", "tests/planning/policies/test_lookahead.py"),
    "planning/policies/search.py": ("tests/planning/policies/test_lookahead.py",),
    "planning/policies/unsolvable.py": ("tests/planning/policies/test_unsolvable.py",),
    "planning/policies/rrt.py": ("tests/planning/policies/test_rrt.py",),
    "planning/policies/neural.py": ("tests/planning/policies/test_neural.py",),
    "planning/policies/random.py": ("tests/planning/policies/test_random.py",),
    "planning/policies/local.py": ("tests/planning/policies/test_local.py",),
    "planning/policies/regions.py": ("tests/planning/policies/test_regions.py",),
}
"""For every module the tests that concern it; they alone decide whether its mutants live."""


# ---------------------------------------------------------------------------------------------------------------------------------- mutants

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
OPPOSITES = {
    a: b
    for pair in (
        ("min", "max"), ("any", "all"), ("ceil", "floor"), ("argmin", "argmax"), ("sin", "cos"), ("minimum", "maximum"), ("ones", "zeros"),
    )
    for a, b in (pair, pair[::-1])
}  # fmt: skip
RANKINGS = ("sorted", "argsort", "permutation")
"""Functions whose result a mutant turns round."""
PASS_THROUGH = ("abs", "sorted", "sqrt", "inverse", "round", "reversed", "norm", "permutation")
"""Functions that a mutant leaves out, so that their argument stands alone."""
OPTIONS = ("key", "default", "axis", "reverse", "kind")
"""Keywords that a mutant leaves out."""
UNTOUCHED = ("decorator_list", "annotation", "returns", "type_params")
"""Fields of the syntax tree in which nothing is changed."""


def _compare(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            for other in COMPARISONS[type(op)]:
                yield ast.Compare(node.left, [*node.ops[:i], other(), *node.ops[i + 1 :]], node.comparators)


def _calculate(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        yield ast.BinOp(node.right, node.op, node.left)
    if isinstance(node, (ast.BinOp, ast.AugAssign)) and (other := ARITHMETIC.get(type(node.op))):
        yield ast.BinOp(node.left, other(), node.right) if isinstance(node, ast.BinOp) else ast.AugAssign(node.target, other(), node.value)
    if isinstance(node, ast.UnaryOp) and not (isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant)):
        yield node.operand


def _decide(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        for i in range(len(node.values)):
            rest = node.values[:i] + node.values[i + 1 :]
            yield ast.BoolOp(node.op, rest) if len(rest) > 1 else rest[0]
    if isinstance(node, (ast.If, ast.While, ast.IfExp)) and not isinstance(node.test, (ast.Compare, ast.Constant, ast.UnaryOp)):
        turned = ast.UnaryOp(ast.Not(), node.test)
        yield ast.IfExp(turned, node.body, node.orelse) if isinstance(node, ast.IfExp) else type(node)(turned, node.body, node.orelse)
    if isinstance(node, ast.comprehension):
        for i, test in enumerate(node.ifs):
            if not isinstance(test, (ast.Compare, ast.UnaryOp)):
                ifs = [*node.ifs[:i], ast.UnaryOp(ast.Not(), test), *node.ifs[i + 1 :]]
                yield ast.comprehension(node.target, node.iter, ifs, node.is_async)


def _write_other(node: ast.AST) -> Iterator[ast.AST]:
    """Another number, truth value or text."""
    if isinstance(node, ast.Constant):
        match node.value:
            case bool():
                yield ast.Constant(not node.value)
            case int():
                yield ast.Constant(node.value + 1)
            case float():
                yield ast.Constant(2 * node.value if node.value else 1.0)
            case str():
                yield ast.Constant(node.value + "XX")


def _call_other(node: ast.AST) -> Iterator[ast.AST]:
    if not isinstance(node, ast.Call):
        return
    name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr if isinstance(node.func, ast.Attribute) else ""
    if name in OPPOSITES:
        named = ast.Name(OPPOSITES[name], ast.Load())
        called = named if isinstance(node.func, ast.Name) else ast.Attribute(node.func.value, OPPOSITES[name], ast.Load())  # type: ignore[attr-defined]
        yield ast.Call(called, node.args, node.keywords)
    if name in PASS_THROUGH and node.args:
        yield node.args[0]
    if name in RANKINGS and not any(k.arg == "reverse" for k in node.keywords):
        yield ast.Subscript(node, ast.Slice(None, None, ast.UnaryOp(ast.USub(), ast.Constant(1))), ast.Load())
    for keyword in node.keywords:
        if keyword.arg in OPTIONS:
            yield ast.Call(node.func, node.args, [k for k in node.keywords if k is not keyword])


def _leave_out(node: ast.AST) -> Iterator[ast.AST]:
    """A statement that does something, and what a function returns."""
    if isinstance(node, (ast.AugAssign, ast.Raise, ast.Expr)) and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        yield ast.Pass()
    if isinstance(node, ast.Break):
        yield ast.Continue()
    if isinstance(node, ast.Continue):
        yield ast.Break()
    if isinstance(node, ast.Return) and node.value is not None and not _is_none(node.value):
        yield ast.Return(ast.Constant(None))


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


OPERATORS: tuple[Callable[[ast.AST], Iterator[ast.AST]], ...] = (_compare, _calculate, _decide, _write_other, _call_other, _leave_out)


@dataclass(frozen=True)
class Mutant:
    """One change to a module: the text of its line, the expression before and after, and which of those that read alike it is."""

    module: str
    line: str
    change: str
    nth: int
    number: int
    code: CodeType

    @property
    def key(self) -> tuple[str, str, str, int]:
        return self.module, self.line, self.change, self.nth


def mutants(module: str) -> list[Mutant]:
    """All mutants of a module, in its order; those that compile to the same code as another one, or as the module, are left out."""
    text = (HOME / module).read_text()
    tree, lines = ast.parse(text), text.splitlines()
    codes, alike, found = {marshal.dumps(compile(tree, module, "exec"))}, Counter[tuple[str, str]](), list[Mutant]()
    for put, node, line_number in _places(tree):
        for other in (new for operator in OPERATORS for new in operator(node)):
            change = f"{_words(node)} → {_words(other)}"
            put(ast.fix_missing_locations(ast.copy_location(other, node)))
            code = compile(tree, str(HOME / module), "exec")
            put(node)
            if (dumped := marshal.dumps(code)) not in codes:
                codes.add(dumped)
                line = lines[line_number - 1].strip()
                alike[line, change] += 1
                found.append(Mutant(module, line, change, alike[line, change], line_number, code))
    return found


def _places(node: ast.AST, line: int = 0) -> Iterator[tuple[Callable[[ast.AST], None], ast.AST, int]]:
    """Every node below one, the line that it stands on, and how to put another in its place."""
    line = getattr(node, "lineno", line)
    for field, value in ast.iter_fields(node):
        if field in UNTOUCHED:
            continue
        if isinstance(value, ast.AST):
            yield lambda new, field=field: setattr(node, field, new), value, getattr(value, "lineno", line)  # type: ignore[misc]
            yield from _places(value, line)
        elif isinstance(value, list):
            for i, item in enumerate(value):
                if isinstance(item, ast.AST) and not _is_docstring(item):
                    yield lambda new, value=value, i=i: value.__setitem__(i, new), item, getattr(item, "lineno", line)  # type: ignore[misc]
                    yield from _places(item, line)


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _words(node: ast.AST) -> str:
    """An expression or statement as it is written, its body left out."""
    match node:
        case ast.If() | ast.While():
            return f"{type(node).__name__.lower()} {ast.unparse(node.test)}"
        case ast.comprehension():
            return ast.unparse(node).strip()
        case ast.Constant(value=str()):
            return repr(node.value)
    return " ".join(ast.unparse(node).split())


# ---------------------------------------------------------------------------------------------------------------------------------- running


QUICKLY = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--assert=plain")


@dataclass(frozen=True)
class Outcome:
    """What became of one run of the tests. how: "survived", "killed", "timeout" or "crash"; by: the first test that failed."""

    how: str
    by: str
    seconds: float


class _Replaced(MetaPathFinder, InspectLoader):
    """Imports one module from code at hand instead of from its file."""

    def __init__(self, name: str, file: str, code: CodeType) -> None:
        self.name, self.file, self.code = name, file, code

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname != self.name:
            return None
        package = self.file.endswith("__init__.py")
        spec = ModuleSpec(fullname, self, origin=self.file, is_package=package)
        spec.has_location = True
        if package:
            spec.submodule_search_locations = [str(Path(self.file).parent)]
        return spec

    def get_code(self, fullname: str) -> CodeType:
        return self.code

    def get_source(self, fullname: str) -> None:
        return None


class _FirstFailure:
    """A plugin of pytest that remembers which test failed first."""

    def __init__(self) -> None:
        self.name = ""

    def pytest_runtest_logreport(self, report: object) -> None:
        if getattr(report, "failed", False) and not self.name:
            self.name = str(getattr(report, "nodeid", ""))

    def pytest_collectreport(self, report: object) -> None:
        self.pytest_runtest_logreport(report)


def _in_child(module: str, code: CodeType | None, say: int) -> int:
    """Run a module's tests, the module replaced by code where that is given; pytest's exit code. Writes the first failure to `say`."""
    import pytest

    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (8 << 30, 8 << 30))
    if code is not None:
        sys.meta_path.insert(0, _Replaced(_name(module), str(HOME / module), code))
    first = _FirstFailure()
    ended = pytest.main([*QUICKLY, *(str(HOME / t) for t in TESTS[module])], [first])
    os.write(say, first.name.encode()[:4000])
    return int(ended)


def run(module: str, code: CodeType | None, limit_s: float) -> Outcome:
    """The module's tests in a process of its own."""
    began = perf_counter()
    listen, say = os.pipe()
    child = os.fork()
    if child == 0:
        ended = 70
        try:
            ended = _in_child(module, code, say)
        finally:
            os._exit(ended)
    os.close(say)
    try:
        heard, _, _ = select.select([listen], [], [], limit_s)
        by = os.read(listen, 4096).decode() if heard else ""
        if not heard:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    finally:
        os.close(listen)
    seconds = perf_counter() - began
    if not heard:
        return Outcome("timeout", "", seconds)
    if os.WIFSIGNALED(status):
        return Outcome("crash", by, seconds)
    ended = os.WEXITSTATUS(status)
    return Outcome({0: "survived", 1: "killed", 2: "killed"}.get(ended, "crash"), by, seconds)


def _name(module: str) -> str:
    return module.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def preload(module: str) -> None:
    """Import all that the module's tests need and that does not rest on the module's own package, so that children find it loaded."""
    import pytest  # noqa: F401

    above = PACKAGES[PACKAGES.index(module.split("/")[0]) :]
    ask = "import sys, pytest; pytest.main(['--collect-only', *sys.argv[1:]]); print('MODULES', *sys.modules)"
    told = subprocess.run(
        [sys.executable, "-c", ask, *QUICKLY, *TESTS[module]], cwd=HOME, capture_output=True, text=True, check=True
    ).stdout
    wanted = next(line for line in told.splitlines() if line.startswith("MODULES")).split()[1:]
    for name in wanted:
        top = name.split(".")[0]
        if top not in above and not top.startswith(("test_", "conftest", "_pytest", "__")) and (top in PACKAGES or top in THIRD_PARTY):
            import_module(name)


THIRD_PARTY = ("numpy", "scipy", "numba", "llvmlite", "fcl", "lxml", "trimesh", "hypothesis", "torch", "safetensors", "yourdfpy")


# ----------------------------------------------------------------------------------------------------------------------------------- report


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


def _fingerprint(module: str) -> str:
    """A hash of all that a mutant's fate hangs on: the packages' sources, and the module's tests with what they share."""
    files = [f for package in PACKAGES for f in sorted((HOME / package).rglob("*.py"))]
    files += [HOME / t for t in TESTS[module]] + sorted((HOME / "tests").glob("*.py")) + [Path(__file__)]
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:16]


def _known(results: Path, fingerprint: str) -> dict[tuple[str, str, str, int], Outcome]:
    found = {}
    for line in results.read_text().splitlines() if results.is_file() else ():
        r = json.loads(line)
        if r["fingerprint"] == fingerprint:
            found[r["module"], r["line"], r["change"], r["nth"]] = Outcome(r["how"], r["by"], r["seconds"])
    return found


def examine(module: str, chosen: Sequence[Mutant], results: Path) -> tuple[float, dict[tuple[str, str, str, int], Outcome]]:
    """How long the tests take on the module itself, in seconds, and what became of the chosen mutants.

    Raises: ValueError when the tests fail on the module itself, or when somebody edits the sources meanwhile.
    """
    fingerprint = _fingerprint(module)
    preload(module)
    plain = [run(module, None, 600.0) for _ in range(2)]  # the first may fill caches
    if any(p.how != "survived" for p in plain):
        raise ValueError(f"{module}: its own tests fail: {plain[0].how} {plain[0].by}; mend them first")
    limit_s = 10 * plain[1].seconds + 5
    known = _known(results, fingerprint)
    for i, m in enumerate(chosen):
        if m.key in known:
            continue
        outcome = known[m.key] = run(module, m.code, limit_s)
        if _fingerprint(module) != fingerprint:
            raise ValueError(
                f"{module}: its sources or tests were changed while its mutants ran; start again, what was found before is kept"
            )
        with results.open("a") as file:
            record = {"module": m.module, "line": m.line, "change": m.change, "nth": m.nth, "how": outcome.how, "by": outcome.by}
            file.write(json.dumps({**record, "seconds": round(outcome.seconds, 2), "fingerprint": fingerprint}, ensure_ascii=False) + "\n")
        if sys.stderr.isatty() or i % 50 == 0:
            print(f"{module}: {i + 1} of {len(chosen)}", end="\r" if sys.stderr.isatty() else "\n", file=sys.stderr)
    return plain[1].seconds, {m.key: known[m.key] for m in chosen}


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("modules", nargs="*", default=list(TESTS), help="by default all of those that `TESTS` names")
    parser.add_argument("--sample", type=int, help="so many mutants of each module, drawn with --seed, instead of all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--results", type=Path, default=Path("out/mutants.jsonl"), help="where results are kept; what is there is not run again"
    )
    parser.add_argument("--list", action="store_true", help="print the mutants and run nothing")
    asked = parser.parse_args(argv)
    unknown = [m for m in asked.modules if m not in TESTS]
    if unknown:
        parser.error(f"no tests are named for {unknown[0]}: add it to TESTS; there are {', '.join(TESTS)}")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    asked.results.parent.mkdir(parents=True, exist_ok=True)
    listed: dict[str, list[Equivalent]] = defaultdict(list)
    for e in read_equivalent():
        listed[e.module].append(e)
    wrong, all_killed, all_tried, all_seconds = list[str](), 0, 0, 0.0
    if not asked.list:
        print(f"{'module':32s} mutants  tried  killed  listed  unlisted  share  tests_s  mutant_s")
    for module in asked.modules:
        every = mutants(module)
        if asked.list:
            print(*(f"{m.module}:{m.number}: {m.line}\n    {m.change}" + f" ({m.nth})" * (m.nth > 1) for m in every), sep="\n")
            continue
        rng = random.Random(asked.seed)
        chosen = every if asked.sample is None else sorted(rng.sample(every, min(asked.sample, len(every))), key=lambda m: m.number)
        with_reason = {e.key for e in listed[module]}
        try:
            seconds, outcomes = examine(module, chosen, asked.results)
        except ValueError as e:
            parser.exit(2, f"{e}\n")
        alive = {key for key, o in outcomes.items() if o.how == "survived"}
        killed, mean_s = len(outcomes) - len(alive), sum(o.seconds for o in outcomes.values()) / max(1, len(outcomes))
        all_killed, all_tried, all_seconds = all_killed + killed, all_tried + len(outcomes), all_seconds + seconds
        wrong += [f"{module}: survives: {m.number}: {m.line}   [{m.change}] ({m.nth})" for m in chosen if m.key in alive - with_reason]
        wrong += [f"{module}: listed as equivalent, but killed by {outcomes[key].by or outcomes[key].how}: {key[1]}   [{key[2]}] ({key[3]})"
                  for key in with_reason & (outcomes.keys() - alive)]  # fmt: skip
        wrong += [
            f"{module}: listed, but there is no such mutant: {key[1]}   [{key[2]}] ({key[3]})"
            for key in with_reason - {m.key for m in every}
        ]
        print(f"{module:32s} {len(every):7d}  {len(chosen):5d}  {killed:6d}  {len(alive & with_reason):6d}  {len(alive - with_reason):8d}  "
              f"{killed / max(1, len(outcomes)):5.1%}  {seconds:7.1f}  {mean_s:8.2f}", flush=True)  # fmt: skip
    if asked.list:
        return 0
    share = all_killed / max(1, all_tried)
    print(f"{'all':32s}          {all_tried:5d}  {all_killed:6d}                    {share:5.1%}  {all_seconds:7.1f}")
    print(*wrong, sep="\n")
    return int(bool(wrong) or share < LEAST_KILLED)


if __name__ == "__main__":
    sys.exit(main())
