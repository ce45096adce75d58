"""The imports go one way, kinematics ◀ perception ◀ planning ◀ retrieve_cli, and the command line is quick because it imports late."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import structure

ROOT = Path(__file__).resolve().parent.parent
LAYERS = ("kinematics", "perception", "planning", "retrieve_cli")
MODULES = sorted(file.relative_to(ROOT) for layer in LAYERS for file in (ROOT / layer).rglob("*.py"))

HEAVY = {"PIL", "airo_models", "coacd", "fcl", "jsonschema", "lxml", "matplotlib", "meshcat", "numba", "pinocchio", "pyarrow"}
HEAVY |= {"pytorch_kinematics", "ray", "rich", "ruckig", "safetensors", "scipy", "torch", "trimesh", "vhacdx", "yourdfpy"}
FIRST_WORDS = frozenset({"__init__", "__main__", "app", "errors"})
"""Modules of retrieve_cli that every call imports: standard library, Typer, and each other only."""


def imports(file: Path, *, top_only: bool = False) -> Iterator[tuple[int, str]]:
    """(line, dotted module) of every import; top_only: those that run when the module is imported, not under TYPE_CHECKING."""
    todo: list[ast.AST] = [ast.parse((ROOT / file).read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: a relative import hides its layer"
            yield node.lineno, node.module or ""
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)
        elif top_only and (isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or _for_types_only(node)):
            continue
        else:
            todo += ast.iter_child_nodes(node)


def _for_types_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def test_no_file_imports_in_a_circle() -> None:
    known = structure.modules()
    graph = {name: set(structure.imports(file, known)) - {name} for name, file in known.items()}
    assert "kinematics.chain" in graph["kinematics.collision.geometry"]
    assert structure.circles({"a": {"b"}, "b": {"a"}, "c": {"a"}}) == [["a", "b"]]
    assert not structure.circles(graph)


def test_numba_machinery_knows_nothing_of_robots() -> None:
    known = structure.modules()
    machinery = {name: file for name, file in known.items() if name.startswith("kinematics.jit")}
    assert len(machinery) > 3
    for name, file in machinery.items():
        assert all(other.startswith(("kinematics.jit", "kinematics.cache")) for other in structure.imports(file, known)), name


def test_the_architecture_page_has_our_folders_and_no_others() -> None:
    """What its tree of folders names is there, and every folder of ours is named."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    tree = text[text.index("    kinematics/  ") : text.index("One `retrieve plan`")]
    named, above = set[Path](), list[str]()
    for line in filter(None, tree.splitlines()):
        names, _, said = line.strip().partition("  ")
        del above[(len(line) - len(line.lstrip())) // 2 - 2 :]
        parent = ROOT.joinpath(*above)
        assert all((parent / name).exists() for name in names.split()), line
        if names.endswith("/"):
            above.append(names)
        here = ROOT.joinpath(*above)
        named |= {here, *(here / name for name in re.findall(r"\w+/", said))}
        assert all((here / name).is_file() or (parent / name).is_file() for name in re.findall(r"\w+\.py", said)), line
    assert named == {file.parent for layer in LAYERS for file in (ROOT / layer).rglob("__init__.py")}


def test_there_is_something_to_read() -> None:
    assert {m.parts[0] for m in MODULES} == set(LAYERS)
    assert "planning.plan" in {name for _, name in imports(Path("planning/io/files.py"), top_only=True)}
    commands = Path("retrieve_cli/commands/results.py")
    lazy = {name for _, name in imports(commands)} - {name for _, name in imports(commands, top_only=True)}
    assert "retrieve_cli.report" in lazy


@pytest.mark.parametrize("file", MODULES, ids=str)
def test_imports_go_one_way(file: Path) -> None:
    above = LAYERS[LAYERS.index(file.parts[0]) + 1 :]
    wrong = [f"{file}:{line}: {name}" for line, name in imports(file) if name.split(".")[0] in (*above, "tests", "benchmarks", "examples")]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("file", [m for m in MODULES if m.parts[0] == "retrieve_cli"], ids=str)
def test_commands_import_nothing_heavy_at_the_top(file: Path) -> None:
    wrong = [f"{file}:{line}: {name}" for line, name in imports(file, top_only=True) if name.split(".")[0] in HEAVY]
    assert not wrong, "\n".join(wrong)
    if file.stem in FIRST_WORDS or "commands" in file.parts:
        ours = [name for _, name in imports(file, top_only=True) if name.split(".")[0] in LAYERS]
        assert all(name.split(".")[:2] in (["retrieve_cli", word] for word in ("errors", "app", "commands")) for name in ours), ours


def test_help_loads_neither_numpy_nor_the_library() -> None:
    code = (
        "import sys; from retrieve_cli.__main__ import main; main(['plan', '--help']); "
        "print(*sorted({m.split('.')[0] for m in sys.modules}), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(done.stderr.split())
    assert "typer" in loaded
    assert not loaded & {"numpy", "kinematics", "perception", "planning", *(HEAVY - {"rich"})}  # rich draws the help


def test_no_two_modules_of_the_tests_have_one_name() -> None:
    """pytest imports them by their names alone, and would refuse the second when all are run together."""
    names = Counter(file.name for file in (ROOT / "tests").rglob("*.py") if file.name != "__init__.py")
    assert [name for name, n in names.items() if n > 1] == []
