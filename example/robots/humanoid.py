# SPDX-License-Identifier: MIT
"""The humanoid of humanoid.xml hangs on a bar and swings, because its controller moves hips and knees."""

import control
import numpy as np
import tandem
from tandem.imports import convert

text, lost = convert("humanoid.xml")
humanoid = tandem.Mechanism.from_toml(text)
joints = ["hip_left", "hip_right", "knee_left", "knee_right"]


def torques(t, angle, rate):
    """Springs and dampers towards a moving posture."""
    swing = np.sin(2*np.pi*0.4*t)
    return 100*(np.array([-0.6*swing, -0.6*swing, 0.5*(1 - swing), 0.5*(1 - swing)])*min(1, t) - angle) - 8*rate


motion = control.run(humanoid, joints, [f"ctrl_{joint}" for joint in joints], torques, end=3.0, period=0.01, rtol=1e-6)
sides = np.hypot(motion["shin_left.x"] - motion["shin_right.x"], motion["shin_left.z"] - motion["shin_right.z"])
print("trunk at the end, x and z:", motion["trunk.x"][-1], motion["trunk.z"][-1])
print("largest difference between both sides:", sides.max())
tandem.view(motion, "humanoid.html")
