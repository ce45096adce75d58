"""Files that are written: beside their name first and then renamed, so that whoever reads one reads it whole.

What can't be written (no such folder, no room on the disk) is an InputError that names the file.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from kinematics.errors import InputError


@contextmanager
def replacing(out: Path) -> Iterator[Path]:
    """A path to write to, NAME.part.ENDING beside `out`, that is renamed to `out` when all went well, and else removed.

    What is no ordinary file (/dev/null, a pipe) is written to directly.
    Raises: InputError when there is no such folder, or it can't be written to, or there is no room.
    """
    if is_special(out):
        with naming(out):
            yield out
        return
    target = place_for(out)
    part = part_of(target)
    with naming(out):
        part.open("wb").close()
    try:
        with naming(out):
            yield part
            rename(part, target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_text(out: Path, text: str) -> None:
    """Write a whole file, beside its name first. Raises InputError like `replacing`."""
    with replacing(out) as part:
        part.write_text(text, encoding="utf-8")


def refuse_input(out: Path | None, *sources: Path | None) -> None:
    """Raises: InputError where `out` is one of the files that are read, which would then be lost."""
    if out is None or not out.is_file():
        return
    for source in sources:
        if source is not None and source.is_file() and out.samefile(source):
            raise InputError(f"{out}: is read, and would be overwritten; write to another file")


def is_special(out: Path) -> bool:
    """Whether `out` is there and no ordinary file. Raises: InputError when it is a folder, or can't be looked at."""
    with naming(out):
        if not out.exists() or out.is_file():
            return False
        if out.is_dir():
            raise InputError(f"{out}: is a folder, not a file")
    return True


def place_for(out: Path) -> Path:
    """Where `out` lies: what a link points to. Nothing is touched. Raises: InputError when nothing can be written there."""
    try:
        target = out.resolve()  # a link stays a link
        there = target.parent.is_dir()
    except (OSError, RuntimeError, ValueError) as e:  # links in a circle; a null byte
        raise InputError(f"{out}: is no place for a file: {e}") from e
    if not there:
        raise InputError(f"{out}: the folder {target.parent} does not exist; make it first")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise InputError(f"{out}: can't be written: the folder {target.parent} may not be written to")
    return target


def part_of(target: Path, suffix: str | None = None) -> Path:
    """The name beside a file that it has while it is written: plans.part.jsonl."""
    return target.with_name(f"{target.stem}.part{target.suffix if suffix is None else suffix}")


def rename(part: Path, target: Path) -> None:
    """Give a file its name, once its bytes are on the disk, so that a power cut leaves the old file or the new one."""
    with part.open("rb+") as stream:
        os.fsync(stream.fileno())
    os.replace(part, target)
    sync_folder(target.parent)


def sync_folder(folder: Path) -> None:
    """Bring a folder's names to the disk, where the system can."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        except OSError:  # some file systems know no such thing
            pass
        finally:
            os.close(handle)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """A folder that no other run writes in while this lasts. It is made unless it is there, and goes again if nothing was written.

    Raises: InputError when another run writes in it, and where it can't be made.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder")
    fresh = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise InputError(f"{folder}: can't be made: {(e.strerror or str(e)).lower()}") from e
    with _locked(folder):
        try:
            yield
        finally:
            if fresh:
                with suppress(OSError):  # it is not empty
                    folder.rmdir()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other runs out, where the system has such locks. Raises: InputError when one is in it."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some file systems know no locks
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as e:
                raise InputError(f"{folder}: another run is writing in it just now; name another folder") from e
        yield
    finally:
        os.close(handle)


@contextmanager
def naming(out: Path | str) -> Iterator[None]:
    """Turn errors of the system that name no file (no room on the disk, a file too large) into an InputError that names `out`."""
    try:
        yield
    except BrokenPipeError:
        raise
    except UnicodeEncodeError as e:
        raise InputError(f"{out}: {e.object[e.start : e.end]!r} can't be written as UTF-8; is it half a character?") from e
    except OSError as e:
        own = (Path(out).name, part_of(Path(out)).name, part_of(Path(out), ".log").name)
        if e.filename is not None and Path(str(e.filename)).name not in own:
            raise
        raise InputError(f"{out}: can't be written: {(e.strerror or str(e)).lower()}") from e
