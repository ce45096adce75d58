"""Many items, one function, several processes: here, or as tasks on a Ray cluster. Results come in the items' order.

Whoever does an item, and however often it is begun, the result must be the same: items carry the words of their own random generators.
A process that dies takes nothing with it, its item is given to another one.
"""

from __future__ import annotations

import logging
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import Any, Generic, TypeVar

from kinematics.errors import InputError, choose, one_line
from retrieve_cli.terminal import say

ENGINES = ("local", "ray")
AHEAD = 4  # items a worker may be ahead of the result that is waited for
TRIES = 3  # how often an item may take its process down
_THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # a process has one core

T = TypeVar("T")
R = TypeVar("R")
Outcome = tuple[bool, Any]  # it went well, and the result; or not, and the exception


def map_ordered(
    function: Callable[[T], R], items: Iterable[T], *, workers: int | None = None, engine: str = "local", address: str | None = None
) -> Iterator[R]:
    """Yield function(item) for every item, in order; items are read no further ahead than the workers need.

    function, items and results travel between processes: function must be one of a module, or a `partial` of one. An exception comes up
    where its item's result would have, one of `items` itself after the results of the items before it.
    workers: by default 1 here, which means this very process, and as many as the cluster has cores with Ray.
    Raises: InputError for an unknown engine, an address without Ray, and when Ray or its cluster is missing.
    """
    choose("engine", engine, ENGINES)
    if engine == "ray":
        return _on_ray(function, items, workers, address)
    if address is not None:
        raise InputError(f"--address {address} is for --engine ray")
    return _here(function, items, workers) if (workers or 1) > 1 else map(function, items)


class _Source(Generic[T]):
    """Items one by one; what goes wrong with them is kept until the results before it are out."""

    def __init__(self, items: Iterable[T]) -> None:
        self._items, self.ended, self.error = iter(items), False, None

    ended: bool
    error: BaseException | None

    def take(self) -> tuple[T, ...]:
        """The next item, or nothing."""
        if self.ended:
            return ()
        try:
            return (next(self._items),)
        except StopIteration:
            self.ended = True
        except Exception as e:
            self.ended, self.error = True, e
        return ()


def _outcome(function: Callable[[T], R], item: T) -> Outcome:
    try:
        return True, function(item)
    except Exception as e:
        return False, e


def _unpack(outcome: Outcome) -> Any:
    good, value = outcome
    if not good:
        raise value
    return value


# Processes on this machine ------------------------------------------------------------------------------------------------------------


