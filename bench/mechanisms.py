#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Mechanisms beside Exudyn: the true error at the end against the processor time of the integration alone.

Usage: bench/mechanisms.py [--repeats N] [NAME...]     a01_pendulum, a02_four_bars, a03_andrews; all without

Installs exudyn, numpy and h5py from PyPI into build/exudyn. The program is build/tandem, or what TANDEM names. Exudyn integrates the same
bodies, joints and forces with its generalised-alpha methods, index 2 and 3, of which the faster for its error counts; the pendulum also
in minimal coordinates as a kinematic tree with its explicit DOPRI5. References: doc/mechanism_gallery.md. Times are the
best of the repeats; prints a table, and for errors of 1e-3, 1e-6, 1e-9 the ratio of times, interpolated.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TANDEM = os.environ.get("TANDEM", str(ROOT / "build" / "tandem"))
PLACE = ROOT / "build" / "exudyn"
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
GRAVITY = 9.81
TARGETS = (1e-3, 1e-6, 1e-9)
#: End, and what is compared there with the reference.
CASES = {
    "a01_pendulum": (10.0, ["mass/position"], [-0.27508746257611686, -0.96141920509912506]),
    "a02_four_bars": (0.6, ["b0/position"], [0.884327595936854902, 0.466866900802083729]),
    "a03_andrews": (0.03, ["beta/angle", "Theta/angle", "gamma/angle", "Phi/angle", "delta/angle", "Omega/angle", "epsilon/angle"],
                    [15.810771195153707, -15.756371058411840, 0.040822240119645805, -0.53473011634207960, 0.52440996587995407,
                     0.53473011634207960, 1.0480807410419379]),
}


def enter():
    """Go on in an environment that has Exudyn."""
    python = PLACE / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(PLACE)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", "exudyn", "numpy", "h5py"], check=True)
    if Path(sys.prefix).resolve() != PLACE.resolve():
        os.execve(str(python), [str(python), __file__, *sys.argv[1:]], ENVIRONMENT)


def run_tandem(name, settings, folder, repeats):
    """Error and processor time of the integration; the file has a row at the end alone."""
    import h5py
    import numpy as np

    end, sensors, reference = CASES[name]
    target, best, error = Path(folder) / "out.h5", math.inf, math.nan
    words = [word for setting in (*settings, f"time.end={end}", f"output.interval={end}", 'output.fields=["q"]')
             for word in ("--set", setting)]
    for _ in range(repeats):
        done = subprocess.run([TANDEM, "run", name, *words, "--output", str(target), "--force", "--quiet", "--no-error"],
                              env=ENVIRONMENT, capture_output=True, text=True, cwd=ROOT)
        if done.returncode:
            return math.nan, math.inf
        with h5py.File(target) as file:
            found = np.concatenate([np.atleast_1d(file[f"sensors/{sensor}"][-1]) for sensor in sensors])[:len(reference)]
            best = min(best, float(file["report"].attrs["cpu_seconds"]))
            error = float(np.max(np.abs(found - reference)))
    return error, best


def start_of(name, folder):
    """The start as tandem draws it: {coordinate: (q, qd)}."""
    import h5py

    target = Path(folder) / "start.h5"
    subprocess.run([TANDEM, "run", name, "--set", "time.end=1e-9", "--output", str(target), "--force", "--quiet", "--no-error"],
                   env=ENVIRONMENT, check=True, cwd=ROOT)
    with h5py.File(target) as file:
        names = [text.decode().strip() if isinstance(text, bytes) else text.strip() for text in file["trajectory/q"].attrs["names"]]
        return dict(zip(names, zip(file["trajectory/q"][0], file["trajectory/qd"][0])))


def add_body(mbs, mass, inertia, state):
    """A rigid body in the plane with its weight; state is (x, y, angle) and its rates. Positions are displacements from the reference."""
    from exudyn.itemInterface import LoadForceVector, MarkerBodyMass, NodeRigidBody2D, ObjectRigidBody2D

    q, qd = zip(*state)
    node = mbs.AddNode(NodeRigidBody2D(referenceCoordinates=list(q), initialVelocities=list(qd)))
    return mbs.AddObject(ObjectRigidBody2D(physicsMass=mass, physicsInertia=inertia, nodeNumber=node)), node


