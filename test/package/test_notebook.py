# SPDX-License-Identifier: MIT
"""The tutorial runs from its first cell to its last, and shows what it should."""

import unittest

import nbclient
import nbformat
from models import ROOT


class Tutorial(unittest.TestCase):
    def test_it_runs(self):
        notebook = nbformat.read(ROOT / "python" / "tutorial.ipynb", as_version=4)
        self.assertFalse(any(cell.get("outputs") for cell in notebook.cells), "outputs are not kept in the repository")
        nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
        shown = [output.data for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
        pages = [data["text/html"] for data in shown if "text/html" in data]
        self.assertTrue(any("data:image/png" in page for page in pages))
        self.assertTrue(any("<iframe srcdoc=" in page for page in pages))
        self.assertTrue(any("image/png" in data for data in shown))


if __name__ == "__main__":
    unittest.main()
