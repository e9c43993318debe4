# SPDX-License-Identifier: MIT
"""python3 -m tandem plot | view | import urdf | mjcf FILE...: what the program `tandem` calls."""

from __future__ import annotations

import argparse
import sys


def main(words: list[str] | None = None) -> int:
    """The exit code: 0 done, 2 the input was wrong."""
    words = sys.argv[1:] if words is None else words
    if words[:1] == ["import"]:
        # Without what pictures need.
        from . import mjcf, urdf

        return (mjcf if words[1:2] == ["mjcf"] else urdf).main(words[1:])
    parser = argparse.ArgumentParser(prog="tandem", description="Pictures of result files, and pages that play them.")
    commands = parser.add_subparsers(dest="command", required=True)
    from .plot import command as plot_command
    from .viewer import command as view_command

    plot_command.add_arguments(commands.add_parser("plot", help="pictures of result files", description=plot_command.__doc__,
                                                   formatter_class=argparse.RawDescriptionHelpFormatter))
    view_command.add_arguments(commands.add_parser("view", help="a page that plays the motion, and a .glb",
                                                   description=view_command.__doc__,
                                                   formatter_class=argparse.RawDescriptionHelpFormatter))
    given = parser.parse_args(words)
    try:
        return {"plot": plot_command.run, "view": view_command.run}[given.command](given)
    except (OSError, ValueError, KeyError, ModuleNotFoundError) as error:
        message = error.args[0] if isinstance(error, KeyError) and error.args else error
        print(f"tandem: {message}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
