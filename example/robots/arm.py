# SPDX-License-Identifier: MIT
"""The arm of arm.urdf reaches two angles by a torque controller that knows its weight."""

import control
import numpy as np
import tandem
from tandem.imports import convert

text, lost = convert("arm.urdf")
arm = tandem.Mechanism.from_toml(text)
joints, wanted = ["shoulder", "elbow"], np.array([0.8, -1.2])
for joint in joints:
    # A motor: a rotor, whose angle is a coordinate, and a torque between the two links.
    arm[f"joint.{joint}.rotor_inertia"] = 0.05
    arm[f"parameters.torque_{joint}"] = 0.0
    arm.add(f"force.{joint}_motor", type="torsion", joint=joint, law=f"torque_{joint}")


def torques(t, angle, rate):
    """Springs and dampers towards the wanted angles, and the torques that carry the arm."""
    lower = 2*9.81*0.15*np.sin(angle[0] + angle[1])
    upper = (4*0.2 + 2*0.4)*9.81*np.sin(angle[0]) + lower
    return 150*(wanted - angle) - 25*rate - [upper, lower]


motion = control.run(arm, joints, ["torque_shoulder", "torque_elbow"], torques, end=2.0, period=0.005)
reached = np.array([motion[f"{joint}_rotor.displacement"][-1] for joint in joints])
print("angles at the end:", reached, "error:", np.abs(reached - wanted).max())
tandem.view(motion, "arm.html")
