# SPDX-License-Identifier: MIT
"""A sampled controller: at each sample a function of the time and of the angles and rates of joints returns the torques of motors, which
stay constant until the next sample."""

from dataclasses import replace

import numpy as np
import tandem


def run(mechanism: tandem.Mechanism, joints, controls, torques, end: float, period: float, rtol: float = 1e-8) -> tandem.Solution:
    """Joints have rotors, whose angles, up to half a revolution, are coordinates `JOINT_rotor.displacement`; controls are names of
    parameters."""
    parts, state = [], {}
    angle = rate = np.zeros(len(joints))
    for k in range(round(end/period)):
        values = torques(k*period, angle, rate)
        settings = {f"parameters.{name}": float(value) for name, value in zip(controls, values, strict=True)}
        part = mechanism.solve((k*period, (k + 1)*period), settings=settings, rtol=rtol, **state)
        rotors = [part.names.index(f"{joint}_rotor.displacement") for joint in joints]
        state = {"q": part.q[-1], "qd": part.qd[-1]}
        angle, rate = state["q"][rotors], state["qd"][rotors]
        parts.append(part)
    return replace(parts[-1], **{name: np.concatenate([getattr(part, name)[k > 0:] for k, part in enumerate(parts)])
                                 for name in ("t", "q", "qd", "qdd")})
