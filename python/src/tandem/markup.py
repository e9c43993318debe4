# SPDX-License-Identifier: MIT
"""Bounded reading of XML files of other programs, and conversion of their attributes to numbers and words.

Every fault raises `InputError`. Text between elements is dropped; URDF does not use it.
"""

from __future__ import annotations

import math
import os
import re
import stat
import sys
import xml.etree.ElementTree as ElementTree
from xml.parsers import expat

import numpy as np

#: Bytes and elements of a file together with all that it includes, elements within elements, and the largest magnitude of a number: its
#: products and powers stay far from overflow.
MOST_BYTES = 64*2**20
MOST_ELEMENTS = 200_000
DEEPEST = 2000
LARGEST = 1e30

NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


class InputError(ValueError):
    """Error in a file; the message names the remedy."""


class Budget:
    """Bytes and elements that may still be read."""

    def __init__(self):
        self.bytes, self.elements = MOST_BYTES, MOST_ELEMENTS


def parse(path, budget: Budget | None = None) -> ElementTree.Element:
    """The root of a file."""
    budget = budget or Budget()
    text = read_bytes(path, budget)
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate(namespace_separator="}")
    depth = 0

    def named(name):
        return "{" + name if "}" in name else name

    def start(tag, attributes):
        nonlocal depth
        depth += 1
        budget.elements -= 1
        if depth > DEEPEST:
            raise InputError(f"{path}, line {parser.CurrentLineNumber}: elements are nested more than {DEEPEST} deep")
        if budget.elements < 0:
            raise InputError(f"{path} has more than {MOST_ELEMENTS} elements, including included files; divide the model")
        builder.start(named(tag), {named(key): value for key, value in attributes.items()})

    def end(tag):
        nonlocal depth
        depth -= 1
        builder.end(named(tag))

    def entity(*_):
        raise InputError(f"{path} declares entities, which are not supported; expand them")

    parser.StartElementHandler, parser.EndElementHandler, parser.EntityDeclHandler = start, end, entity
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise InputError(f"{path} is not XML: {error}") from error
    except (LookupError, ValueError) as error:
        # An encoding unknown to Python.
        raise error if isinstance(error, InputError) else InputError(f"{path} is not XML: {error}") from error
    return builder.close()


def read_bytes(path, budget: Budget) -> bytes:
    """The content of a regular file."""
    # Opening a pipe would wait for its writer.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise InputError(f"{path} is not a regular file; save its content in one")
        with open(handle, "rb", closefd=False) as file:
            text = file.read(budget.bytes + 1)
    finally:
        os.close(handle)
    budget.bytes -= len(text)
    if budget.bytes < 0:
        raise InputError(f"{path} has more than {MOST_BYTES//2**20} MB, including included files; divide the model")
    return text


def numbers(text: str | None, count, default, where: str, least: float | None = None) -> np.ndarray:
    """The numbers of an attribute, of the given count or between the two counts of a pair; the default if it is missing."""
    if text is None:
        return np.array(default, float)
    words = text.split()
    fewest, most = count if isinstance(count, tuple) else (count, count)
    values = [float(word) for word in words[:most + 1] if NUMBER.fullmatch(word)]
    if len(values) != len(words) or not fewest <= len(words) <= most:
        wanted = f"{fewest}" if fewest == most else f"{fewest} to {most}"
        raise InputError(f'{where}: "{shortened(text)}" should be {wanted} number{"s" if most > 1 else ""}')
    if any(abs(value) > LARGEST for value in values):
        raise InputError(f'{where}: "{shortened(text)}" has a number larger than {LARGEST:g}; use other units')
    if least is not None and any(value < least for value in values):
        raise InputError(f'{where}: "{shortened(text)}" must not be below {least:g}')
    return np.array(values)


def number(text: str | None, default: float, where: str, least: float | None = None) -> float:
    """One number."""
    return float(numbers(text, 1, (default,), where, least)[0])


def shortened(text: str, most: int = 60) -> str:
    return text if len(text) <= most else text[:most] + "..."


def finite(value: float) -> float:
    """A number that goes into a scene."""
    if not math.isfinite(value):
        raise InputError("a number of the scene overflows; check the units of masses, sizes and distances")
    return value


def guarded(action) -> int:
    """Run an import: the exit code, 2 with a message where the input is wrong."""
    try:
        # Numbers that overflow are refused when the scene is written.
        with np.errstate(all="ignore"):
            action()
        return 0
    except ArithmeticError as error:
        say(f"{error}; see whether masses, sizes and distances are in sensible units")
    except (OSError, ValueError, RuntimeError) as error:
        say(error)
    return 2


def say(text) -> None:
    """A message on one line, whatever names it quotes."""
    print("tandem: " + "".join(letter if letter.isprintable() else " " for letter in str(text)), file=sys.stderr)


def format_of(path) -> str:
    """urdf or mjcf, by the first element of a file."""
    tag = parse(path, Budget()).tag
    found = {"robot": "urdf", "mujoco": "mjcf", "mujocoinclude": "mjcf"}.get(tag)
    if found is None:
        raise InputError(f"{path} is neither URDF nor MJCF: its first element is <{tag[:60]}>, not <robot> or <mujoco>")
    return found
