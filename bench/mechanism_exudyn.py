# SPDX-License-Identifier: MIT
"""The same bodies, joints and forces in Exudyn, from the scene and the start of tandem; see bench/mechanisms.py."""

import json
import math
import time

import exudyn
import numpy as np
from exudyn.itemInterface import (
    CoordinateConstraint,
    DistanceConstraint,
    Force,
    MarkerBodyMass,
    MarkerBodyPosition,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    MassPoint2D,
    NodeGenericODE2,
    NodePoint2D,
    NodeRigidBody2D,
    ObjectConnectorSpringDamper,
    ObjectGround,
    ObjectJointRollingDisc,
    ObjectKinematicTree,
    ObjectRigidBody2D,
    PrismaticJoint2D,
    RevoluteJoint2D,
    Torque,
)
from exudyn.utilities import RigidBodyInertia
from mechanism_cases import CASES, parameters, scene_of, value_of

GRAVITY = 9.81
#: Rows that a joint holds in axes whose third is its own, of a universal joint whose first two are its own.
HELD = {"revolute": [1, 1, 1, 1, 1, 0], "prismatic": [1, 1, 0, 1, 1, 1], "spherical": [1, 1, 1, 0, 0, 0],
        "universal": [1, 1, 1, 0, 0, 1]}
#: Reasons.
CANNOT = {"rattleback": "no rolling ellipsoid but by contact springs", "chaplygin_sphere": "no rolling sphere but by contact springs",
          "turntable": "no rolling sphere but by contact springs, no plane that turns"}


class System:
    """A mechanism under construction, and its measured quantities."""

    def __init__(self, start):
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.start = start
        self.ground = self.mbs.AddObject(ObjectGround(referencePosition=[0, 0, 0]))
        self.body, self.node = {"ground": self.ground}, {}

    def marker(self, name, place=(0.0, 0.0, 0.0), rigid=False):
        kind = MarkerBodyRigid if rigid else MarkerBodyPosition
        return self.mbs.AddMarker(kind(bodyNumber=self.body[name], localPosition=list(place)))

    def local(self, name, x, y):
        """A point of the world in a body of the plane."""
        if name == "ground":
            return x, y
        (bx, _), (by, _), (angle, _) = (self.start[f"{name}.{c}"] for c in ("x", "y", "angle"))
        c, s = math.cos(angle), math.sin(angle)
        return c*(x - bx) + s*(y - by), -s*(x - bx) + c*(y - by)

    def add_flat(self, name, mass, inertia, weighs=True):
        """A rigid body in the plane, in the reference configuration."""
        q, qd = zip(*(self.start[f"{name}.{c}"] for c in ("x", "y", "angle")))
        self.node[name] = self.mbs.AddNode(NodeRigidBody2D(referenceCoordinates=list(q), initialVelocities=list(qd)))
        self.body[name] = self.mbs.AddObject(ObjectRigidBody2D(physicsMass=mass, physicsInertia=inertia, nodeNumber=self.node[name]))
        if weighs:
            self.mbs.AddLoad(Force(markerNumber=self.marker(name), loadVector=[0, -GRAVITY*mass, 0]))

    def hinge(self, one, place_one, two, place_two):
        markers = [self.marker(name, (*place, 0.0)) for name, place in ((one, place_one), (two, place_two))]
        self.mbs.AddObject(RevoluteJoint2D(markerNumbers=markers))

    # Measured quantities.
    def point(self, name, place=(0, 0, 0)):
        return self.mbs.GetObjectOutputBody(self.body[name], exudyn.OutputVariableType.Position, list(map(float, place)))

    def rotation(self, name):
        return self.mbs.GetObjectOutputBody(self.body[name], exudyn.OutputVariableType.RotationMatrix, [0.0, 0, 0]).reshape(3, 3)

    def turned(self, name):
        return float(self.mbs.GetNodeOutput(self.node[name], exudyn.OutputVariableType.Coordinates)[2])


