# SPDX-License-Identifier: MIT
"""The mechanisms of bench/mechanisms.py: compared quantities, times and references, and their parts as numbers."""

import cmath
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FUNCTIONS = {name: getattr(math, name) for name in ("sin", "cos", "acos", "sqrt", "pi")}


@dataclass
class Case:
    """`measure` takes an object with point(body, place), rotation(body), spin(body) in the body's axes, and turned(body) since the
        start in the plane. Without a reference it is a run of tandem with dop853 at 1e-13, and its distance from one of radau5 at 1e-12
        is reported."""

    end: float
    measure: object
    reference: list | None = None
    settings: tuple = ()


def cranked(angle):
    """Slider-crank: position of the slider, and speeds of the parts for one rad/s as pairs of mass and square."""
    r, length = 0.08, 0.3
    tilt = cmath.asin(-r/length*cmath.sin(angle))
    turn = -r/length*cmath.cos(angle)/cmath.cos(tilt)
    slide = -r*cmath.sin(angle) - length*cmath.sin(tilt)*turn
    rod = (-r*cmath.sin(angle) - length/2*cmath.sin(tilt)*turn)**2 + (r*cmath.cos(angle) + length/2*cmath.cos(tilt)*turn)**2
    inertia = 0.12*(r/2)**2 + 1e-4 + 0.5*rod + 4e-3*turn**2 + 2*slide**2
    height = 0.12*r/2*cmath.sin(angle) + 0.5*(r*cmath.sin(angle) + length/2*cmath.sin(tilt))
    return r*cmath.cos(angle) + length*cmath.cos(tilt), inertia, 9.81*height


def slider_crank(end, speed):
    """Position of the slider: one degree of freedom, m(a) a'' + m'(a) a'^2/2 + V'(a) = 0, derivatives by complex steps, DOP853 of SciPy."""
    from scipy.integrate import solve_ivp

    def rate(_, state):
        _, inertia, potential = cranked(state[0] + 1e-30j)
        return [state[1], -(inertia.imag/1e-30*state[1]**2/2 + potential.imag/1e-30)/inertia.real]

    angle = solve_ivp(rate, (0, end), [0, speed], method="DOP853", rtol=1e-13, atol=1e-14).y[0, -1]
    return [cranked(angle)[0].real]


def andrews(at):
    values = parameters(scene_of("a03_andrews"))

    def of(one, two, zero):
        return at.turned(two) - (at.turned(one) if one else 0) + zero

    return [of(None, "k1", values["beta"]), of("k1", "k2", 0), of(None, "k3", values["gamma"]), of("k5", "k4", values["phi"]),
            of(None, "k5", values["delta"]), of("k7", "k6", values["omega"]), of(None, "k7", values["epsilon"])]


def turntable(end):
    alpha = 3.0*0.4/1.4
    place = 0.5 - 0.3j + (0.4 + 0.7j)*(cmath.exp(1j*alpha*end) - 1)/(1j*alpha)
    return [place.real, place.imag]


#: References: closed forms, the sheets of the IFToMM with digits that were computed for this project, the IVP test set (the tests have them too).
CASES = {
    "a01_pendulum": Case(10.0, lambda at: at.point("bob")[:2], [-0.27508746257611686, -0.96141920509912506]),
    "a02_four_bars": Case(0.6, lambda at: at.point("upright1", (0, 0.5, 0))[:2], [0.884327595936854902, 0.466866900802083729]),
    "a03_andrews": Case(0.03, andrews, [15.810771195153707, -15.756371058411840, 0.040822240119645805, -0.53473011634207960,
                                        0.52440996587995407, 0.53473011634207960, 1.0480807410419379]),
    "a04_bricard": Case(2.0, lambda at: at.point("b2", (0, -0.5, 0)), [-0.77813537303329089, -0.98035268344325656, -0.19725267061717062]),
    "a05_governor": Case(2.0, lambda at: at.point("slider")[2:], [0.5059092942967]),
    "slider_crank": Case(2.0, lambda at: at.point("slider")[:1], slider_crank),
    "spatial_slider_crank": Case(2.0, lambda at: at.point("slider")[:1]),
    "rattleback": Case(1.0, lambda at: [*(-at.rotation("stone")[2]), *at.spin("stone")],
                       [-0.02316491661, -0.00600434243, 0.99971362625, 5.0410423064, 1.7614231695, -3.1175435374]),
    "chaplygin_sphere": Case(10.0, lambda at: at.spin("sphere"), [0.642245648620, 1.068456168290, -0.326474171625]),
    "turntable": Case(10.0, lambda at: at.point("ball")[:2], turntable(10.0)),
    "bicycle": Case(2.0, lambda at: [*at.point("frame"), *at.point("front")], None, ("parameters.push=0", "parameters.lean=0.5")),
    "mechanism_disk": Case(5.0, lambda at: at.point("disk")),
    "trailers": Case(10.0, lambda at: [*at.point("car0")[:2], *at.point("car3")[:2]]),
}


def free_crank(folder):
    """The slider-crank without its motor, from its previous speed; the shipped one has no degree of freedom."""
    text = (ROOT / "scenes" / "slider_crank.toml").read_text()
    for old, new in (('motion = "speed*t"\n', ""), ("inertia = 1e-4\n", 'inertia = 1e-4\nvelocity = [0, "speed*l/2"]\nomega = "speed"\n'),
                     ("assemble = true\n", 'assemble = true\nfixed_velocities = ["crank.angle"]\n')):
        if text.count(old) != 1:
            raise ValueError(f"scenes/slider_crank.toml has changed: {old.strip()} is not there once")
        text = text.replace(old, new)
    path = Path(folder) / "slider_crank.toml"
    path.write_text(text)
    return str(path)


def scene_of(name):
    return tomllib.loads((ROOT / "scenes" / f"{name}.toml").read_text())


def value_of(given, values):
    """Expressions and lists of them as numbers."""
    if isinstance(given, list):
        return [value_of(entry, values) for entry in given]
    return eval(given.replace("^", "**"), FUNCTIONS, values) if isinstance(given, str) else given


def parameters(scene, settings=()):
    values = {}
    given = dict(setting.removeprefix("parameters.").split("=") for setting in settings)
    for name, value in scene.get("parameters", {}).items():
        values[name] = value_of(given.get(name, value), values)
    return values
