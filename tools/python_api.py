# SPDX-License-Identifier: MIT
"""The public names of the package for Python with their docstrings, as a page of the site; read from the sources, without running them."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent / "python" / "src" / "tandem"
FILES = ["model.py", "solve.py", "simulation.py", "problem.py", "mechanism.py", "program.py", "result.py", "table.py", "errors.py",
         "plot/pictures.py", "plot/style.py", "viewer/__init__.py", "viewer/drawing.py"]


def public_names(file):
    """Names in __all__ of a package."""
    for node in ast.parse((PACKAGE / file).read_text()).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


def signature(node):
    arguments = ast.unparse(node.args)
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"{node.name}({arguments.removeprefix('self, ').removeprefix('self').removeprefix('cls, ')}){returns}"


def entry(node, level, prefix=""):
    """Lines of a class or a function; methods and properties follow their class."""
    is_class = isinstance(node, ast.ClassDef)
    lines = [f"{'#' * level} {prefix}{node.name}", "", "```python"]
    is_property = not is_class and any(getattr(one, "id", "") == "property" for one in node.decorator_list)
    lines += [f"class {node.name}({', '.join(map(ast.unparse, node.bases))})".replace("()", "") if is_class
              else node.name if is_property else signature(node), "```", "", "```text", ast.get_docstring(node) or "", "```", ""]
    if is_class:
        for one in node.body:
            if isinstance(one, ast.FunctionDef) and not one.name.startswith("_") and ast.get_docstring(one):
                lines += entry(one, level + 1, f"{node.name}.")
    return lines


def page():
    """The page as Markdown."""
    names = public_names("__init__.py") | public_names("plot/__init__.py") | public_names("viewer/__init__.py")
    lines = ["# The package for Python, name by name", "", "[Python, pictures, pages](python.md) is the guide.", ""]
    for file in FILES:
        for node in ast.parse((PACKAGE / file).read_text()).body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name in names and ast.get_docstring(node):
                lines += entry(node, 2, "plot." if file.startswith("plot") else "")
    return "\n".join(lines)
