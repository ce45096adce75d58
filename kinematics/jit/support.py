"""Whether functions are compiled by way of numba's inner parts, or plainly: see `kinematics.jit`."""

from __future__ import annotations

import multiprocessing
import os
import re
import sys
from collections.abc import Mapping
from importlib import metadata

SHOWN = ((0, 61), (0, 68))
"""The oldest and the newest numba (major, minor) whose inner parts were shown to do what is asked of them, by this repository's tests."""

FORCE = "RETRIEVE_PLAIN_NUMBA"
"""The environment variable that asks for plain compilation."""

METHODS = ("get_call_template", "compile")
"""What `kinematics.jit.compiler` uses of numba's dispatchers."""


def why_plain(version: str | None = None, environment: Mapping[str, str] = os.environ) -> str | None:
    """The reason not to use numba's inner parts, in words; None when they are used. Numba is not imported for it."""
    if environment.get(FORCE, "0") not in ("", "0"):
        return f"{FORCE} is set"
    version = version or metadata.version("numba")
    found = re.match(r"(\d+)\.(\d+)", version)
    if found is None or not SHOWN[0] <= (int(found[1]), int(found[2])) <= SHOWN[1]:
        oldest, newest = (".".join(map(str, known)) for known in SHOWN)
        return f"numba {version} is not among those that were tried ({oldest} to {newest})"
    return None


def missing_part() -> str | None:
    """The inner part that a numba of the right version lacks after all, in words."""
    import numba
    from numba.core.dispatcher import Dispatcher

    if missing := [name for name in METHODS if not hasattr(Dispatcher, name)]:
        return f"numba {numba.__version__} has no {missing[0]}"
    try:
        from numba.core.caching import IndexDataCacheFile  # noqa: F401

        import kinematics.jit.pipeline
        import kinematics.jit.trampoline  # noqa: F401
        from kinematics.jit.numpy_abi import layout_known
    except (ImportError, AttributeError) as e:
        return f"numba {numba.__version__} lacks a part: {e}"
    return None if layout_known() else "numpy's arrays are laid out in another way than was tried"


def tell(reason: str) -> None:
    """Say on stderr, in one line, that compilation is plain; worker processes leave it to the one that started them."""
    if multiprocessing.parent_process() is None:
        print(f"retrieve: compiling plainly, so that the first start takes twice as long: {reason}", file=sys.stderr)


PLAIN = why_plain()
"""Why compilation is plain; None when it is not, as far as can be seen before numba is imported."""
if PLAIN:
    tell(PLAIN)
