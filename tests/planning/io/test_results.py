"""Results of runs that are broken off: nothing is lost, nothing is touched too early, and a later run goes on to the same bytes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path

import documents
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.errors import InputError
from kinematics.scene import Scene
from planning.io import results
from planning.io.results import scene_writer
from planning.io.scene_documents import scene_from_json

ASKED = {"seed": 3, "spec": "paper"}
SCENE = scene_from_json(documents.scene())


class Killed(BaseException):
    """As Ctrl-C comes: not an Exception."""


def run(out: Path, n: int, *, killed_after: int | None = None, resume: bool = False, asked: dict[str, object] | None = None) -> list[int]:
    """Write n scenes, or fewer when killed; the numbers of those that were made."""
    made = []
    with suppress(Killed), scene_writer(out, asked=asked or ASKED, resume=resume) as write:
        for i in write.left(range(n), key=str):
            if i == killed_after:
                raise Killed
            write(replace(SCENE, id=f"scene-ü-{i}"))
            made.append(i)
    return made


def names(folder: Path) -> set[str]:
    return {p.name for p in folder.iterdir()}


@given(n=st.integers(0, 8), killed=st.lists(st.integers(0, 8), max_size=4), cut=st.integers(0, 2000), cut_log=st.integers(0, 40))
def test_a_resumed_run_gives_the_same_bytes(
    n: int, killed: list[int], cut: int, cut_log: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """However often it was killed, and with the last bytes of the part or of its log lost."""
    folder = tmp_path_factory.mktemp("runs")
    run(folder / "whole.jsonl", n)
    out, part, log = folder / "s.jsonl", folder / "s.part.jsonl", folder / "s.part.log"
    for at in killed if n else ():
        if out.exists():
            break
        run(out, n, killed_after=at, resume=True)
        if part.exists():
            os.truncate(part, max(0, part.stat().st_size - cut))
            os.truncate(log, max(len(log.read_text().split("\n")[0]) + 1, log.stat().st_size - cut_log))
    if not out.exists():
        run(out, n, resume=True)
    assert out.read_bytes() == (folder / "whole.jsonl").read_bytes()
    assert names(folder) == {"whole.jsonl", "s.jsonl"}


def test_only_what_is_left_is_done(tmp_path: Path) -> None:
    out = tmp_path / "s.jsonl"
    assert run(out, 9, killed_after=4) == [0, 1, 2, 3]
    assert not out.exists()
    assert run(out, 9, killed_after=7, resume=True) == [4, 5, 6]
    assert run(out, 9, resume=True) == [7, 8]


def test_a_rerun_keeps_what_is_there(tmp_path: Path) -> None:
    """Also the second and the third time, and a run that ends without a first result touches nothing at all."""
    out, part = tmp_path / "s.jsonl", tmp_path / "s.part.jsonl"
    run(out, 9, killed_after=4)
    first = part.read_bytes()
    run(out, 9, killed_after=0)
    assert part.read_bytes() == first
    assert names(tmp_path) == {"s.part.jsonl", "s.part.log"}
    run(out, 9, killed_after=2)
    run(out, 9)
    assert names(tmp_path) == {"s.jsonl", "s.part-1.jsonl", "s.part-2.jsonl"}
    assert (tmp_path / "s.part-1.jsonl").read_bytes() == first
    assert len((tmp_path / "s.part-2.jsonl").read_text().splitlines()) == 2


def test_what_another_run_left_is_not_gone_on_with(tmp_path: Path) -> None:
    out, part, log = tmp_path / "s.jsonl", tmp_path / "s.part.jsonl", tmp_path / "s.part.log"
    run(out, 9, killed_after=4)
    kept = part.read_bytes(), log.read_bytes()
    with pytest.raises(InputError, match=r"s.part.jsonl: was made otherwise: seed was 3, and is 4 now; begin anew without --resume"):
        run(out, 9, resume=True, asked={**ASKED, "seed": 4})
    with pytest.raises(InputError, match="result 1 is of another scene"), scene_writer(out, asked=ASKED, resume=True) as write:
        next(iter(write.left(range(1, 9), key=str)))
    assert (part.read_bytes(), log.read_bytes()) == kept
    for broken in (b"", b"{", b"[]\n", b'{"asked": 3}\n', b"\xff\n", b"null\n"):
        log.write_bytes(broken)
        with pytest.raises(InputError, match=r"nobody knows what it was made for, s.part.log does not say"):
            run(out, 9, resume=True)
        assert part.read_bytes() == kept[0]


def test_two_runs_can_not_write_one_file(tmp_path: Path) -> None:
    out = tmp_path / "s.jsonl"
    with scene_writer(out) as write:
        write(SCENE)
        for resume in (False, True):
            with pytest.raises(InputError, match=r"another run is writing it just now \(s.part.jsonl\)"):
                run(out, 3, resume=resume)
        write(SCENE)
    assert len(out.read_text().splitlines()) == 2


def test_resuming_needs_a_file(tmp_path: Path) -> None:
    for out in (None, Path("-"), Path("/dev/null")):
        with pytest.raises(InputError, match="--resume goes on with a file: name it with -o"), scene_writer(out, resume=True):
            pass
    heard: list[str] = []
    with scene_writer(tmp_path / "s.jsonl", resume=True, tell=heard.append) as write:
        write(SCENE)
    assert heard == [f"{tmp_path / 's.jsonl'}: there is no s.part.jsonl to go on with: beginning at the first"]


def test_what_is_kept_is_told(tmp_path: Path) -> None:
    out, heard = tmp_path / "s.jsonl", list[str]()
    for _ in range(2):
        with suppress(Killed), scene_writer(out, tell=heard.append) as write:
            write(SCENE)
            raise Killed
    assert heard == [
        f"{out}: 1 result is in s.part.jsonl; the same call with --resume goes on there",
        f"{out}: an earlier run left s.part.jsonl (1 result): it is kept as s.part-1.jsonl",
        f"{out}: 1 result is in s.part.jsonl; the same call with --resume goes on there",
    ]


def test_items_are_taken_one_by_one(tmp_path: Path) -> None:
    """An endless stream of them is no matter."""

    def scenes() -> Iterator[Scene]:
        for i in count():
            yield replace(SCENE, id=str(i))

    with suppress(Killed), scene_writer(tmp_path / "s.jsonl") as write:
        for scene in write.left(scenes(), key=lambda s: s.id):
            if scene.id == "3":
                raise Killed
            write(scene)
    lines = (tmp_path / "s.part.jsonl").read_text().splitlines()
    assert [json.loads(line)["id"] for line in lines] == ["0", "1", "2"]


def test_no_room_names_the_file() -> None:
    with pytest.raises(InputError, match="/dev/full: can't be written: no space left on device"), scene_writer(Path("/dev/full")) as write:
        write(SCENE)


def test_half_a_character_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'\\udc80' can't be written as UTF-8"), scene_writer(tmp_path / "s.jsonl") as write:
        write(replace(SCENE, id="\udc80"))


@pytest.mark.parametrize("resume", [True, False])
def test_a_run_that_is_broken_off_before_it_begins_leaves_the_earlier_ones_results(
    resume: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while the part is read, which takes seconds of a large one, must not remove it."""
    out, part, log = tmp_path / "s.jsonl", tmp_path / "s.part.jsonl", tmp_path / "s.part.log"
    run(out, 9, killed_after=4)
    kept = part.read_bytes(), log.read_bytes()

    def interrupted(file: Path) -> list[int]:
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(results, "_line_ends", interrupted)
        run(out, 9, resume=resume)
    assert (part.read_bytes(), log.read_bytes()) == kept
    assert run(out, 9, resume=True) == [4, 5, 6, 7, 8]


def test_a_log_that_can_not_be_opened_costs_no_results(tmp_path: Path) -> None:
    out, part, log = tmp_path / "s.jsonl", tmp_path / "s.part.jsonl", tmp_path / "s.part.log"
    run(out, 9, killed_after=4)
    kept = part.read_bytes()
    log.unlink()
    log.mkdir()
    with pytest.raises(InputError, match="can't be written"):
        run(out, 9)
    assert part.read_bytes() == kept
