"""What is kept on disk: read back as it was, or thrown away and made again; never from a folder that others could write to."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics import cache
from kinematics.jit import cache_folder

ROOT = Path(__file__).resolve().parents[2]
ARRAYS = {"a": np.arange(12.0).reshape(3, 4), "names": np.array(["hand", "ü"]), "none": np.zeros((0, 3), np.int64)}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "retrieve"


def the_file(home: Path) -> Path:
    (file,) = home.iterdir()
    return file


def test_arrays_come_back(home: Path) -> None:
    assert cache.load("robot-1") is None
    cache.store("robot-1", ARRAYS)
    found = cache.load("robot-1")
    assert found is not None
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)
    assert home.stat().st_mode & 0o077 == 0


@given(st.data())
def test_damage_is_noticed_and_mended(data: st.DataObject) -> None:
    """Cut off, a bit flipped, something in front or behind, or empty: the entry is removed, and can be stored anew."""
    cache.store("robot-1", ARRAYS)
    file = the_file(cache.folder())
    whole = file.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    flipped = bytes([*whole[:at], whole[at] ^ (1 << data.draw(st.integers(0, 7))), *whole[at + 1 :]])
    for broken in (whole[:at], flipped, b"x" + whole, whole + b"x", data.draw(st.binary(max_size=200))):
        file.write_bytes(broken)
        assert cache.load("robot-1") is None
        assert not file.exists()
        cache.store("robot-1", ARRAYS)
        assert file.read_bytes() == whole


def test_another_entry_under_this_name_is_foreign(home: Path) -> None:
    cache.store("robot-1", ARRAYS)
    os.rename(the_file(home), home / "robot-2.arrays")
    assert cache.load("robot-2") is None
    np.savez(home / "robot-3.arrays", **ARRAYS)  # type: ignore[arg-type]
    os.rename(home / "robot-3.arrays.npz", home / "robot-3.arrays")
    assert cache.load("robot-3") is None


def test_a_folder_that_others_can_write_to_is_not_used(home: Path) -> None:
    cache.store("robot-1", ARRAYS)
    home.chmod(0o777)
    assert cache.load("robot-1") is None
    cache.store("robot-2", ARRAYS)
    assert [p.name for p in home.iterdir()] == ["robot-1.arrays"]
    home.chmod(0o755)  # to be read by others is no harm
    assert cache.load("robot-1") is not None


def test_no_folder_is_no_error(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home.write_text("a file")
    cache.store("robot-1", ARRAYS)
    assert cache.load("robot-1") is None
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))
    assert cache.folder() == Path("/nonexistent/retrieve")


def test_on_a_full_disk_what_was_made_lasts_for_the_process(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "no space left on device")

    home.mkdir(parents=True)
    file = home / "code"
    with monkeypatch.context() as no_room:
        no_room.setattr(os, "replace", full)
        cache.write(file, b"first")
        cache.store("robot-1", ARRAYS)
    assert list(home.iterdir()) == []
    assert cache.read(file) == b"first"
    assert set(cache.load("robot-1") or ()) == set(ARRAYS)
    cache.write(file, b"second")
    assert (cache.read(file), [f.name for f in home.iterdir()]) == (b"second", ["code"])
    file.unlink()
    assert cache.read(file) is None, "what was written is not remembered"


def test_a_folder_without_room_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for free, told in ((10**6, f"there is no room in {cache_folder.FOLDER}"), (10**9, "")):
        monkeypatch.setattr(shutil, "disk_usage", lambda _, free=free: SimpleNamespace(free=free))
        assert cache_folder.lacks_room() == told


def test_a_relative_folder_in_the_environment_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else every folder in which the program is called would get a cache of its own; the XDG specification says so, too."""
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    for relative in ("", "cache", "./cache"):
        monkeypatch.setenv("XDG_CACHE_HOME", relative)
        assert cache.folder() == tmp_path / ".cache" / "retrieve"
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache.folder() == Path("/somewhere/retrieve")


# Compiled code --------------------------------------------------------------------------------------------------------------------------

PROGRAM = """
import os, sys, warnings
import numpy as np
from kinematics.jit import cache_folder
from kinematics.jit.decorators import njit

@njit(cache=True)
def twice(x):
    return 2 * x

answer, hits = twice(21), len(twice.stats.cache_hits)
again = njit(cache=True)(twice.py_func)  # it finds what is on disk by now
assert again(21) == answer
print(answer, hits, len(again.stats.cache_hits), cache_folder.FOLDER, cache_folder.WRONG, sep="|")
"""


def run(folder: Path, home: Path, **environment: str) -> tuple[int, int, int, Path, str]:
    """The answer, how often it came from the cache, and how often when asked for once more; the folder, and what is wrong with the one it
    should have been."""
    (folder / "program.py").write_text(PROGRAM)
    env = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    env |= {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(home), **environment}
    done = subprocess.run([sys.executable, "program.py"], cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    answer, hits, again, where, wrong = done.stdout.strip().split("|")
    return int(answer), int(hits), int(again), Path(where), wrong


def test_damaged_machine_code_is_compiled_again(tmp_path: Path) -> None:
    """Whatever happens to a file of the cache, the answer is right, and who asks next finds good code."""
    home = tmp_path / "cache"
    assert run(tmp_path, home)[:3] == (42, 0, 1)
    *found, folder, wrong = run(tmp_path, home)
    assert (found, wrong) == ([42, 1, 1], "")
    assert folder.parent == home / "retrieve"
    assert folder.name.startswith("compiled-")
    for ending in ("nbi", "nbc"):
        (file,) = folder.rglob(f"*.{ending}")
        whole = file.read_bytes()
        middle = len(whole) // 2
        for broken in (whole[:middle], whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]):
            file.write_bytes(broken)
            assert run(tmp_path, home)[:3] == (42, 0, 1)
    assert run(tmp_path, home)[:3] == (42, 1, 1)


def test_compiled_code_is_kept_apart_and_safe(tmp_path: Path) -> None:
    """By CPU and by numba's settings; and for one run alone where others could put theirs."""
    home = tmp_path / "cache"
    plain = run(tmp_path, home)[3]
    assert run(tmp_path, home, NUMBA_BOUNDSCHECK="1")[3] != plain
    assert run(tmp_path, home, NUMBA_CPU_NAME="x86-64")[3].name.startswith("compiled-x86-64-")
    plain.chmod(0o777)
    answer, hits, _, folder, wrong = run(tmp_path, home)
    assert (answer, hits) == (42, 0)
    assert wrong == f"{plain} may be written to by others (chmod go-w {plain})"
    assert not folder.exists()  # it was made for that run
    mine = tmp_path / "mine"
    assert run(tmp_path, home, NUMBA_CACHE_DIR=str(mine))[3:] == (mine, "")
    (tmp_path / "file").write_text("")
    assert run(tmp_path, tmp_path / "file")[4].endswith("can't be made: Not a directory")
