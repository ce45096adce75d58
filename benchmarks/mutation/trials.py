"""Runs mutants, each in a process of its own: quickly, as a fork of a session of pytest that stands ready, or from the start, as a check.

*Quickly*: a session collects the tests and runs them once on the code as it is, noting which test enters which function and which lines.
For each mutant it forks, puts the mutated function's code into the function that is loaded, and asks the tests that enter that function,
those that reach the mutant's line first, the quicker ones before the slower ones, up to the first that fails. Nothing is imported again;
robots and compiled code are there.

*From the start*: in a fork of a process that has no module of the mutant's package, all is imported again, the mutant's module from the
mutated code. So are those asked that are no function's (a constant, a default), and each that survived quickly, since something that was
computed with the right code may have been kept. Only what survives this counts as a survivor.
"""

from __future__ import annotations

import gc
import os
import resource
import select
import signal
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.abc import InspectLoader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from time import perf_counter, process_time
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any

import pytest
from mutation.mutants import HOME, Mutant, unchanged

PACKAGES = ("kinematics", "perception", "planning", "retrieve_cli")
THIRD_PARTY = ("numpy", "scipy", "numba", "llvmlite", "fcl", "lxml", "trimesh", "hypothesis", "torch", "safetensors", "yourdfpy")
QUICKLY = ("-x", "-q", "-s", "-p", "no:cacheprovider", "-p", "no:xdist", "--assert=plain")
SLOW_S = 0.5
"""Tests that take longer are not asked."""
PATIENCE, GRACE_S = 10, 3.0
"""A test may take so many times as long as on the code itself, and so much processor time more."""
MEMORY = 8 << 30


@dataclass(frozen=True)
class Outcome:
    """What became of one mutant. how: "survived", "killed", "timeout" or "crash"; by: the first test that failed."""

    how: str
    by: str
    seconds: float


@dataclass(frozen=True)
class Seen:
    """What one test did on the code as it is. lines and functions (by `_place`) are those of the modules under test."""

    test: str
    lines: frozenset[tuple[str, int]]
    functions: frozenset[tuple[str, str, int]]
    seconds: float
    """processor time of the test without its fixtures, and"""
    whole_s: float
    """with those that were made for it"""


def _place(code: CodeType) -> tuple[str, str, int]:
    return code.co_filename, code.co_qualname, code.co_firstlineno


def outermost_changes(old: CodeType, new: CodeType) -> list[CodeType] | None:
    """The outermost functions' codes of `new` that differ from those of `old`; None if code that is run on import differs."""
    if old.replace(co_consts=()) != new.replace(co_consts=()) or len(old.co_consts) != len(new.co_consts):
        return None
    found = []
    for a, b in zip(old.co_consts, new.co_consts, strict=True):
        if not (isinstance(a, CodeType) and isinstance(b, CodeType)):
            if repr(a) != repr(b):
                return None
            continue
        if a == b:
            continue
        if a.co_flags & 2:  # CO_NEWLOCALS: a function; the others are bodies of classes
            found.append(b)
        elif (inner := outermost_changes(a, b)) is not None:
            found += inner
        else:
            return None
    return found


def _functions(files: frozenset[str]) -> dict[tuple[str, str, int], list[FunctionType]]:
    """The functions of some files that are loaded, by their places."""
    found = defaultdict[tuple[str, str, int], list[FunctionType]](list)
    for f in gc.get_objects():
        if type(f) is FunctionType and f.__code__.co_filename in files:
            found[_place(f.__code__)].append(f)
    return found


def _live(codes: Sequence[CodeType], functions: dict[tuple[str, str, int], list[FunctionType]]) -> list[tuple[FunctionType, CodeType]]:
    """The functions that are loaded, each with the code that is to be put into it; empty unless each code has one that takes it."""
    found = [(f, c) for c in codes for f in functions.get(_place(c), ())]
    fits = all(f.__code__.co_freevars == c.co_freevars for f, c in found)
    return found if fits and {_place(c) for _, c in found} == {_place(c) for c in codes} else []


def _forget(files: frozenset[str]) -> None:
    """Empty the caches of the functions of some files."""
    for module in list(sys.modules.values()):
        if getattr(module, "__file__", None) in files:
            for value in list(vars(module).values()):
                for cached in (value, *(vars(value).values() if isinstance(value, type) else ())):
                    if hasattr(cached, "cache_clear"):
                        cached.cache_clear()


# ------------------------------------------------------------------------------------------------------------------------------- processes


