"""Code of the user's own, MODULE:FUNCTION; what it does wrong is told in one line with its name."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from kinematics.errors import InputError, did_you_mean, one_line


def own_function(option: str, spec: str) -> Callable[..., Any]:
    """FUNCTION of MODULE, which is a module's name or a Python file. option: which asks for it, for the words of errors.

    Raises: InputError, with the module, the function and the exception.
    """
    module_name, colon, name = spec.rpartition(":")
    if not colon or not module_name or not name.isidentifier():
        raise InputError(f"{option} {spec}: MODULE:FUNCTION is expected, e.g. my_cell:world or my_cell.py:world")
    with answering(f"{option} {spec}"):
        module = _from_file(option, Path(module_name)) if module_name.endswith(".py") else _by_name(module_name)
    found = getattr(module, name, None)
    if not callable(found):
        raise InputError(f"{option} {spec}: {module_name} has no function {name!r}{did_you_mean(name, dir(module))}")
    return found  # type: ignore[no-any-return]


def code_digest(spec: str | None) -> str | None:
    """A hash of the file of MODULE, which is not run for it: what tells this code from other code of its name. None where there is none."""
    name = (spec or "").rpartition(":")[0]
    if name.endswith(".py"):
        file = Path(name)
    else:
        _look_here()
        try:
            found = importlib.util.find_spec(name) if name else None
        except (ImportError, ValueError):  # what is wrong is told when it is asked for
            found = None
        file = Path((found and found.origin) or "")
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16] if file.is_file() else None


def _by_name(name: str) -> Any:
    _look_here()
    return importlib.import_module(name)


def _look_here() -> None:
    """Let modules be found in the working folder, too."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)


def _from_file(option: str, file: Path) -> Any:
    if not file.is_file():
        raise InputError(f"{option}: {file}: no such file")
    name = f"own_code_{file.stem}"
    found = importlib.util.spec_from_file_location(name, file)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules[name] = module  # dataclasses look their module up
    found.loader.exec_module(module)
    return module


@contextmanager
def answering(where: str, kind: type[InputError] = InputError) -> Iterator[None]:
    """Turn whatever a user's code raises into one line, an exception of `kind`; --debug shows the rest."""
    try:
        yield
    except InputError:
        raise
    except Exception as e:
        raise kind(f"{where}: {type(e).__name__}: {one_line(e)}") from e