def weigh(mbs, body, mass):
    from exudyn.itemInterface import Force, MarkerBodyMass

    mbs.AddLoad(Force(markerNumber=mbs.AddMarker(MarkerBodyPosition0(body)), loadVector=[0, -GRAVITY*mass, 0]))


def MarkerBodyPosition0(body, place=(0.0, 0.0, 0.0)):
    from exudyn.itemInterface import MarkerBodyPosition

    return MarkerBodyPosition(bodyNumber=body, localPosition=list(place))


def hinge(mbs, one, place_one, two, place_two):
    from exudyn.itemInterface import RevoluteJoint2D

    markers = [mbs.AddMarker(MarkerBodyPosition0(body, (*place, 0.0))) for body, place in ((one, place_one), (two, place_two))]
    mbs.AddObject(RevoluteJoint2D(markerNumbers=markers))


def make_pendulum(mbs, ground, folder):
    import exudyn
    from exudyn.itemInterface import DistanceConstraint, Force, MassPoint2D, NodePoint2D

    node = mbs.AddNode(NodePoint2D(referenceCoordinates=[-1, 0]))
    bob = mbs.AddObject(MassPoint2D(physicsMass=1, nodeNumber=node))
    mbs.AddObject(DistanceConstraint(markerNumbers=[mbs.AddMarker(MarkerBodyPosition0(body)) for body in (ground, bob)], distance=1))
    mbs.AddLoad(Force(markerNumber=mbs.AddMarker(MarkerBodyPosition0(bob)), loadVector=[0, -GRAVITY, 0]))
    return lambda: list(mbs.GetNodeOutput(node, exudyn.OutputVariableType.Position)[:2])


def make_tree(mbs, ground, folder):
    """The pendulum in minimal coordinates: one link that turns about z."""
    import exudyn
    import numpy as np
    from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree

    node = mbs.AddNode(NodeGenericODE2(referenceCoordinates=[0.0], initialCoordinates=[0.0], initialCoordinates_t=[0.0],
                                       numberOfODE2Coordinates=1))
    mbs.AddObject(ObjectKinematicTree(
        nodeNumber=node, jointTypes=[exudyn.JointType.RevoluteZ], linkParents=[-1],
        jointTransformations=exudyn.Matrix3DList([np.eye(3)]), jointOffsets=exudyn.Vector3DList([[0, 0, 0]]),
        linkInertiasCOM=exudyn.Matrix3DList([np.zeros((3, 3))]), linkCOMs=exudyn.Vector3DList([[-1.0, 0, 0]]), linkMasses=[1.0],
        gravity=[0, -GRAVITY, 0]))

    def place():
        angle = mbs.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates)
        angle = float(np.atleast_1d(angle)[0])
        return [-math.cos(angle), -math.sin(angle)]
    return place


def make_four_bars(mbs, ground, folder):
    import exudyn

    start, bodies = start_of("a02_four_bars", folder), {}
    for name in dict.fromkeys(key.split(".")[0] for key in start):
        bodies[name], node = add_body(mbs, 1.0, 1/12, [start[f"{name}.{c}"] for c in ("x", "y", "angle")])
        weigh(mbs, bodies[name], 1.0)
        angle = start[f"{name}.angle"][0]
        bodies[name] = (bodies[name], node, angle, start[f"{name}.x"][0], start[f"{name}.y"][0])

    def local(name, x, y):
        body, _, angle, bx, by = bodies[name]
        c, s = math.cos(angle), math.sin(angle)
        return body, (c*(x - bx) + s*(y - by), -s*(x - bx) + c*(y - by))

    for k in range(3):
        hinge(mbs, ground, (k, 0.0), *local(f"upright{k + 1}", k, 0.0))
    for k in range(2):
        hinge(mbs, *local(f"upright{k + 1}", k, 1.0), *local(f"coupler{k + 1}", k, 1.0))
        hinge(mbs, *local(f"coupler{k + 1}", k + 1, 1.0), *local(f"upright{k + 2}", k + 1, 1.0))
    body, place = local("upright1", 0.0, 1.0)
    return lambda: list(mbs.GetObjectOutputBody(body, exudyn.OutputVariableType.Position, [*place, 0.0])[:2])


