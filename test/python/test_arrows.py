# SPDX-License-Identifier: MIT
"""tools/arrows.py: which folder uses which, whether two use each other, and whether CONTRIBUTING.md shows it; imports of the package for
Python."""

import ast
import graphlib
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import arrows  # noqa: E402

SOURCES = {
    "src/tandem.f90": "module tandem\n    use tandem_run, only: run_type\nend module tandem\n",
    "src/tandem/kinds.f90": "module tandem_kinds\n    use, intrinsic :: iso_fortran_env, only: real64\nend module tandem_kinds\n",
    "src/tandem/run/run.f90": "module tandem_run\n    use tandem_chart, only: a\nend module tandem_run\n",
    "src/tandem/run/steps.f90": "submodule(tandem_run) tandem_run_steps\n    USE tandem_kinds, only: wp\nend submodule tandem_run_steps\n",
    "src/tandem/chart/chart.f90": "module tandem_chart\n    use tandem_kinds, only: wp\nend module tandem_chart\n",
    "io/src/tandem_io.f90": "module tandem_io\n    use tandem_io_scene, only: scene\nend module tandem_io\n",
    "io/src/tandem_io/scene.f90": "module tandem_io_scene\n    use tandem_io_scene_text, only: b\nend module tandem_io_scene\n",
    "io/src/tandem_io/scene/text.f90": "module tandem_io_scene_text\n    use tandem, only: c\nend module tandem_io_scene_text\n",
}


class Arrows(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        for name, text in SOURCES.items():
            self.put(name, text)
        self.put(arrows.PAGE, "The map.\n\n" + arrows.BEGIN + arrows.END + "\nThe rest.\n")

    def put(self, name, text):
        (self.root / name).parent.mkdir(parents=True, exist_ok=True)
        (self.root / name).write_text(text)

    def test_arrows_are_those_of_the_sources(self):
        found = {(one, other) for one, others in arrows.find_arrows(self.root).items() for other in others}
        self.assertEqual(found, {("tandem.f90", "run"), ("run", "chart"), ("run", "base"), ("chart", "base"), ("io", "io/scene"),
                                 ("io/scene", "tandem.f90")})

    def test_an_arrow_that_follows_from_others_is_left_out(self):
        drawing = arrows.draw(arrows.find_arrows(self.root))
        self.assertIn("    run --> chart\n", drawing)
        self.assertNotIn("run --> base", drawing)

    def test_a_drawing_is_kept(self):
        self.assertIn("tools/arrows.py write", arrows.problems(self.root)[0])
        arrows.write(self.root)
        self.assertEqual(arrows.problems(self.root), [])
        text = (self.root / arrows.PAGE).read_text()
        self.assertTrue(text.startswith("The map.\n") and text.endswith("\nThe rest.\n"), text)
        self.put("src/tandem/run/other.f90", "module tandem_run_other\n    use tandem_new, only: d\nend module tandem_run_other\n")
        self.put("src/tandem/new/new.f90", "module tandem_new\nend module tandem_new\n")
        self.assertEqual(len(arrows.problems(self.root)), 1)

    def test_a_circle_is_refused(self):
        arrows.write(self.root)
        self.put("src/tandem/chart/other.f90", "module tandem_chart_other\n    use tandem_run, only: e\nend module tandem_chart_other\n")
        told, = arrows.problems(self.root)
        self.assertIn("chart uses run in src/tandem/chart/other.f90", told)
        self.assertIn("run uses chart in src/tandem/run/run.f90", told)

    def test_the_folders_of_this_project_use_each_other_one_way(self):
        self.assertEqual(arrows.problems(), [])


class Package(unittest.TestCase):
    @staticmethod
    def imports(root):
        """Modules that each module of a package imports, also within functions."""
        modules = {(*path.relative_to(root).parts[:-1], path.stem): path for path in root.rglob("*.py")}
        used = {}
        for name, path in modules.items():
            used[name] = set()
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom) and node.level:
                    base = (*name[:len(name) - node.level], *(node.module or "").split(".")) if node.module else name[:len(name) - node.level]
                    for one in node.names:
                        found = [(*base, one.name), (*base, one.name, "__init__"), base, (*base, "__init__")]
                        used[name] |= {next((module for module in found if module in modules), name)} - {name}
        return used

    def test_modules_import_each_other_one_way(self):
        imports = self.imports(ROOT / "python" / "src" / "tandem")
        self.assertIn(("plot", "__init__"), imports["show",])
        tuple(graphlib.TopologicalSorter(imports).static_order())

    def test_a_circle_of_modules_is_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "one.py").write_text("from .two import b\n")
            Path(folder, "two.py").write_text("def b():\n    from . import one\n")
            with self.assertRaises(graphlib.CycleError):
                tuple(graphlib.TopologicalSorter(self.imports(Path(folder))).static_order())


if __name__ == "__main__":
    unittest.main()