class Tree(System):
    """The pendulum in minimal coordinates."""

    def point(self, name, place=(0, 0, 0)):
        angle = float(np.atleast_1d(self.mbs.GetNodeOutput(self.node["bob"], exudyn.OutputVariableType.Coordinates))[0])
        return [-math.cos(angle), -math.sin(angle), 0]


def make_tree(start):
    system = Tree(start)
    system.node["bob"] = system.mbs.AddNode(NodeGenericODE2(
        referenceCoordinates=[0.0], initialCoordinates=[0.0], initialCoordinates_t=[0.0], numberOfODE2Coordinates=1))
    system.mbs.AddObject(ObjectKinematicTree(
        nodeNumber=system.node["bob"], jointTypes=[exudyn.JointType.RevoluteZ], linkParents=[-1],
        jointTransformations=exudyn.Matrix3DList([np.eye(3)]), jointOffsets=exudyn.Vector3DList([[0, 0, 0]]),
        linkInertiasCOM=exudyn.Matrix3DList([np.zeros((3, 3))]), linkCOMs=exudyn.Vector3DList([[-1.0, 0, 0]]), linkMasses=[1.0],
        gravity=[0, -GRAVITY, 0]))
    return system


def make_pendulum(start):
    system = System(start)
    node = system.mbs.AddNode(NodePoint2D(referenceCoordinates=[-1, 0]))
    system.body["bob"] = system.mbs.AddObject(MassPoint2D(physicsMass=1, nodeNumber=node))
    system.mbs.AddObject(DistanceConstraint(markerNumbers=[system.marker(name) for name in ("ground", "bob")], distance=1))
    system.mbs.AddLoad(Force(markerNumber=system.marker("bob"), loadVector=[0, -GRAVITY, 0]))
    return system


def make_four_bars(start):
    system = System(start)
    for name in dict.fromkeys(key.split(".")[0] for key in start):
        system.add_flat(name, 1.0, 1/12)
    for k in range(3):
        system.hinge("ground", (k, 0.0), f"upright{k + 1}", system.local(f"upright{k + 1}", k, 0.0))
    for k in range(2):
        for x, upright in ((k, f"upright{k + 1}"), (k + 1, f"upright{k + 2}")):
            system.hinge(f"coupler{k + 1}", system.local(f"coupler{k + 1}", x, 1.0), upright, system.local(upright, x, 1.0))
    return system


def make_andrews(start):
    scene = scene_of("a03_andrews")
    system, values = System(start), parameters(scene)
    for name, keys in scene["body"].items():
        system.add_flat(name, keys["mass"], keys["inertia"], weighs=False)
    for keys in scene["joint"].values():
        ends = keys["bodies"]
        if "at" in keys:
            place = value_of(keys["at"], values)
            system.hinge(ends[0], system.local(ends[0], *place), ends[1], system.local(ends[1], *place))
        else:
            system.hinge(*[part for name, place in (end.split(":") for end in ends) for part in (name, json.loads(place))])
    coil = scene["force"]["coil"]
    markers = [system.marker(name, (*json.loads(place), 0.0)) for name, place in (end.split(":") for end in coil["between"])]
    system.mbs.AddObject(ObjectConnectorSpringDamper(markerNumbers=markers, referenceLength=coil["length"],
                                                     stiffness=coil["stiffness"], damping=0))
    system.mbs.AddLoad(Torque(markerNumber=system.marker("k1", rigid=True), loadVector=[0, 0, 0.033]))
    return system


def make_slider_crank(start):
    system = System(start)
    for name, mass, inertia in (("crank", 0.12, 1e-4), ("rod", 0.5, 4e-3), ("slider", 2.0, 1e-3)):
        system.add_flat(name, mass, inertia)
    system.hinge("ground", (0, 0), "crank", (-0.04, 0))
    system.hinge("crank", (0.04, 0), "rod", (-0.15, 0))
    system.hinge("rod", (0.15, 0), "slider", (0, 0))
    system.mbs.AddObject(PrismaticJoint2D(markerNumbers=[system.marker("ground", (0.38, 0, 0), True), system.marker("slider", rigid=True)],
                                          axisMarker0=[1, 0, 0], normalMarker1=[0, 1, 0], constrainRotation=True))
    return system