def make_andrews(mbs, ground, folder):
    import tomllib

    import exudyn
    from exudyn.itemInterface import ObjectConnectorSpringDamper, Torque

    scene = tomllib.loads((ROOT / "scenes" / "a03_andrews.toml").read_text())
    start, bodies, angles = start_of("a03_andrews", folder), {}, {}
    for name, keys in scene["body"].items():
        bodies[name], angles[name] = add_body(mbs, keys["mass"], keys["inertia"], [start[f"{name}.{c}"] for c in ("x", "y", "angle")])

    def local(name, x, y):
        if name == "ground":
            return ground, (x, y)
        (bx, _), (by, _), (angle, _) = (start[f"{name}.{c}"] for c in ("x", "y", "angle"))
        c, s = math.cos(angle), math.sin(angle)
        return bodies[name], (c*(x - bx) + s*(y - by), -s*(x - bx) + c*(y - by))

    values = {}
    for key, value in scene["parameters"].items():
        values[key] = value if not isinstance(value, str) else eval(value, {"cos": math.cos, "sin": math.sin}, values)
    for keys in scene["joint"].values():
        ends = keys["bodies"]
        if "at" in keys:
            x, y = (eval(str(entry), {}, values) for entry in keys["at"])
            hinge(mbs, *local(ends[0], x, y), *local(ends[1], x, y))
        else:
            sides = [end.split(":") for end in ends]
            hinge(mbs, *[part for name, place in sides for part in (bodies[name], tuple(json.loads(place)))])
    coil = scene["force"]["coil"]
    markers = [mbs.AddMarker(MarkerBodyPosition0(bodies.get(name, ground), (*json.loads(place), 0.0)))
               for name, place in (end.split(":") for end in coil["between"])]
    mbs.AddObject(ObjectConnectorSpringDamper(markerNumbers=markers, referenceLength=coil["length"], stiffness=coil["stiffness"], damping=0))
    from exudyn.itemInterface import MarkerBodyRigid
    mbs.AddLoad(Torque(markerNumber=mbs.AddMarker(MarkerBodyRigid(bodyNumber=bodies["k1"])), loadVector=[0, 0, 0.033]))

    def measured():
        turned = {name: float(mbs.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates)[2]) for name, node in angles.items()}
        of = lambda one, two, zero: turned[two] - (turned[one] if one else 0) + zero
        return [of(None, "k1", values["beta"]), of("k1", "k2", 0), of(None, "k3", values["gamma"]), of("k5", "k4", values["phi"]),
                of(None, "k5", values["delta"]), of("k7", "k6", values["omega"]), of(None, "k7", values["epsilon"])]
    return measured


MAKERS = {"a01_pendulum": make_pendulum, "a02_four_bars": make_four_bars, "a03_andrews": make_andrews}


