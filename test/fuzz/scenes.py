# SPDX-License-Identifier: MIT
"""The scenes to be mutated: the shipped ones, and some with the tables and keys that those do not use. All are valid."""

EVENTS = """\
[scene]
name = "events"
description = "a disk that is watched"
model = "rolling_disk"

[initial]
tilt = 0.1

[time]
start = -1.0
end = 2.5

[solver]
stepper = "dopri5"
rtol = 1e-8
atol = 1e-9
max_step = 0.5
chart = "adaptive"
max_events = 10

[output]
file = "watched.h5"
interval = 0.25
fields = ["q", "qd", "lambda", "kinetic_energy", "potential_energy"]

[[event]]
name = "low"
watch = "rz"
value = 0.9
direction = "falling"
action = "stop"

[[event]]
name = "push"
watch = "lambda:contact height"
"""

ASSEMBLED = """\
scene = { model = "articulated_vehicle", description = "a start that is assembled" }

[model]
amplitude = 0.02
mass = 1_000.0

[initial]
speed = 20
assemble = true
fixed = ["x1", "y1"]
fixed_velocities = ["x1"]
velocity_metric = "mass"
largest_move = 0.5

[time]
end = 1e1

[solver]
stepper = "sdirk54"
rtol = [1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6]
atol_qd = 1e-7
first_step = 1e-4
"""

STATE = """\
[scene]
model = 'rolling_disk'
description = '''
at rest'''

[initial]
q = [
    0.0, 0.0, 1.0, # m
    1.0, 0, 0, 0,
    0.0, -1.0,
]
qd = [0, 0, 0, 0, 0, 0, 0, 0, 0]

[time]
end = 0x10

[solver]
stepper = "trapezoid"
step = 1e-2
projection = "stages"
refresh = "refine"
basis = "svd"
chart = "paper"
constraint_tolerance = 1e-11
utol = 1e-13
Btol = 1e-12
Htol = 1e-12
intol = 1e-12
v_limit = 0.3
w_limit = 0.4
condition_limit = 10
iteration_limit = 5
start_tolerance = 1e-7
max_steps = 10000
max_evaluations = 1_000_000
max_seconds = 60
"""


def all_scenes(folder):
    """The texts, the shipped ones first."""
    texts = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.toml"))]
    return [*texts, EVENTS, ASSEMBLED, STATE]
