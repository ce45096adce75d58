"""Whether functions are compiled by way of numba's inner parts, or plainly: see `kinematics.jit`."""

from __future__ import annotations

import multiprocessing
import os
import re
import sys
from collections.abc import Mapping

import numba
from numba.core.dispatcher import Dispatcher

SHOWN = ((0, 61), (0, 68))
"""The oldest and the newest numba (major, minor) whose inner parts were shown to do what is asked of them, by this repository's tests."""

FORCE = "RETRIEVE_PLAIN_NUMBA"
"""The environment variable that asks for plain compilation."""

METHODS = ("get_call_template", "get_overload", "_compile_for_args")
"""What `kinematics.jit.decorators` replaces in numba's dispatchers."""


def why_plain(version: str = numba.__version__, environment: Mapping[str, str] = os.environ) -> str | None:
    """The reason not to use numba's inner parts, in words; None when they are used."""
    if environment.get(FORCE, "0") not in ("", "0"):
        return f"{FORCE} is set"
    found = re.match(r"(\d+)\.(\d+)", version)
    if found is None or not SHOWN[0] <= (int(found[1]), int(found[2])) <= SHOWN[1]:
        oldest, newest = (".".join(map(str, known)) for known in SHOWN)
        return f"numba {version} is not among those that were tried ({oldest} to {newest})"
    if missing := [name for name in METHODS if not hasattr(Dispatcher, name)]:
        return f"numba {version} has no {missing[0]}"
    try:
        from numba.core.caching import IndexDataCacheFile  # noqa: F401

        import kinematics.jit.pipeline  # noqa: F401
    except (ImportError, AttributeError) as e:
        return f"numba {version} lacks a part: {e}"
    return None


def tell(reason: str) -> None:
    """Say on stderr, in one line, that compilation is plain; worker processes leave it to the one that started them."""
    if multiprocessing.parent_process() is None:
        print(f"retrieve: compiling plainly, so that the first start takes twice as long: {reason}", file=sys.stderr)


PLAIN = why_plain()
"""Why compilation is plain; None when it is not."""
if PLAIN:
    tell(PLAIN)