def _in_fork(work: Callable[[int], int], limit_s: float) -> Outcome:
    """`work(pipe)` in a fork, its exit code 0 for survived and 1 for killed; it writes the test that failed to the pipe."""
    began = perf_counter()
    listen, say = os.pipe()
    child = os.fork()
    if child == 0:
        ended = 70
        try:
            quiet = os.open(os.devnull, os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
            ended = work(say)
        finally:
            os._exit(ended)
    os.close(say)
    by = b""
    with os.fdopen(listen, "rb", buffering=0) as pipe:
        while (left := limit_s - (perf_counter() - began)) > 0 and select.select([pipe], [], [], left)[0]:
            if not (heard := pipe.read(4096)):
                break
            by += heard
        else:
            os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    seconds, name = perf_counter() - began, by.decode()
    if os.WIFSIGNALED(status):
        return Outcome("timeout" if os.WTERMSIG(status) in (signal.SIGKILL, signal.SIGPROF) else "crash", name, seconds)
    return Outcome({0: "survived", 1: "killed", 2: "killed"}.get(os.WEXITSTATUS(status), "crash"), name, seconds)


class _Watch:
    """A plugin of pytest: ends the process when a test takes far longer than it does on the code itself, and notes the first that fails."""

    def __init__(self, usual: dict[str, float]) -> None:
        self.usual, self.failed = usual, ""

    def start(self, test: str) -> None:
        signal.setitimer(signal.ITIMER_PROF, PATIENCE * self.usual.get(test, 1.0) + GRACE_S)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.start(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = str(report.nodeid)

    def pytest_collectreport(self, report: Any) -> None:
        self.pytest_runtest_logreport(report)


class _Chosen:
    """A plugin of pytest that keeps some of the tests, in a given order, and has hypothesis not look for simpler examples."""

    def __init__(self, tests: Sequence[str] | None) -> None:
        self.order = None if tests is None else {test: i for i, test in enumerate(tests)}

    def pytest_collection(self) -> None:
        from hypothesis import Phase, settings

        settings.register_profile("unshrunk", settings(), phases=(Phase.explicit, Phase.generate))
        settings.load_profile("unshrunk")

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        order = self.order
        if order is not None:
            items[:] = sorted((i for i in items if i.nodeid in order), key=lambda i: order[i.nodeid])


# --------------------------------------------------------------------------------------------------------------------------- ready session


class Session:
    """A plugin of pytest that asks mutants instead of running the tests.

    tell: called with what the tests saw, then with (key, outcome) of each mutant that was asked.
    """

    def __init__(self, modules: Sequence[str], asked: Sequence[Mutant], tell: Callable[[Any], None]) -> None:
        self.modules, self.asked, self.tell, self.call_s = modules, asked, tell, 0.0
        self.files = frozenset(str(HOME / m) for m in modules)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self) -> Iterator[None]:
        began = process_time()
        try:
            return (yield)  # type: ignore[misc]
        finally:
            self.call_s = process_time() - began

    def pytest_runtestloop(self, session: Any) -> bool:
        if session.testsfailed:
            raise ValueError(f"{session.testsfailed} test files can't be collected")
        seen = [self._look(item, following) for item, following in zip(session.items, [*session.items[1:], session])]
        for i, first in enumerate(seen):
            if first.seconds > SLOW_S:  # it may be the one that loaded what is compiled
                seen[i] = self._look(session.items[i], session)
        self.tell(seen)
        whole = {m: unchanged(m) for m in self.modules}
        functions = _functions(self.files)
        gc.collect()
        gc.freeze()  # so that collections in forks leave the shared memory alone
        for mutant in self.asked:
            changed = outermost_changes(whole[mutant.module], mutant.code)
            if changed and (live := _live(changed, functions)):
                self.tell((mutant.key, self._try(session, live, choose(seen, mutant, changed))))
        return True

    def _look(self, item: Any, following: Any) -> Seen:
        """Run one test on the code as it is; what the following one shares with it is kept. Raises ValueError when it fails."""
        _forget(self.files)
        self.call_s, began = 0.0, process_time()
        with _tracing(self.files) as (lines, functions):
            reports = _run(item, following)
        if any(r.failed for r in reports):
            raise ValueError(f"{item.nodeid} fails on the code as it is; mend it first")
        return Seen(item.nodeid, frozenset(lines), frozenset(functions), self.call_s, process_time() - began)

    def _try(self, session: Any, live: list[tuple[FunctionType, CodeType]], tests: list[Seen]) -> Outcome:
        items, watch = {i.nodeid: i for i in session.items}, _Watch({s.test: s.seconds for s in tests})

        def work(say: int) -> int:
            for function, code in live:
                function.__code__ = code
            _forget(self.files)
            for k, s in enumerate(tests):
                watch.start(s.test)
                if any(r.failed for r in _run(items[s.test], items[tests[k + 1].test] if k + 1 < len(tests) else session)):
                    os.write(say, s.test.encode())
                    return 1
            return 0

        return _in_fork(work, 60 + 10 * PATIENCE * sum(s.seconds for s in tests))


def _run(item: Any, following: Any) -> list[Any]:
    from _pytest.runner import runtestprotocol

    return runtestprotocol(item, log=False, nextitem=following)


def choose(seen: Sequence[Seen], mutant: Mutant, functions: Sequence[CodeType] | None) -> list[Seen]:
    """The tests that enter a mutant's function, or all if none does; those first that reach its line, then the quicker ones."""
    file, places = str(HOME / mutant.module), {_place(c) for c in functions or ()}
    quick = [s for s in seen if s.seconds <= SLOW_S]
    return sorted([s for s in quick if s.functions & places] or quick, key=lambda s: ((file, mutant.number) not in s.lines, s.seconds))


@contextmanager
def _tracing(files: frozenset[str]) -> Iterator[tuple[set[tuple[str, int]], set[tuple[str, str, int]]]]:
    """Notes the lines and the functions of some files that are run meanwhile."""
    lines, functions = set[tuple[str, int]](), set[tuple[str, str, int]]()

    def inside(frame: FrameType, event: str, _: object) -> Any:
        if event == "line":
            lines.add((frame.f_code.co_filename, frame.f_lineno))
        return inside

    def outside(frame: FrameType, event: str, _: object) -> Any:
        if frame.f_code.co_filename in files:
            functions.add(_place(frame.f_code))
            return inside
        return None

    sys.settrace(outside)
    try:
        yield lines, functions
    finally:
        sys.settrace(None)


def ask_quickly(modules: Sequence[str], tests: Sequence[str], asked: Sequence[Mutant], tell: Callable[[Any], None]) -> None:
    """Ask those mutants that are functions', in this process and its forks. Raises ValueError when a test fails on the code as it is."""
    session = Session(modules, asked, tell)
    ended = pytest.main([*QUICKLY, *(str(HOME / t) for t in tests)], [session, _Chosen(None)])
    if ended:
        raise ValueError(f"the tests can't be run on the code as it is (pytest ends with {int(ended)}): {' '.join(tests)}")


# -------------------------------------------------------------------------------------------------------------------------- from the start


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


def ask_from_start(mutant: Mutant, tests: Sequence[Seen]) -> Outcome:
    """A mutant whose module and all that rests on it is imported again. `preload` comes before."""
    if not tests:
        return Outcome("survived", "", 0.0)

    def work(say: int) -> int:
        name = mutant.module.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        sys.meta_path.insert(0, _Replaced(name, str(HOME / mutant.module), mutant.code))
        watch = _Watch({s.test: s.seconds for s in tests})
        files = dict.fromkeys(str(HOME / s.test.split("::")[0]) for s in tests)
        signal.setitimer(signal.ITIMER_PROF, 60.0)  # for what is run on import
        ended = pytest.main([*QUICKLY, *files], [watch, _Chosen([s.test for s in tests])])
        os.write(say, watch.failed.encode()[:4000])
        return int(ended)

    return _in_fork(work, 120 + 10 * PATIENCE * sum(s.seconds for s in tests))


def preload(package: str, tests: Sequence[str]) -> None:
    """Import all that tests need and that does not rest on a package, so that forks find it loaded."""
    above = PACKAGES[PACKAGES.index(package) :]
    ask = "import sys, pytest; pytest.main(['--collect-only', *sys.argv[1:]]); print('MODULES', *sys.modules)"
    told = subprocess.run([sys.executable, "-c", ask, *QUICKLY, *tests], cwd=HOME, capture_output=True, text=True, check=True).stdout
    wanted = next(line for line in told.splitlines() if line.startswith("MODULES")).split()[1:]
    for name in wanted:
        top = name.split(".")[0]
        if top not in above and not top.startswith(("test_", "conftest", "_pytest", "__")) and (top in PACKAGES or top in THIRD_PARTY):
            with suppress(ImportError):
                import_module(name)
