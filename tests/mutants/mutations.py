"""Small changes to a module, each of a kind that slips have."""

import ast
import copy
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

_OTHER: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_SYMMETRIC = {"min", "max", "math.hypot", "np.hypot", "hypot", "np.array_equal", "dist"}
_CHECKING = "strict"  # of zip: what it would find is no part of what a module does
_SPEAKING = {"log", "logging", "warnings"}


class Mutation(NamedTuple):
    """One change. Function and change name it in a way that other lines of the module do not shift."""

    line: int
    function: str
    change: str
    number: int
    """Among the module's changes."""


def mutations(source: str) -> Iterator[Mutation]:
    """All changes of a module; what is said to people (docstrings, log lines, descriptions) is left alone."""
    for number, (function, _, _, _, node, change, _) in enumerate(_all(ast.parse(source))):
        yield Mutation(getattr(node, "lineno", 0), function, change, number)


def mutated(source: str, mutation: Mutation) -> str:
    """The module with the change."""
    tree = ast.parse(source)
    _, parent, field, index, _, _, new = next(islice(_all(tree), mutation.number, None))
    if index is None:
        setattr(parent, field, new)
    else:
        getattr(parent, field)[index] = new
    return ast.unparse(ast.fix_missing_locations(tree))


def _all(tree: ast.AST) -> Iterator[tuple[str, ast.AST, str, int | None, ast.AST, str, ast.AST]]:
    for function, parent, field, index, node in _nodes(tree, ""):
        # a number alone does not say which of the function's
        where = f"{_brief(parent)}: " if isinstance(node, ast.Constant) else ""
        for change, new in _changes(node):
            yield function, parent, field, index, node, where + change, new


def _nodes(node: ast.AST, function: str) -> Iterator[tuple[str, ast.AST, str, int | None, ast.AST]]:
    """Every node that may change, with where it hangs: (function, parent, field, index in it, node)."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list") or _is_speech(node, field):
            continue
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if not isinstance(child, ast.AST) or _is_docstring(child) or _speaks(child):
                continue
            named = isinstance(child, ast.FunctionDef | ast.ClassDef)
            inner = f"{function}.{child.name}".strip(".") if named else function
            if hasattr(child, "lineno"):
                yield inner, node, field, index, child
            yield from _nodes(child, inner)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """(what changes, the node in its place) for every way in which a node may change."""
    if _may_go(node):
        yield f"{_brief(node)} removed", ast.Pass(lineno=getattr(node, "lineno", 0))
    for what, fields in _other_fields(node):
        new = copy.deepcopy(node)
        for name, value in fields.items():
            setattr(new, name, value)
        yield what or f"{_brief(node)} -> {_brief(new)}", new
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield f"{_brief(node)} -> {_brief(node.operand)}", node.operand


def _may_go(node: ast.AST) -> bool:
    """Whether it is a statement without which the rest still runs."""
    if isinstance(node, ast.Assign):
        return isinstance(node.targets[0], ast.Attribute)
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Call)
    return isinstance(node, ast.Raise | ast.AugAssign)


def _other_fields(node: ast.AST) -> Iterator[tuple[str, dict[str, object]]]:
    """(what changes, "" if the code says it best; fields of the node with other values)."""
    match node:
        case ast.Compare(ops=[op, *rest]) if type(op) in _OTHER:
            yield "", {"ops": [_OTHER[type(op)](), *rest]}
        case ast.Constant(value=bool(value)):
            yield "", {"value": not value}
        case ast.Constant(value=int(value)):
            yield "", {"value": value + 1}
            yield "", {"value": value - 1}
        case ast.BoolOp(op=op):
            yield "", {"op": ast.Or() if isinstance(op, ast.And) else ast.And()}
        case ast.BinOp(op=ast.Add() | ast.Sub() as op):
            yield "", {"op": ast.Sub() if isinstance(op, ast.Add) else ast.Add()}
        case ast.Return(value=ast.expr()) if not _is_nothing(node.value):
            yield "", {"value": ast.Constant(None)}
        case ast.Call(func=func, args=args, keywords=keywords):
            name = _brief(func)
            starred = any(isinstance(argument, ast.Starred) for argument in args[:2])
            if len(args) > 1 and not starred and name not in _SYMMETRIC and not _same(*args[:2]):
                yield f"{name}: arguments swapped", {"args": [args[1], args[0], *args[2:]]}
            for index, keyword in enumerate(keywords):
                if keyword.arg not in (None, _CHECKING):
                    rest = keywords[:index] + keywords[index + 1 :]
                    yield f"{name}: {keyword.arg} dropped", {"keywords": rest}
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            yield f"if {_brief(test)} -> if not", {"test": ast.UnaryOp(ast.Not(), test)}


def _same(one: ast.AST, other: ast.AST) -> bool:
    return ast.dump(one) == ast.dump(other)


def _brief(node: ast.AST) -> str:
    return ast.unparse(node).splitlines()[0][:100]


def _is_nothing(node: ast.AST | None) -> bool:
    return isinstance(node, ast.Constant) and node.value in (None, False)


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _speaks(node: ast.AST) -> bool:
    """Whether it is a log line, when it is said, or the text of an error."""
    if isinstance(node, ast.If) and not node.orelse:
        return all(_speaks(statement) for statement in node.body)
    call = node.value if isinstance(node, ast.Expr) else node
    if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)):
        return isinstance(call, ast.JoinedStr)
    return isinstance(call.func.value, ast.Name) and call.func.value.id in _SPEAKING


def _is_speech(node: ast.AST, field: str) -> bool:
    silent = ("description", "help", _CHECKING)
    return isinstance(node, ast.keyword) and node.arg in silent and field == "value"