def make_trailers(start):
    """An axle that does not slip sideways is the lateral row of a rolling disk. The steered one is on a body without mass, whose angle against
    the tractor is a function of time: in Exudyn one in Python, which it calls a few times a step."""
    scene, system = scene_of("trailers"), System(start)
    l, n = scene["parameters"]["l"], scene["parameters"]["n"]

    def axle(name, x):
        markers = [system.marker("ground", rigid=True), system.marker(name, (x, 0.0, 0.0), True)]
        system.mbs.AddObject(ObjectJointRollingDisc(markerNumbers=markers, constrainedAxes=[1, 0, 0], discRadius=0.3, discAxis=[0, 1, 0]))

    for k in range(n + 1):
        system.add_flat(f"car{k}", *(1000.0, 400.0) if k == 0 else (500.0, 200.0), weighs=False)
        axle(f"car{k}", -l/2)
        if k:
            system.hinge(f"car{k - 1}", (-l/2, 0), f"car{k}", (l/2, 0))
    (x, xd), (y, yd), (angle, rate) = (start[f"car0.{c}"] for c in ("x", "y", "angle"))
    system.start = start | {"fork.x": (x + l/2*math.cos(angle), xd), "fork.y": (y + l/2*math.sin(angle), yd + l/2*rate),
                            "fork.angle": (angle, rate + 0.5)}
    system.add_flat("fork", 0.0, 0.0, weighs=False)
    system.hinge("car0", (l/2, 0), "fork", (0, 0))
    axle("fork", 0.0)
    markers = [system.mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=system.node[name], coordinate=2)) for name in ("car0", "fork")]
    system.mbs.AddObject(CoordinateConstraint(markerNumbers=markers, offset=0.0,
                                              offsetUserFunction=lambda mbs, t, item, offset: 0.5*math.sin(t),
                                              offsetUserFunction_t=lambda mbs, t, item, offset: 0.5*math.cos(t)))
    return system


def inertia_of(keys, values):
    """Mass and the inertia's matrix; None for a point mass."""
    box = value_of(keys.get("shape", {}).get("box"), values) if "shape" in keys else None
    mass = keys["mass"] if "mass" in keys else keys["density"]*math.prod(box)
    if "inertia" not in keys and box is None:
        return mass, None
    if "inertia" not in keys:
        return mass, np.diag([mass*(sum(x*x for x in box) - own*own)/12 for own in box])
    xx, yy, zz, xy, xz, yz = [*value_of(keys["inertia"], values), 0, 0, 0][:6]
    return mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float)


def make_spatial(name):
    """A builder of a scene in space: its bodies, joints, wheels and springs."""
    def make(start):
        scene, system = scene_of(name), System(start)
        values = parameters(scene, CASES[name].settings)
        for body, keys in scene["body"].items():
            add_body(system, body, *inertia_of(keys, values), value_of(scene["gravity"]["vector"], values))
        for keys in scene.get("joint", {}).values():
            add_joint(system, keys, values)
        for keys in scene.get("force", {}).values():
            if keys["type"] == "spring":
                (one, place_one), (two, place_two) = ((*end.split(":"), "[0, 0, 0]")[:2] for end in keys["between"])
                system.mbs.CreateSpringDamper(itemNumbers=[system.body[one], system.body[two]], localPosition0=json.loads(place_one),
                                              localPosition1=json.loads(place_two), referenceLength=keys["length"],
                                              stiffness=keys["stiffness"], damping=keys["damping"])
        for keys in scene.get("wheel", {}).values():
            system.mbs.CreateRollingDisc(bodyNumbers=[system.ground, system.body[keys["at"]]], axisPosition=[0, 0, 0],
                                         axisVector=keys["axis"], discRadius=keys["radius"])
        return system
    return make


