"""Arithmetic of OpenSCENARIO: `${$speed / 3.6}`.

Source: ASAM OpenSCENARIO XML 1.3, "Expressions".
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping

LONGEST = 1000
"""Characters of an expression."""
PARAMETER = re.compile(r"\$([A-Za-z_]\w*)")
_TWO: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Mod: math.fmod,
}  # fmt: skip
_CALLED: Mapping[str, Callable[..., float]] = {
    "round": lambda x: float(round(x)), "floor": math.floor, "ceil": math.ceil, "sqrt": math.sqrt, "pow": math.pow,
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan,
    "abs": abs, "sign": lambda x: math.copysign(1.0, x) if x else 0.0, "max": max, "min": min,
}  # fmt: skip


def evaluate(text: str, value: Callable[[str], str]) -> float:
    """Give what an expression comes to.

    Args:
        text: What is between `${` and `}`.
        value: Gives the text of a parameter, by its name.

    Raises:
        ValueError: It is no arithmetic of finite numbers.
    """
    if len(text) > LONGEST:
        raise ValueError(f"has {len(text)} characters, expected up to {LONGEST}")
    names: list[str] = []

    def placed(found: re.Match[str]) -> str:
        names.append(found[1])
        return f" _{len(names) - 1} "

    plain = PARAMETER.sub(placed, text)
    values = {f"_{n}": value(name) for n, name in enumerate(names)}
    try:
        found = float(_value(ast.parse(plain.strip(), mode="eval").body, values))
    except (SyntaxError, TypeError, ArithmeticError, RecursionError, MemoryError) as e:
        raise ValueError(f"is no arithmetic ({type(e).__name__})") from None
    if not math.isfinite(found):
        raise ValueError(f"comes to {found}")
    return found


def _value(node: ast.expr, values: Mapping[str, str]) -> float:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name) and node.id in values:
        return float(values[node.id])
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        inner = _value(node.operand, values)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp) and type(node.op) in _TWO:
        return _TWO[type(node.op)](_value(node.left, values), _value(node.right, values))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        return _CALLED[_known(node.func.id)](*(_value(one, values) for one in node.args))
    raise ValueError(f"has {ast.unparse(node)[:40]!r}, which is no arithmetic of OpenSCENARIO")


def _known(name: str) -> str:
    if name not in _CALLED:
        raise ValueError(f"calls {name!r}, expected one of {', '.join(_CALLED)}")
    return name