def run_exudyn(name, method, steps, folder, repeats):
    """Error and processor time; method is index 2 or 3, or "tree"."""
    import exudyn
    import numpy as np

    end, _, reference = CASES[name]
    best, error = math.inf, math.nan
    for _ in range(repeats):
        system = exudyn.SystemContainer()
        mbs = system.AddSystem()
        from exudyn.itemInterface import ObjectGround

        ground = mbs.AddObject(ObjectGround(referencePosition=[0, 0, 0]))
        measured = (make_tree if method == "tree" else MAKERS[name])(mbs, ground, folder)
        mbs.Assemble()
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.endTime = end
        settings.timeIntegration.verboseMode = 0
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = end
        settings.displayComputationTime = False
        solver = exudyn.DynamicSolverType.GeneralizedAlpha
        if method == "tree":
            solver = exudyn.DynamicSolverType.DOPRI5
            settings.timeIntegration.numberOfSteps = 1
            settings.timeIntegration.automaticStepSize = True
            settings.timeIntegration.relativeTolerance = settings.timeIntegration.absoluteTolerance = steps
        else:
            settings.timeIntegration.numberOfSteps = steps
            alpha = settings.timeIntegration.generalizedAlpha
            alpha.spectralRadius = 1.0 if method == 2 else 0.9
            alpha.useIndex2Constraints = alpha.useNewmark = method == 2
            settings.timeIntegration.newton.useModifiedNewton = True
            settings.timeIntegration.newton.relativeTolerance = 1e-10
            settings.timeIntegration.newton.absoluteTolerance = 1e-12
        begun = time.process_time()
        try:
            exudyn.SolveDynamic(mbs, settings, solverType=solver, showHints=False) if False else mbs.SolveDynamic(settings, solverType=solver)
        except Exception:
            return math.nan, math.inf
        best = min(best, time.process_time() - begun)
        error = float(np.max(np.abs(np.array(measured()) - reference)))
    return error, best


def time_at(points, target):
    """The least time with an error of at most the target, log-linear between neighbours; infinite where none gets there."""
    good = [t for error, t in points if error <= target]
    if not good:
        return math.inf
    best = min(good)
    for (e1, t1), (e2, t2) in zip(points, points[1:]):
        if e1 > target >= e2 > 0 and t1 < t2:
            share = math.log(e1/target)/math.log(e1/e2)
            best = min(best, t1*(t2/t1)**share)
    return best


def main(words):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args(words)
    print("| mechanism | solver | setting | true error | CPU time, s |\n|---|---|---|---|---|")
    summary = []
    with tempfile.TemporaryDirectory() as folder:
        for name in given.names or CASES:
            times = {}
            for stepper in ("dopri5", "dop853"):
                points = []
                for k in range(3, 13):
                    settings = [f'solver.stepper="{stepper}"', f"solver.rtol=1e-{k}", f"solver.atol=1e-{k}", 'solver.projection="step_ends"',
                                'solver.chart="adaptive"']
                    points.append(run_tandem(name, settings, folder, given.repeats))
                    print(f"| {name} | tandem {stepper} | rtol 1e-{k} | {points[-1][0]:.1e} | {points[-1][1]:.4f} |", flush=True)
                times[stepper] = points
            methods = {"exudyn, index 3": 3, "exudyn, index 2": 2} | ({"exudyn, tree, DOPRI5": "tree"} if name == "a01_pendulum" else {})
            for label, method in methods.items():
                points = []
                for k in range(0, 8):
                    steps = 10.0**-(k + 4) if method == "tree" else 100*4**k
                    points.append(run_exudyn(name, method, steps, folder, given.repeats))
                    setting = f"tolerance {steps:.0e}" if method == "tree" else f"{steps} steps"
                    print(f"| {name} | {label} | {setting} | {points[-1][0]:.1e} | {points[-1][1]:.4f} |", flush=True)
                    if points[-1][1] > 20:
                        break
                times[label] = points
            for target in TARGETS:
                ours = min(time_at(times[label], target) for label in ("dopri5", "dop853"))
                theirs = min(time_at(times[label], target) for label in methods)
                summary.append((name, target, ours, theirs))
    print("\n| mechanism | error | tandem, s | Exudyn, s | Exudyn / tandem |\n|---|---|---|---|---|")
    for name, target, ours, theirs in summary:
        shown = f"{theirs:.4f} | {theirs/ours:.1f}" if math.isfinite(theirs) else "not reached | "
        print(f"| {name} | {target:.0e} | {ours:.4f} | {shown} |")
    return 0


if __name__ == "__main__":
    enter()
    sys.exit(main(sys.argv[1:]))
