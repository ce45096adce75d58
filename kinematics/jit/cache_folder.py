"""Where compiled code is kept: settled before numba is imported, as importing `kinematics.jit` or a module in it does.

Machine code of entries lies in the folder itself, numba's own files in folders below. Numba caches compiled code per file and does not
notice a change in a function that it calls in another file, nor what its own settings were. So compiled code is kept apart by a hash of the
sources, of the CPU's name and features, of numba's version and settings, and of the way of compiling (`kinematics.jit.support`), under the
user's cache folder. It is code that runs: a folder that somebody else could write to is not used. What is compiled then lasts for one run.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from importlib import metadata
from pathlib import Path

from kinematics import cache

ROOM_B = 8_000_000  # more than what is compiled takes


def sources() -> bytes:
    """The text of every module that has compiled code, and where they all lie, which numba's cache goes by."""
    home = Path(__file__).resolve().parents[2]
    files = sorted(f for name in ("kinematics", "perception", "planning") for f in (home / name).rglob("*.py"))
    texts = [f.read_bytes() for f in files]
    return b"".join([str(home).encode(), *(text for text in texts if b"numba" in text or b"kinematics.jit" in text)])


def name() -> str:
    """The folder's name: the CPU's, and a hash of all that compiled code depends on."""
    from llvmlite import binding  # type: ignore[import-untyped]

    cpu = os.environ.get("NUMBA_CPU_NAME") or binding.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES") or binding.get_host_cpu_features().flatten()
    settings = [f"{key}={value}" for key, value in sorted(os.environ.items()) if key.startswith("NUMBA_") and key != "NUMBA_CACHE_DIR"]
    settings += [f"numba={metadata.version('numba')}", f"plain={os.environ.get('RETRIEVE_PLAIN_NUMBA', '0')}"]
    digest = hashlib.sha256("\n".join([cpu, features, sys.version, *settings]).encode(errors="surrogateescape") + sources()).hexdigest()[
        :16
    ]
    return f"compiled-{''.join(c if c.isalnum() else '-' for c in cpu)}-{digest}"


def settle() -> tuple[Path, str]:
    """The folder, `NUMBA_CACHE_DIR` if that is set; and what is wrong with the one that should be it, if it can't be used."""
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")  # a twentieth of compiling is messages that nobody reads
    given = os.environ.get("NUMBA_CACHE_DIR")
    wanted = Path(given) if given else cache.folder() / name()
    wrong = cache.unsafe(wanted)
    folder = wanted
    if wrong:
        folder = Path(tempfile.mkdtemp(prefix="retrieve-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:  # which has read its settings already
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return folder, wrong


FOLDER, WRONG = settle()


def lacks_room() -> str:
    """That the disk has no room for compiled code, in words; nothing where it has, or nobody knows."""
    try:
        free = shutil.disk_usage(FOLDER).free
    except OSError:
        return ""
    return f"there is no room in {FOLDER}" if free < ROOM_B else ""


def compiled_before() -> bool:
    """Whether an earlier run has left compiled code of this very version behind."""
    return any(file.suffix in (".code", ".nbc") for file in FOLDER.rglob("*"))
