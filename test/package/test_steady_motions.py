# SPDX-License-Identifier: MIT
"""Steady motions in the process of a caller: a bob on a string that turns about the vertical."""

import unittest

import numpy as np
import tandem

BOB = {"gravity.vector": [0, 0, -9.81], "body.bob.mass": 1.0, "body.bob.position": [0.6, 0, -0.8], "body.bob.velocity": [0, 2.2, 0],
       "constraint.string.type": "distance", "constraint.string.between": ["ground", "bob"], "time.end": 1.0}


class SteadyMotions(unittest.TestCase):
    def bob(self, **settings):
        bob = tandem.Mechanism()
        for key, value in (BOB | settings).items():
            bob[key] = value
        return bob

    def test_a_rate_is_held(self):
        run = self.bob().simulation()
        q, qd = run.find_steady_motion(["any", "world.rotation_z=4"])
        # g = w^2 h.
        self.assertAlmostEqual(q[2], -9.81/16, delta=1e-12)
        np.testing.assert_allclose(qd, np.cross([0, 0, 4], q), atol=1e-12)
        again = run.find_steady_motion("any world.rotation_z=4")
        np.testing.assert_array_equal(again, (q, qd))
        np.testing.assert_array_equal(run.state.q, [0.6, 0, -0.8])
        with self.assertRaisesRegex(tandem.InvalidInput, "not a number"):
            run.find_steady_motion("world.rotation_z=fast")

    def test_a_start_there(self):
        solution = self.bob(**{"initial.steady": ["any", "world.rotation_z=4"]}).solve(rtol=1e-10)
        np.testing.assert_allclose(solution.q[:, 2], -9.81/16, atol=1e-9)


if __name__ == "__main__":
    unittest.main()
