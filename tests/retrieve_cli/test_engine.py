"""Several processes, here and on a Ray cluster: the same results in the same order, whatever dies on the way."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from kinematics.errors import InputError
from retrieve_cli.__main__ import main
from retrieve_cli.engine import AHEAD, map_ordered

ROOT = Path(__file__).resolve().parents[2]
HERE = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests"), str(Path(__file__).parent)])}


def square(x: int) -> int:
    return x * x


def slow_first(x: int) -> tuple[int, int]:
    time.sleep(0.5 if x == 0 else 0.0)
    return x, os.getpid()


def picky(x: int) -> int:
    if x == 5:
        raise InputError("scenes.jsonl:6: five is not liked")
    return x


def unsendable(x: int) -> object:
    return (lambda: x) if x == 1 else x


def dies_once(folder: Path, x: int) -> int:
    mark = folder / str(x)
    if x % 4 == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return -x


def always_dies(x: int) -> int:
    os._exit(9)


def threads(x: int) -> str | None:
    return os.environ.get("OMP_NUM_THREADS")


def deaf(_: int) -> bool:
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def sleeps(x: int) -> int:
    time.sleep(60)
    return x


@pytest.mark.parametrize("workers", [None, 1, 2, 3])
def test_results_come_in_order(workers: int | None) -> None:
    assert list(map_ordered(square, range(20), workers=workers)) == [x * x for x in range(20)]
    assert list(map_ordered(square, [], workers=workers)) == []


def test_a_slow_item_holds_up_nobody_but_its_followers() -> None:
    found = list(map_ordered(slow_first, range(6), workers=2))
    assert [x for x, _ in found] == list(range(6))
    assert len({pid for x, pid in found if x > 0} - {found[0][1]}) == 1
    assert os.getpid() not in {pid for _, pid in found}


def test_items_are_read_no_further_ahead_than_needed() -> None:
    taken, worst = 0, 0

    def items() -> Iterator[int]:
        nonlocal taken
        for x in range(60):
            taken += 1
            yield x

    for done, _ in enumerate(map_ordered(square, items(), workers=2)):
        worst = max(worst, taken - done)
    assert taken == 60
    assert worst <= 2 * AHEAD + 2


@pytest.mark.parametrize("workers", [1, 2])
def test_a_complaint_comes_where_its_result_would(workers: int) -> None:
    seen = list[int]()
    with pytest.raises(InputError, match="jsonl:6: five is not liked"):
        seen.extend(map_ordered(picky, range(9), workers=workers))
    assert seen == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_complaint_about_an_item_comes_after_the_results_before_it(workers: int) -> None:
    def items() -> Iterator[int]:
        yield from range(4)
        raise InputError("scenes.jsonl:5: broken")

    seen = list[int]()
    with pytest.raises(InputError, match="jsonl:5: broken"):
        seen.extend(map_ordered(square, items(), workers=workers))
    assert seen == [0, 1, 4, 9]


def test_a_result_that_cannot_travel_is_told() -> None:
    with pytest.raises(RuntimeError, match="while sending function"):
        list(map_ordered(unsendable, range(3), workers=2))


def test_a_process_that_dies_is_replaced_and_that_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert list(map_ordered(partial(dies_once, tmp_path), range(10), workers=2)) == [-x for x in range(10)]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["2", "6"]
    told = sorted(capsys.readouterr().err.splitlines())
    assert told == [f"item {i}: its process died (exit code -9); another one begins it again" for i in (2, 6)]


def test_a_process_that_dies_while_it_is_idle_is_replaced_too(capsys: pytest.CaptureFixture[str]) -> None:
    """A broken pipe to it would pass for a reader of stdout that has gone, which ends a run without a word."""

    def items() -> Iterator[int]:
        yield from range(4)
        for child in multiprocessing.active_children():  # the next item is asked for when one of them is idle
            child.kill()
            child.join()
        yield from range(4, 8)

    assert list(map_ordered(square, items(), workers=2)) == [x * x for x in range(8)]
    assert "its process died (exit code -9); another one begins it again" in capsys.readouterr().err


def test_an_item_that_always_kills_ends_the_run() -> None:
    with pytest.raises(InputError, match=r"item 0: its process died 3 times \(exit code 9\)"):
        list(map_ordered(always_dies, [0], workers=2))


def test_each_process_has_one_thread_and_this_one_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert list(map_ordered(threads, range(2), workers=2)) == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals can't be held back here")
def test_an_interruption_is_left_to_the_first_process() -> None:
    """In a process of its own, for the first one that starts others is the one that could get it wrong."""
    code = """if True:
        from test_engine import deaf
        from retrieve_cli.engine import map_ordered
        if __name__ == "__main__":
            print(list(map_ordered(deaf, range(4), workers=2)))
    """
    assert subprocess.run([sys.executable, "-c", code], env=HERE, capture_output=True, text=True).stdout == "[True, True, True, True]\n"


@pytest.mark.parametrize(
    ("number", "group", "code"),
    [
        (signal.SIGINT, True, 130),  # as a terminal does: every process hears it
        (signal.SIGTERM, False, 143),
        (signal.SIGHUP, False, 129),
        (signal.SIGKILL, False, -signal.SIGKILL),
    ],
)
def test_a_signal_ends_all_processes_at_once(number: int, group: bool, code: int) -> None:
    """Whichever it is, and also when the first process has no chance to end the others."""
    program = """if True:
        import os, signal, sys, threading
        from test_engine import sleeps
        from retrieve_cli.engine import map_ordered
        from retrieve_cli.errors import guarded
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it would be ignored, as it should be
        if __name__ == "__main__":
            sys.exit(guarded(lambda: list(map_ordered(sleeps, range(9), workers=2)) and 0))
    """
    with subprocess.Popen([sys.executable, "-c", program], env=HERE, stderr=subprocess.PIPE, start_new_session=True) as p:
        try:
            for _ in range(300):
                if len(_children(p.pid)) >= 2:
                    break
                time.sleep(0.1)
            time.sleep(1.0)
            begun = time.monotonic()
            (os.killpg if group else os.kill)(p.pid, number)
            assert p.wait(30) == code
            while _children(p.pid) and time.monotonic() - begun < 10:
                time.sleep(0.1)
            assert time.monotonic() - begun < 10
            assert p.stderr is not None
            assert p.stderr.read() == b""
            assert not _children(p.pid)
        finally:
            p.kill()


def _children(pid: int) -> list[int]:
    """The living processes of a session that are busy with items."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            stat = (entry / "stat").read_text().rsplit(")", 1)[1].split() if entry.name.isdigit() else []
            if stat and int(stat[3]) == pid and stat[0] != "Z" and b"spawn_main" in (entry / "cmdline").read_bytes():
                found.append(int(entry.name))
        except OSError:
            continue
    return found


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"engine": "rya"}, r"unknown engine 'rya' \(did you mean 'ray'\?\)"),
        ({"address": "here:1"}, "--address here:1 is for --engine ray"),
    ],
)
def test_wrong_words(options: dict[str, str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        map_ordered(square, range(3), **options)


def test_ray_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"pip install 'retrieve\[cluster\]'"):
        map_ordered(square, range(3), engine="ray")


def test_workers_change_no_scene_and_no_plan(tmp_path: Path) -> None:
    """But for the times, which are measured."""
    found = []
    for workers in ("1", "2"):
        scenes, plans = tmp_path / f"scenes-{workers}.jsonl", tmp_path / f"plans-{workers}.jsonl"
        assert main(["gen", "-n", "3", "--seed", "3", "--workers", workers, "-o", str(scenes)]) == 0
        assert main(["plan", str(scenes), "--policy", "random", "--workers", workers, "-o", str(plans)]) == 0
        rows = [json.loads(line) for line in plans.read_text().splitlines()]
        found.append((scenes.read_bytes(), [{k: v for k, v in row.items() if not k.endswith("_time_s")} for row in rows]))
    assert found[0] == found[1]
    assert len(found[0][1]) == 3


CLUSTER = """if True:
    import sys, time
    import ray
    from ray.cluster_utils import Cluster
    from retrieve_cli.engine import map_ordered
    from ray_items import where

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    other = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    seen = []
    for x, node in map_ordered(where, range(16), engine="ray", address=cluster.address):
        seen.append((x, node))
        if x == 5:
            cluster.remove_node(other, allow_graceful=False)
    cluster.shutdown()
    assert [x for x, _ in seen] == list(range(16)), seen
    nodes = [node for _, node in seen]
    assert len(set(nodes[:6])) == 2, nodes
    assert len(set(nodes[-4:])) == 1, nodes
    print("all there")
"""


def test_a_ray_cluster_that_loses_a_node(tmp_path: Path) -> None:
    """Two nodes on the loopback; one is killed half-way, and every item comes back nevertheless, in order."""
    pytest.importorskip("ray")
    (tmp_path / "ray_items.py").write_text(
        "import time\nimport ray\n\ndef where(x):\n    time.sleep(0.4)\n    return x, ray.get_runtime_context().get_node_id()\n"
    )
    (tmp_path / "cluster.py").write_text(CLUSTER)
    path = os.pathsep.join([str(ROOT), str(tmp_path)])
    done = subprocess.run(
        [sys.executable, str(tmp_path / "cluster.py")], env={**os.environ, "PYTHONPATH": path, "RAY_USAGE_STATS_ENABLED": "0"},
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.strip().endswith("all there")