def add_body(system, name, mass, inertia, gravity):
    (x, xd), (y, yd), (z, zd) = (system.start[f"{name}.{c}"] for c in "xyz")
    if inertia is None:
        system.body[name] = system.mbs.CreateMassPoint(referencePosition=[x, y, z], initialVelocity=[xd, yd, zd], mass=mass,
                                                       gravity=gravity)
        return
    (e0, d0), (e1, d1), (e2, d2), (e3, d3) = (system.start[f"{name}.e{i}"] for i in range(4))
    e = np.array([[-e1, e0, -e3, e2], [-e2, e3, e0, -e1], [-e3, -e2, e1, e0]])
    g = np.array([[-e1, e0, e3, -e2], [-e2, -e3, e0, e1], [-e3, e2, -e1, e0]])
    system.body[name] = system.mbs.CreateRigidBody(
        referencePosition=[x, y, z], referenceRotationMatrix=e @ g.T, initialVelocity=[xd, yd, zd],
        initialAngularVelocity=list(2*e @ [d0, d1, d2, d3]), inertia=RigidBodyInertia(mass=mass, inertiaTensor=inertia), gravity=gravity)


def add_joint(system, keys, values):
    """Axes: the third is the joint's; of a universal joint the first is that of one body and the second that of the other."""
    at, bodies = value_of(keys["at"], values), [system.body[name] for name in keys["bodies"]]
    if keys["type"] == "spherical":
        system.mbs.CreateSphericalJoint(itemNumbers=bodies, position=at)
        return
    axis = np.array(value_of(keys["axis"], values), float)
    if keys["type"] == "universal":
        across = np.array(value_of(keys["across"], values), float)
        axes = np.transpose([axis, across, np.cross(axis, across)])
    else:
        one = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
        one /= np.linalg.norm(one)
        axes = np.transpose([one, np.cross(axis, one), axis])
    system.mbs.CreateGenericJoint(itemNumbers=bodies, position=at, rotationMatrixAxes=axes, constrainedAxes=HELD[keys["type"]])


MAKERS = {"a01_pendulum": make_pendulum, "a02_four_bars": make_four_bars, "a03_andrews": make_andrews, "slider_crank": make_slider_crank,
          "trailers": make_trailers,
          **{name: make_spatial(name) for name in ("a04_bricard", "a05_governor", "spatial_slider_crank", "bicycle", "mechanism_disk")}}


def run(name, method, steps, start, repeats):
    """Error and processor time; method is index 2 or 3, or "tree", whose `steps` is a tolerance."""
    case = CASES[name]
    best, error = math.inf, math.nan
    for _ in range(repeats):
        system = make_tree(start) if method == "tree" else MAKERS[name](start)
        system.mbs.Assemble()
        settings = exudyn.SimulationSettings()
        integration = settings.timeIntegration
        integration.endTime, integration.verboseMode = case.end, 0
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = case.end
        settings.displayComputationTime = False
        solver = exudyn.DynamicSolverType.GeneralizedAlpha
        if name == "a04_bricard":
            # Of its rows one is redundant.
            settings.linearSolverType = exudyn.LinearSolverType.EigenDense
            settings.linearSolverSettings.ignoreSingularJacobian = True
        if method == "tree":
            solver = exudyn.DynamicSolverType.DOPRI5
            integration.numberOfSteps, integration.automaticStepSize = 1, True
            integration.relativeTolerance = integration.absoluteTolerance = steps
        else:
            integration.numberOfSteps = steps
            alpha = integration.generalizedAlpha
            alpha.spectralRadius = 1.0 if method == 2 else 0.9
            alpha.useIndex2Constraints = alpha.useNewmark = method == 2
            integration.newton.useModifiedNewton = True
            integration.newton.relativeTolerance, integration.newton.absoluteTolerance = 1e-10, 1e-12
        begun = time.process_time()
        try:
            system.mbs.SolveDynamic(settings, solverType=solver)
        except Exception:
            return math.nan, math.inf
        best = min(best, time.process_time() - begun)
        error = float(np.max(np.abs(np.array(case.measure(system)) - case.reference)))
        if best > 1:
            break
    return error, best
