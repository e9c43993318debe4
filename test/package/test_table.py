# SPDX-License-Identifier: MIT
"""Tables of sweeps in Python, against the comma-separated values that the program writes beside them."""

import csv
import tempfile
import unittest
from pathlib import Path

import h5py
import numpy as np
import tandem

SWEEP = """
[sweep]
scene = "rolling_disk"
set = ["time.end=0.02"]
[[vary]]
key = "model.mass"
values = [5.0, 10.0, 15.0]
unit = "kg"
[[vary]]
key = "solver.stepper"
values = ["rk4", "dopri5"]
[[vary]]
key = "solver.max_steps"
values = [3, 1000]
[[keep]]
quantity = "rz"
take = "min"
[[keep]]
quantity = "qd:a2"
name = "spin"
at = [0.0, 0.01, 0.02]
[[keep]]
quantity = "figure:steps"
"""

INDICES = """
[sweep]
scene = "rolling_disk"
set = ["time.end=0.01"]
draws = 8
indices = true
[[vary]]
key = "model.mass"
uniform = [9.0, 11.0]
[[vary]]
key = "initial.tilt"
uniform = [0.0, 0.2]
[[keep]]
quantity = "rz"
"""


class Tables(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.scratch.name)
        for name, text in (("disks", SWEEP), ("indices", INDICES), ("late", SWEEP.replace("0.02]\n[[keep", "0.02, 1.0]\n[[keep"))):
            (cls.folder / f"{name}.toml").write_text(text)
            tandem.run_program("sweep", cls.folder / f"{name}.toml", "--output", cls.folder / f"{name}.h5", "--quiet", "--jobs", 1)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def setUp(self):
        self.table = tandem.read_table(self.folder / "disks.h5")
        with open(self.folder / "disks.csv", newline="") as file:
            self.rows = list(csv.DictReader(file))

    def test_columns_are_those_of_the_csv(self):
        table = self.table
        self.assertEqual(len(table), 12)
        self.assertEqual(table.names, ["model.mass", "solver.max_steps", "solver.stepper", "rz_min", "spin", "steps"])
        np.testing.assert_array_equal(table.case, [int(row["case"]) for row in self.rows])
        self.assertEqual(list(table["solver.stepper"]), [row["solver.stepper"] for row in self.rows])
        for name in ("model.mass", "rz_min", "steps"):
            np.testing.assert_array_equal(table[name], [float(row[name] or "nan") for row in self.rows], name)
        times = table.outputs["spin"].times
        np.testing.assert_array_equal(times, [0.0, 0.01, 0.02])
        self.assertEqual(table["spin"].shape, (12, 3))
        heads = [head for head in self.rows[0] if head.startswith("spin@")]
        for j, head in enumerate(heads):
            np.testing.assert_array_equal(table["spin"][:, j], [float(row[head] or "nan") for row in self.rows])

    def test_units_and_what_was_kept(self):
        table = self.table
        self.assertEqual([table.unit(name) for name in ("model.mass", "rz_min", "spin", "steps")], ["kg", "m", "m/s", ""])
        self.assertEqual((table.outputs["rz_min"].key, table.outputs["rz_min"].take), ("rz", "min"))
        self.assertEqual(table.inputs["solver.stepper"].key, "solver.stepper")

    def test_cases_that_failed(self):
        table = self.table
        failed = [row["status"] != "ok" for row in self.rows]
        np.testing.assert_array_equal(~table.done, failed)
        self.assertEqual(sorted(table.messages), [int(row["case"]) for row in self.rows if row["status"] != "ok"])
        for row in self.rows:
            if row["status"] != "ok":
                self.assertEqual(table.messages[int(row["case"])], (row["status"], row["message"]))
        self.assertTrue(np.isfinite(table["rz_min"][table.done]).all())
        self.assertTrue(np.isnan(table["rz_min"][~table.done]).all())

    def test_xarray(self):
        data = self.table.to_xarray()
        self.assertEqual(dict(data.sizes), {"case": 12, "spin_time": 3})
        self.assertEqual(data["rz_min"].attrs["units"], "m")
        self.assertEqual(data["model.mass"].attrs, {"units": "kg", "key": "model.mass"})
        self.assertEqual(data["spin"].dims, ("case", "spin_time"))
        chosen = data.where((data["model.mass"] == 10.0) & (data["solver.stepper"] == "rk4") & (data.status == 0), drop=True)
        row = next(row for row in self.rows if row["model.mass"].startswith("1.000") and row["solver.stepper"] == "rk4"
                   and row["status"] == "ok")
        np.testing.assert_array_equal(chosen["rz_min"].values, [float(row["rz_min"])])
        self.assertEqual(data.attrs["cases"], 12)
        self.assertIn("[[keep]]", data.attrs["sweep"])

    def test_indices(self):
        indices = tandem.read_table(self.folder / "indices.h5").indices
        self.assertEqual(list(indices), ["rz_end"])
        one = indices["rz_end"]
        self.assertEqual(one.inputs, ["model.mass", "initial.tilt"])
        self.assertEqual(one.blocks, 8)
        with h5py.File(self.folder / "indices.h5") as file:
            np.testing.assert_array_equal(np.stack([one.first, one.first_error, one.total, one.total_error], 1),
                                          file["indices/rz_end"][()])
        # The height hardly depends on the mass.
        self.assertLess(one.total[0], 0.1*one.total[1])

    def test_bands_leave_out_times_that_no_case_reaches(self):
        from tandem.plot import bands

        self.assertEqual(len(tandem.read_table(self.folder / "late.h5").outputs["spin"].times), 4)
        self.assertEqual(list(bands(self.folder / "late.h5").axes[0].lines[0].get_xdata()), [0.0, 0.01, 0.02])

    def test_what_is_no_table(self):
        with self.assertRaisesRegex(KeyError, "there is no column 'mass'; there are model.mass, "):
            self.table["mass"]
        run = self.folder / "run.h5"
        tandem.run_scene("rolling_disk", {"time.end": 0.01}, run)
        with self.assertRaisesRegex(ValueError, "is no table of tandem sweep"):
            tandem.read_table(run)
        with self.assertRaisesRegex(FileNotFoundError, "there is no file"):
            tandem.read_table(self.folder / "none.h5")
        damaged = self.folder / "damaged.h5"
        damaged.write_bytes((self.folder / "disks.h5").read_bytes())
        with h5py.File(damaged, "a") as file:
            del file["failures/message"]
        with self.assertRaisesRegex(ValueError, "is no whole table"):
            tandem.read_table(damaged)

    def test_it_shows_itself(self):
        self.assertRegex(repr(self.table), r"<tandem.Table disks: 6 of 12 cases done, inputs model.mass, .*outputs rz_min, ")


if __name__ == "__main__":
    unittest.main()
