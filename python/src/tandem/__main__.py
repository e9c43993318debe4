# SPDX-License-Identifier: MIT
"""python3 -m tandem plot | view | import FILE...: called by the program `tandem`."""

from __future__ import annotations

import argparse
import sys


def main(words: list[str] | None = None) -> int:
    """Exit code: 0 success, 2 invalid input."""
    words = sys.argv[1:] if words is None else words
    if words[:1] == ["import"]:
        # Without what pictures need.
        from . import imports

        return imports.main(words[1:])
    parser = argparse.ArgumentParser(prog="tandem", description="Plots and animations of result files.")
    commands = parser.add_subparsers(dest="command", required=True)
    from .plot import command as plot_command
    from .viewer import command as view_command

    plot_command.add_arguments(commands.add_parser("plot", help="plots of result files", description=plot_command.__doc__,
                                                   formatter_class=argparse.RawDescriptionHelpFormatter))
    view_command.add_arguments(commands.add_parser("view", help="animation for browsers, and a .glb",
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
