"""The mutants of a module: its code with one expression or statement changed, each by one of `OPERATORS`."""

from __future__ import annotations

import ast
import marshal
from collections import Counter
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from types import CodeType

HOME = Path(__file__).resolve().parents[2]

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
OPPOSITES = {
    a: b
    for pair in (
        ("min", "max"), ("any", "all"), ("ceil", "floor"), ("argmin", "argmax"), ("sin", "cos"), ("minimum", "maximum"), ("ones", "zeros"),
    )
    for a, b in (pair, pair[::-1])
}  # fmt: skip
RANKINGS = ("sorted", "argsort", "permutation")
"""Functions whose result a mutant turns round."""
PASS_THROUGH = ("abs", "sorted", "sqrt", "inverse", "round", "reversed", "norm", "permutation")
"""Functions that a mutant leaves out, so that their argument stands alone."""
OPTIONS = ("key", "default", "axis", "reverse", "kind")
"""Keywords that a mutant leaves out."""
UNTOUCHED = ("decorator_list", "annotation", "returns", "type_params")
"""Fields of the syntax tree in which nothing is changed."""


def _compare(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            for other in COMPARISONS[type(op)]:
                yield ast.Compare(node.left, [*node.ops[:i], other(), *node.ops[i + 1 :]], node.comparators)


def _calculate(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        yield ast.BinOp(node.right, node.op, node.left)
    if isinstance(node, (ast.BinOp, ast.AugAssign)) and (other := ARITHMETIC.get(type(node.op))):
        yield ast.BinOp(node.left, other(), node.right) if isinstance(node, ast.BinOp) else ast.AugAssign(node.target, other(), node.value)
    if isinstance(node, ast.UnaryOp) and not (isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant)):
        yield node.operand


def _decide(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        for i in range(len(node.values)):
            rest = node.values[:i] + node.values[i + 1 :]
            yield ast.BoolOp(node.op, rest) if len(rest) > 1 else rest[0]
    if isinstance(node, (ast.If, ast.While, ast.IfExp)) and not isinstance(node.test, (ast.Compare, ast.Constant, ast.UnaryOp)):
        turned = ast.UnaryOp(ast.Not(), node.test)
        yield ast.IfExp(turned, node.body, node.orelse) if isinstance(node, ast.IfExp) else type(node)(turned, node.body, node.orelse)
    if isinstance(node, ast.comprehension):
        for i, test in enumerate(node.ifs):
            if not isinstance(test, (ast.Compare, ast.UnaryOp)):
                ifs = [*node.ifs[:i], ast.UnaryOp(ast.Not(), test), *node.ifs[i + 1 :]]
                yield ast.comprehension(node.target, node.iter, ifs, node.is_async)


def _write_other(node: ast.AST) -> Iterator[ast.AST]:
    """Another number, truth value or text."""
    if isinstance(node, ast.Constant):
        match node.value:
            case bool():
                yield ast.Constant(not node.value)
            case int():
                yield ast.Constant(node.value + 1)
            case float():
                yield ast.Constant(2 * node.value if node.value else 1.0)
            case str():
                yield ast.Constant(node.value + "XX")


def _call_other(node: ast.AST) -> Iterator[ast.AST]:
    if not isinstance(node, ast.Call):
        return
    name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr if isinstance(node.func, ast.Attribute) else ""
    if name in OPPOSITES:
        named = ast.Name(OPPOSITES[name], ast.Load())
        called = named if isinstance(node.func, ast.Name) else ast.Attribute(node.func.value, OPPOSITES[name], ast.Load())  # type: ignore[attr-defined]
        yield ast.Call(called, node.args, node.keywords)
    if name in PASS_THROUGH and node.args:
        yield node.args[0]
    if name in RANKINGS and not any(k.arg == "reverse" for k in node.keywords):
        yield ast.Subscript(node, ast.Slice(None, None, ast.UnaryOp(ast.USub(), ast.Constant(1))), ast.Load())
    for keyword in node.keywords:
        if keyword.arg in OPTIONS:
            yield ast.Call(node.func, node.args, [k for k in node.keywords if k is not keyword])


def _leave_out(node: ast.AST) -> Iterator[ast.AST]:
    """A statement that does something, and what a function returns."""
    if isinstance(node, (ast.AugAssign, ast.Raise, ast.Expr)) and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        yield ast.Pass()
    if isinstance(node, ast.Break):
        yield ast.Continue()
    if isinstance(node, ast.Continue):
        yield ast.Break()
    if isinstance(node, ast.Return) and node.value is not None and not _is_none(node.value):
        yield ast.Return(ast.Constant(None))


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


OPERATORS: tuple[Callable[[ast.AST], Iterator[ast.AST]], ...] = (_compare, _calculate, _decide, _write_other, _call_other, _leave_out)


@dataclass(frozen=True)
class Mutant:
    """One change to a module: the text of its line, the expression before and after, and which of those that read alike it is."""

    module: str
    line: str
    change: str
    nth: int
    number: int
    code: CodeType

    @property
    def key(self) -> tuple[str, str, str, int]:
        return self.module, self.line, self.change, self.nth


def unchanged(module: str) -> CodeType:
    """A module as it is, compiled as its mutants are."""
    return compile(ast.parse((HOME / module).read_text()), str(HOME / module), "exec")


def mutants(module: str) -> list[Mutant]:
    """All mutants of a module, in its order; those that compile to the same code as another one, or as the module, are left out."""
    text = (HOME / module).read_text()
    tree, lines = ast.parse(text), text.splitlines()
    codes, alike, found = {marshal.dumps(compile(tree, module, "exec"))}, Counter[tuple[str, str]](), list[Mutant]()
    for put, node, line_number in _places(tree):
        for other in (new for operator in OPERATORS for new in operator(node)):
            change = f"{_words(node)} → {_words(other)}"
            put(ast.fix_missing_locations(ast.copy_location(copy(other), node)))  # a copy, since it may be a part of the node
            code = compile(tree, str(HOME / module), "exec")
            put(node)
            if (dumped := marshal.dumps(code)) not in codes:
                codes.add(dumped)
                line = lines[line_number - 1].strip()
                alike[line, change] += 1
                found.append(Mutant(module, line, change, alike[line, change], line_number, code))
    return found


def _places(node: ast.AST, line: int = 0) -> Iterator[tuple[Callable[[ast.AST], None], ast.AST, int]]:
    """Every node below one, the line that it stands on, and how to put another in its place."""
    line = getattr(node, "lineno", line)
    for field, value in ast.iter_fields(node):
        if field in UNTOUCHED:
            continue
        if isinstance(value, ast.AST):
            yield lambda new, field=field: setattr(node, field, new), value, getattr(value, "lineno", line)  # type: ignore[misc]
            yield from _places(value, line)
        elif isinstance(value, list):
            for i, item in enumerate(value):
                if isinstance(item, ast.AST) and not _is_docstring(item):
                    yield lambda new, value=value, i=i: value.__setitem__(i, new), item, getattr(item, "lineno", line)  # type: ignore[misc]
                    yield from _places(item, line)


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _words(node: ast.AST) -> str:
    """An expression or statement as it is written, its body left out."""
    match node:
        case ast.If() | ast.While():
            return f"{type(node).__name__.lower()} {ast.unparse(node.test)}"
        case ast.comprehension():
            return ast.unparse(node).strip()
        case ast.Constant(value=str()):
            return repr(node.value)
    return " ".join(ast.unparse(node).split())
