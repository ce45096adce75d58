"""Where things are and whether they touch: robots, scenes, forward and inverse kinematics, collision. Knows no goal.

Numba caches compiled code per file and does not notice a change in a function that it calls in another file. So compiled code is kept
apart by a hash of the sources, under the user's cache folder; set before numba is imported, which happens in the modules below.
"""

import hashlib as _hashlib
import os as _os
from pathlib import Path as _Path


def _sources() -> str:
    home = _Path(__file__).resolve().parent.parent
    files = sorted(f for name in ("kinematics", "perception", "planning") for f in (home / name).rglob("*.py"))
    texts = [f.read_bytes() for f in files]
    compiled = [text for text in texts if b"numba" in text or b"kinematics.jit" in text]
    return _hashlib.sha256(b"".join([str(home).encode(), *compiled])).hexdigest()[:16]


_cache = _Path(_os.environ.get("XDG_CACHE_HOME") or _Path.home() / ".cache") / "retrieve"
_os.environ.setdefault("NUMBA_CACHE_DIR", str(_cache / f"compiled-{_sources()}"))