class _Worker:
    """A process that takes items and sends outcomes; job: the number of the item it has, -1 when it is idle."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        from multiprocessing import get_context

        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, function), daemon=True)
        self.job, self.item = -1, None
        with _environment(), _no_interrupt():
            self.process.start()
        theirs.close()

    item: Any

    def give(self, job: int, item: Any) -> None:
        """Send an item. One that has died while it was idle is found out where its outcome is waited for."""
        self.job, self.item = job, item
        with suppress(BrokenPipeError, ConnectionResetError):
            self.pipe.send(item)

    def end(self) -> None:
        self.process.terminate()
        self.process.join(2)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.pipe.close()


def _serve(pipe: Connection, function: Callable[[Any], Any]) -> None:
    """What a worker does: one item after another, until the other end is closed; it does not outlive the process that started it."""
    Thread(target=_die_with_parent, daemon=True).start()
    while True:
        try:
            item = pipe.recv()
        except (EOFError, OSError):
            return
        outcome = _outcome(function, item)
        try:
            pipe.send(outcome)
        except OSError:
            return
        except Exception as e:  # a result or an exception that can't travel
            pipe.send((False, RuntimeError(f"{type(e).__name__}: {one_line(e)} (while sending {type(outcome[1]).__name__})")))


def _die_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _here(function: Callable[[T], R], items: Iterable[T], workers: int | None) -> Iterator[R]:
    source, pool = _Source(items), list[_Worker]()
    ready: dict[int, Outcome] = {}
    tries: dict[int, int] = {}
    due, given, most = 0, 0, workers or 1
    try:
        while True:
            while due in ready:
                yield _unpack(ready.pop(due))
                due += 1
            if len(pool) < most and not source.ended and all(w.job >= 0 for w in pool) and (item := source.take()):
                pool.append(_Worker(function))
                pool[-1].give(given, item[0])
                given += 1
                continue
            idle = [w for w in pool if w.job < 0]
            if idle and given < due + AHEAD * most and (item := source.take()):
                idle[0].give(given, item[0])
                given += 1
                continue
            busy = {w.pipe: w for w in pool if w.job >= 0}
            if not busy:
                break
            for pipe in wait(list(busy)):
                worker = busy[pipe]  # type: ignore[index]
                try:
                    ready[worker.job] = worker.pipe.recv()
                    worker.job = -1
                except (EOFError, OSError):
                    pool[pool.index(worker)] = _instead(worker, function, tries)
        if source.error is not None:
            raise source.error
    finally:
        for worker in pool:
            worker.process.terminate()
        for worker in pool:
            worker.end()


def _instead(dead: _Worker, function: Callable[[Any], Any], tries: dict[int, int]) -> _Worker:
    """Another process for the item of one that died, which is said. Raises: InputError when the item has taken too many down."""
    dead.end()
    tries[dead.job] = tries.get(dead.job, 0) + 1
    if tries[dead.job] == TRIES:
        raise InputError(
            f"item {dead.job}: its process died {TRIES} times (exit code {dead.process.exitcode}); too little memory? try fewer --workers"
        )
    say(f"item {dead.job}: its process died (exit code {dead.process.exitcode}); another one begins it again")
    fresh = _Worker(function)
    fresh.give(dead.job, dead.item)
    return fresh


@contextmanager
def _environment() -> Iterator[None]:
    """One thread a process, for the processes that are started inside."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(_THREADS)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.__setitem__(name, value)


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Ctrl-C reaches every process of a terminal: those started inside leave it to this one, which ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing.resource_tracker import ensure_running

    ensure_running()  # the first process would start it, and that lets interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# A cluster ------------------------------------------------------------------------------------------------------------------------------


def _on_ray(function: Callable[[T], R], items: Iterable[T], workers: int | None, address: str | None) -> Iterator[R]:
    """Tasks on a Ray cluster: the one at `address`, or of one's own on this machine. A dead node's tasks are begun anew elsewhere."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as e:
        raise InputError("--engine ray needs Ray: pip install 'retrieve[cluster]'") from e
    started = not ray.is_initialized()
    if started:
        own: dict[str, Any] = {} if address or os.environ.get("RAY_ADDRESS") else {"num_cpus": workers, "include_dashboard": False}
        try:
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, runtime_env={"env_vars": _THREADS}, **own)
        except (ConnectionError, ValueError, RuntimeError) as e:
            raise InputError(f"--engine ray: can't reach a cluster{f' at {address}' if address else ''}: {one_line(e)}") from e
    return _tasks(ray, function, items, workers, started)


def _tasks(ray: Any, function: Callable[[T], R], items: Iterable[T], workers: int | None, started: bool) -> Iterator[R]:
    task = ray.remote(num_cpus=1, max_retries=TRIES)(_outcome)
    source, due = _Source(items), deque[Any]()
    most = AHEAD * (workers or max(1, int(ray.cluster_resources().get("CPU", 1))))
    try:
        while True:
            while len(due) < most and (item := source.take()):
                due.append(task.remote(function, item[0]))
            if not due:
                break
            try:
                outcome = ray.get(due[0])
            except ray.exceptions.RayError as e:
                raise InputError(f"--engine ray: a task failed {TRIES + 1} times: {one_line(e)}") from e
            due.popleft()
            yield _unpack(outcome)
        if source.error is not None:
            raise source.error
    finally:
        for ref in due:
            ray.cancel(ref, force=True)
        if started:
            ray.shutdown()
