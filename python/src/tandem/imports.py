# SPDX-License-Identifier: MIT
"""A robot from a file of URDF or MJCF as a scene.

    tandem import robot.urdf                                  robot.toml
    tandem import model.xml --output arm.toml --at elbow=1.2,wrist=-0.3
    tandem import model.xml --verify                          accelerations at random states beside MuJoCo

MJCF is read by MuJoCo's own compiler: python -m pip install mujoco. The words urdf and mjcf before FILE are not needed.
"""

from __future__ import annotations

import sys
from pathlib import Path

from . import mjcf, urdf
from .markup import InputError, format_of, guarded, say
from .robots import Losses, parse_coordinates


def add_arguments(parser) -> None:
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--output", metavar="PATH", help="the scene (the name of the file, .toml)")
    parser.add_argument("--at", metavar="JOINT=X,...", help="positions of joints (rad, m) in the reference configuration")
    parser.add_argument("--key", metavar="NAME", help="MJCF: keyframe of the reference configuration and of the start")
    parser.add_argument("--floating", action="store_true", help="URDF: the root is a free body, not the ground")
    parser.add_argument("--limits", choices=("stops", "events", "none"), default="stops", help="ranges of joints (stops)")
    parser.add_argument("--balance", action="store_true", help="correct moments of inertia above the sum of the two others")
    parser.add_argument("--strict", action="store_true", help="refuse a file that is not imported completely")
    parser.add_argument("--verify", action="store_true", help="compare accelerations at random states with MuJoCo or Pinocchio")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")


def convert(path, *, limits="stops", at=None, key=None, floating=False, balance=False, looks=True):
    """The text of a scene for a file, and what it lacks, a line for each kind."""
    if format_of(path) == "urdf":
        if key is not None:
            raise InputError("--key is for MJCF; give --at")
        losses = Losses()
        text = urdf.to_toml(urdf.read(path), floating, at, source=Path(path).name, looks=looks, limits=limits, balance=balance, losses=losses)
        return text, losses.lines()
    if floating:
        raise InputError("--floating is for URDF; in MJCF, a body has a free joint")
    made = mjcf.convert(path, limits=limits, at=at, key=key, looks=looks, balance=balance)
    return made.toml(), made.losses.lines()


def run(given) -> None:
    if given.verify:
        from . import import_check

        print(import_check.table(import_check.verify(given.file)))
        return
    target = Path(given.output or Path(given.file).with_suffix(".toml").name)
    if target.exists() and not given.force:
        raise InputError(f"{target} exists; name another by --output, or overwrite it by --force")
    text, lost = convert(given.file, limits=given.limits, at=parse_coordinates(given.at), key=given.key, floating=given.floating,
                         balance=given.balance)
    if lost and given.strict:
        raise InputError(f"{given.file} is not imported completely: {'; '.join(lost)}; remove this from the file, or leave out --strict")
    target.write_text(text, encoding="utf-8")
    for line in lost:
        say(line)
    print(target)


def main(words=None) -> int:
    """The words after `tandem import`."""
    import argparse

    words = sys.argv[1:] if words is None else list(words)
    named = words.pop(0) if words[:1] in (["urdf"], ["mjcf"]) and len(words) > 1 else None
    parser = argparse.ArgumentParser(prog="tandem import", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    given = parser.parse_args(words)

    def action():
        if named is not None and format_of(given.file) != named:
            raise InputError(f"{given.file} is {format_of(given.file).upper()}, not {named.upper()}; leave out the word {named}")
        run(given)

    return guarded(action)

