"""The structure of the code in figures: import circles, imports against the layers, the longest file and function, the median file.

    python benchmarks/structure.py

prints one JSON line and, before it, every circle and every import against the layers, which are errors (exit 1).
"""

from __future__ import annotations

import ast
import json
import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LAYERS = ("kinematics", "perception", "planning", "retrieve_cli")


def modules() -> dict[str, Path]:
    """The dotted name of every module, and its file."""
    files = sorted(file for layer in LAYERS for file in (ROOT / layer).rglob("*.py"))
    return {".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f for f in files}


def imports(file: Path, known: dict[str, Path]) -> Iterator[str]:
    """The modules of ours that a file imports, at its top or inside a function; imports for type checking alone do not count."""
    todo: list[ast.AST] = [ast.parse(file.read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            continue
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = [f"{node.module}.{a.name}" for a in node.names]
            yield from (name for name in inner if name in known)
            if node.module in known and not all(name in known for name in inner):
                yield node.module
        todo += ast.iter_child_nodes(node)


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """The strongly connected components of more than one module (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(v: str) -> None:
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in sorted(graph[v]):
            if w not in index:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in stack:
                low[v] = min(low[v], index[w])
        if low[v] == index[v]:
            component = [stack.pop()]
            while component[-1] != v:
                component.append(stack.pop())
            if len(component) > 1:
                found.append(sorted(component))

    for v in graph:
        if v not in index:
            visit(v)
    return found


def functions(file: Path) -> Iterator[tuple[int, str]]:
    """(lines, place) of every function in a file."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield (node.end_lineno or node.lineno) - node.lineno + 1, f"{file.relative_to(ROOT)}:{node.lineno} {node.name}"


def main() -> int:
    """Print the figures."""
    known = modules()
    graph = {name: set(imports(file, known)) - {name} for name, file in known.items()}
    against = [(a, b) for a, some in graph.items() for b in some if LAYERS.index(b.split(".")[0]) > LAYERS.index(a.split(".")[0])]
    rings = circles(graph)
    for ring in rings:
        print("circle:", " ".join(ring))
    for a, b in against:
        print(f"against the layers: {a} imports {b}")
    lengths = {file: len(file.read_text(encoding="utf-8").splitlines()) for file in known.values()}
    longest = max(lengths, key=lambda f: lengths[f])
    lines, place = max(pair for file in known.values() for pair in functions(file))
    figures = {
        "modules": len(known),
        "lines": sum(lengths.values()),
        "import_circles": len(rings),
        "imports_against_layers": len(against),
        "longest_file": [str(longest.relative_to(ROOT)), lengths[longest]],
        "longest_function": [place, lines],
        "median_file": statistics.median(n for n in lengths.values() if n > 1),
    }
    print(json.dumps(figures))
    return 1 if rings or against else 0


if __name__ == "__main__":
    sys.exit(main())
