# SPDX-License-Identifier: MIT
"""Evaluation of expressions in a scene (doc/expressions.md), and expansion of repeated elements.

The results are used for animations only. The scene is not checked here, because the program has read and checked it before."""

from __future__ import annotations

import ast
import copy
import math
import operator
import re
from collections.abc import Mapping
from typing import Any

OPERATORS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv, ast.Pow: operator.pow,
             ast.USub: operator.neg, ast.UAdd: operator.pos}


def smooth_step(x: float, a: float = 0.0, b: float = 1.0) -> float:
    x = min(1.0, max(0.0, (x - a) / (b - a)))
    return x**3 * (10 - 15 * x + 6 * x * x)


FUNCTIONS = {name: getattr(math, name) for name in "sin cos tan asin acos atan sinh cosh tanh exp log sqrt atan2".split()} | {
    "abs": abs, "min": min, "max": max, "sign": lambda x: -1.0 if x < 0 else 1.0, "step": lambda x: float(x >= 0),
    "ramp": lambda x: max(0.0, x), "smooth_step": smooth_step}


def evaluate(text: str, known: Mapping[str, float]) -> float:
    """Value of an expression. Raises `ValueError` if the text is not an expression or cannot be evaluated."""
    def value(node) -> float:
        if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
            return float(node.value)
        if isinstance(node, ast.Name):
            if node.id == "pi":
                return math.pi
            return float(known[node.id])
        if isinstance(node, ast.BinOp):
            result = OPERATORS[type(node.op)](value(node.left), value(node.right))
            if isinstance(result, complex):
                raise ValueError("a power without a real value")
            return result
        if isinstance(node, ast.UnaryOp):
            return OPERATORS[type(node.op)](value(node.operand))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return float(FUNCTIONS[node.func.id](*map(value, node.args)))
        raise ValueError("not an expression")

    try:
        return value(ast.parse(text.strip().replace("^", "**"), mode="eval").body)
    except (KeyError, SyntaxError, ArithmeticError, TypeError, RecursionError, ValueError) as error:
        raise ValueError(f"{text!r} cannot be evaluated: {error}") from None


class Numbers:
    """The parameters of a scene, with which its numbers are evaluated."""

    def __init__(self, parameters: Mapping[str, Any]):
        self.known: dict[str, float] = {}
        waiting = dict(parameters)
        while waiting:
            before = len(waiting)
            for name, given in list(waiting.items()):
                try:
                    self.known[name] = self.number(given)
                    del waiting[name]
                except ValueError:
                    continue
            if len(waiting) == before:
                break

    def number(self, given: Any) -> float:
        return evaluate(given, self.known) if isinstance(given, str) else float(given)

    def list(self, given: Any) -> list[float]:
        return [self.number(one) for one in (given if isinstance(given, (list, tuple)) else [given])]

    def at(self, given: Any, t: float) -> float:
        """Value at time t of a function of time, which is an expression or a number."""
        return evaluate(given, {**self.known, "t": t}) if isinstance(given, str) else float(given)

    def filled(self, given: Any, known: Mapping[str, float]) -> Any:
        """Replace expressions in braces, in names and texts, by their values, and the index of the repetition in other expressions."""
        if isinstance(given, str):
            text = re.sub(r"\{([^}]*)\}", lambda found: str(round(evaluate(found[1], known))), given)
            for name in known.keys() - self.known.keys():
                text = re.sub(rf"(?<![\w.]){re.escape(name)}(?![\w.(])", f"({known[name]:g})", text) if "{" not in given else text
            return text
        if isinstance(given, list):
            return [self.filled(one, known) for one in given]
        if isinstance(given, Mapping):
            return {self.filled_name(name, known): self.filled(one, known) for name, one in given.items()}
        return given

    @staticmethod
    def filled_name(name: str, known: Mapping[str, float]) -> str:
        return re.sub(r"\{([^}]*)\}", lambda found: str(round(evaluate(found[1], known))), name)


# Keys whose texts are names: the index of a repetition is replaced only within braces.
NAMES = {"type", "bodies", "between", "on", "joint", "joints", "point", "drive", "distance"}


def written_out(scene: Mapping[str, Any], numbers: Numbers) -> dict[str, Any]:
    """Elements of a scene by kind, including the elements of repetitions."""
    found = {kind: copy.deepcopy(dict(scene.get(kind, {}))) for kind in ("body", "joint", "constraint", "wheel", "force", "sensor")}
    for repeat in scene.get("repeat", {}).values():
        count, first = round(numbers.number(repeat.get("count", 0))), round(numbers.number(repeat.get("first", 1)))
        for i in range(first, first + count):
            known = {**numbers.known, repeat.get("index", "i"): float(i)}
            for kind, elements in repeat.items():
                if kind not in found or not isinstance(elements, Mapping):
                    continue
                for name, keys in elements.items():
                    made = {}
                    for key, value in keys.items():
                        if key in NAMES or (key == "at" and isinstance(value, str)):
                            made[key] = fill_names(value, known)
                        else:
                            made[key] = numbers.filled(value, known)
                    found[kind][Numbers.filled_name(name, known)] = made
    return found


def fill_names(value: Any, known: Mapping[str, float]) -> Any:
    if isinstance(value, str):
        text = Numbers.filled_name(value, known)
        # The coordinates of a point `body:[x, y]` are expressions.
        head, colon, position = text.partition(":")
        if colon:
            entries = [f"{evaluate(one, known):.17g}" for one in position.strip(" []").split(",")]
            return f"{head}:[{', '.join(entries)}]"
        return text
    return [fill_names(one, known) for one in value] if isinstance(value, list) else value
