"""The entry point: checks that the packages are ours, reads the command line, runs the command, returns the exit code."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from retrieve_cli.errors import ForeignPackageError, guarded, stand_in_for_closed_streams

OURS = ("kinematics", "perception", "planning", "retrieve_cli")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `retrieve` with the arguments `argv` (default: the process's own) and return the exit code."""
    stand_in_for_closed_streams()
    args = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in args  # may stand anywhere, as nobody remembers where it goes when something has just failed
    return guarded(lambda: _main([a for a in args if a != "--debug"]), debug=debug)


def _main(args: list[str]) -> int | None:
    check_packages(Path(__file__).resolve().parent.parent)
    for stream, errors in ((sys.stdout, "strict"), (sys.stderr, "backslashreplace")):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors=errors)  # the files are UTF-8 whatever the locale
    from retrieve_cli.app import parse

    job = parse(args)
    return job() if callable(job) else job


def check_packages(home: Path) -> None:
    """Make sure that the four top-level packages are the ones in `home`, for other distributions use the same names.

    Two cases: another package of that name comes first on the path; or another wheel was unpacked over ours, which the file sizes in our
    RECORD show. Nothing is imported, so this costs well under a millisecond.

    Raises: ForeignPackageError that names the intruder and the remedy.
    """
    for name in OURS:
        spec = find_spec(name)
        places = [Path(p).resolve() for p in (spec.submodule_search_locations or ())] if spec else []
        if places != [home / name]:
            found = str(places[0]) if places else "nowhere"
            raise _intrusion(name, f"was found in {found}, not in {home / name}", f"{name}/__init__.py", Path(found).parent)
    for record in home.glob("retrieve-*.dist-info/RECORD"):
        for line in record.read_text(encoding="utf-8").splitlines():
            file, _, size = line.rsplit(",", 2)
            if file.split("/")[0] in OURS and file.endswith(".py") and size:
                path = home / file
                if not path.is_file():
                    raise ForeignPackageError(f"{path} is missing: another package's removal took it along; {_REMEDY}")
                if path.stat().st_size != int(size) and (names := _owners(file, home)):
                    raise ForeignPackageError(f"{path} was overwritten by the distribution {', '.join(names)}; {_REMEDY}")


_REMEDY = "install retrieve in an environment of its own: python -m venv .venv && .venv/bin/pip install retrieve"


def _intrusion(name: str, found: str, file: str, folder: Path) -> ForeignPackageError:
    owners = _owners(file, folder)
    by = f" (it belongs to the distribution {', '.join(owners)})" if owners else ""
    return ForeignPackageError(f"the package {name} is not retrieve's own: it {found}{by}; {_REMEDY}")


def _owners(file: str, folder: Path) -> list[str]:
    """Names of the distributions in `folder`, other than ours, that say they installed `file`."""
    from importlib.metadata import distributions

    return [
        str(d.metadata["Name"])
        for d in distributions(path=[str(folder)])
        if d.metadata["Name"] != "retrieve" and any(f.as_posix() == file for f in d.files or ())
    ]


if __name__ == "__main__":
    sys.exit(main())
