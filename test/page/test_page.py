# SPDX-License-Identifier: MIT
"""Pages in a real browser without a window, and glTF files in other readers.

Needs Chromium (apt-get install chromium) and npm, besides requirements.txt. The pages and pictures stay in build/verify/page."""

import base64
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import pygltflib
import tandem
import trimesh
from playwright.sync_api import sync_playwright
from tandem.viewer import drawing_of, rotations
from tandem.viewer.draw import draw
from tandem.viewer.gltf import write_glb
from tandem.viewer.html import page

ROOT = Path(__file__).resolve().parents[2]
SEEN = ROOT / "build" / "verify" / "page"
SCENES = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml"))
# Of the gallery: end of the run, and the part of it that is shown.
GALLERY = (("a01_pendulum", 10, 0.13), ("a02_four_bars", 0.6, 0.7), ("a03_andrews", 0.03, 0.6), ("a04_bricard", 2, 0.55),
           ("a05_governor", 2, 0.8), ("slider_crank", 2, 0.15), ("spatial_slider_crank", 2, 0.2), ("rattleback", 1, 0.9),
           ("chaplygin_sphere", 10, 0.8), ("turntable", 10, 1.0), ("mechanism_disk", 10, 0.62), ("bicycle", 5, 0.9), ("trailers", 20, 0.95),
           ("mechanism_vehicle", 6, 0.6), ("mechanism_motorcycle", 6, 0.5), ("mechanism_chopper", 6, 0.5))
VALIDATOR = "gltf-validator@2.0.0-dev.3.10"


def run(scene, **settings):
    return tandem.run_scene(scene, {"time.end": 0.03 if "andrews" in scene else 1.0 if "four_bars" not in scene else 0.6, **settings},
                            error=False)


def chain(n, seconds=10.0):
    """A chain of n links that waves, as a result that no run has made."""
    time = np.linspace(0, seconds, 61)
    names, columns, rates, x, y = [], [], [], np.zeros(61), np.zeros(61)
    for i in range(n):
        angle = -np.pi/2 + 0.6*np.sin(2*np.pi*time/5 - 0.02*i)
        names += [f"link{i}.{what}" for what in ("x", "y", "angle")]
        columns += [x + 0.05*np.cos(angle), y + 0.05*np.sin(angle), angle]
        x, y = x + 0.1*np.cos(angle), y + 0.1*np.sin(angle)
    q = np.stack(columns, axis=1)
    rates = np.gradient(q, time, axis=0)
    scene = {"scene": {"name": "chain", "model": "mechanism", "planar": True}, "gravity": {"vector": [0, -9.81]},
             "body": {f"link{i}": {"mass": 1.0, "inertia": 0.001, "position": [0, -0.1*i - 0.05], "angle": "-pi/2",
                                   "points": {"end": [0.05, 0], "begin": [-0.05, 0]}} for i in range(n)}}
    drawing = tandem.Mechanism({**scene, "time": {"end": 1.0}}).drawing()
    return tandem.Result(time, names, ["m", "m", "rad"]*n, q, rates, scene=scene, drawing=drawing)


class Browser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        if program is None:
            raise RuntimeError("there is no Chromium: apt-get install chromium")
        SEEN.mkdir(parents=True, exist_ok=True)
        cls.playwright = sync_playwright().start()
        cls.addClassCleanup(cls.playwright.stop)
        # Without a card, as Chromium itself then draws: WebGL by SwiftShader, the page around it by the processor.
        cls.browser = cls.playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--enable-unsafe-swiftshader"])
        cls.addClassCleanup(cls.browser.close)

    def open(self, given, name, hash_="#still", size=(1000, 640)):
        """A page in a browser without a network; its complaints and requests are recorded."""
        drawing = drawing_of(given)
        path = SEEN / f"{name}.html"
        path.write_text(page(drawing), encoding="utf-8")
        context = self.browser.new_context(viewport={"width": size[0], "height": size[1]}, offline=True)
        self.addCleanup(context.close)
        tab = context.new_page()
        self.told, self.asked = [], []
        # Without a graphics card the browser itself remarks that it copies the canvas.
        tab.on("console", lambda message: None if "GPU stall due to ReadPixels" in message.text else self.told.append(message.text))
        tab.on("pageerror", lambda error: self.told.append(str(error)))
        tab.on("request", lambda request: self.asked.append(request.url))
        tab.goto(f"file://{path}{hash_}")
        tab.wait_for_function("window.tandem || !document.getElementById('failure').hidden", timeout=60000)
        self.assertEqual(tab.text_content("#failure"), "")
        return tab, drawing

    def quiet(self):
        self.assertEqual(self.told, [])
        self.assertEqual([url for url in self.asked if not url.startswith(("file:", "blob:", "data:"))], [])

    def pixels(self, tab):
        """The canvas alone (n, 3), small."""
        data = tab.evaluate("""() => { tandem.renderer.render(tandem.scene, tandem.camera);
            const canvas = document.createElement('canvas'); canvas.width = 250; canvas.height = 160;
            const context = canvas.getContext('2d'); context.drawImage(tandem.renderer.domElement, 0, 0, 250, 160);
            return btoa(String.fromCharCode(...context.getImageData(0, 0, 250, 160).data.filter((_, i) => i % 4 < 3))); }""")
        return np.frombuffer(base64.b64decode(data), dtype=np.uint8).reshape(-1, 3).astype(int)

    def not_blank(self, tab, name):
        """More than the ground is drawn."""
        pixels = self.pixels(tab)
        coloured = np.ptp(pixels, axis=1) > 40
        self.assertGreater(coloured.sum(), 15, f"{name}: no body is seen")
        self.assertLess(coloured.mean(), 0.6, f"{name}: nothing but one body is seen")
        tab.screenshot(path=SEEN / f"{name}.png")


class Pages(Browser):
    def test_poses(self):
        """Every scene: the scene graph at three times agrees with the file; the page makes no complaints or requests."""
        for scene in SCENES:
            with self.subTest(scene):
                one = run(scene)
                tab, drawing = self.open(one, scene)
                size = np.max(np.subtract(*drawing.bounds()[::-1]))
                for part in (0.0, 0.37, 1.0):
                    f = round(part*(len(drawing.times) - 1))
                    tab.evaluate("t => tandem.setTime(t)", float(drawing.times[f]))
                    for body in drawing.bodies[:12]:
                        found = tab.evaluate("name => tandem.pose(name)", body.name)
                        # Steps of 1e-7 of the size, and 24 bits of the numbers.
                        self.assertLess(np.abs(found["position"] - body.position[f]).max(), 1e-6*size, f"{body.name} at frame {f}")
                        x, y, z, w = found["quaternion"]
                        self.assertLess(min(np.abs([w, x, y, z] - body.rotation[f]).max(), np.abs([w, x, y, z] + body.rotation[f]).max()), 1e-5)
                self.quiet()
                tab.evaluate("tandem.setTime(tandem.drawing.times.first + 0.6*tandem.drawing.times.step*(tandem.drawing.times.count - 1))")
                self.not_blank(tab, scene)

    def test_rows_of_the_file(self):
        """At rows themselves, against the numbers that h5py reads, without anything of the viewer between."""
        import h5py

        with tempfile.TemporaryDirectory() as folder:
            one = tandem.run_scene("slider_crank", {"time.end": 1, "output.interval": 1/60}, Path(folder) / "a.h5", error=False)
            with h5py.File(Path(folder) / "a.h5") as file:
                q, time = file["trajectory/q"][:], file["trajectory/time"][:]
                names = list(file["trajectory/q"].attrs["names"])
        tab, _ = self.open(one, "rows")
        for row in (0, 17, 60):
            tab.evaluate("t => tandem.setTime(t)", float(time[row]))
            for body in ("crank", "rod", "slider"):
                found = tab.evaluate("name => tandem.pose(name)", body)
                x, y, angle = (q[row, names.index(f"{body}.{what}")] for what in ("x", "y", "angle"))
                self.assertLess(np.abs(np.array(found["position"]) - [x, y, 0]).max(), 1e-6)
                self.assertLess(abs(np.sin(2*np.arctan2(found["quaternion"][2], found["quaternion"][3]) - angle)), 1e-6)

    def test_controls(self):
        tab, drawing = self.open(run("bicycle"), "controls")
        state = lambda what: tab.evaluate(f"tandem.{what}")  # noqa: E731
        self.assertFalse(state("state.playing"))
        # A drawing, which needs no font: a triangle, two bars while it plays.
        icon = lambda: tab.get_attribute("#play path", "d").count("z")  # noqa: E731
        self.assertEqual(icon(), 1)
        self.assertEqual(tab.inner_text("#play").strip(), "")
        tab.click("#play")
        tab.wait_for_function("tandem.state.frame > 3")
        self.assertEqual(icon(), 2)
        tab.click("#play")
        self.assertFalse(state("state.playing"))
        frame = state("state.frame")
        tab.wait_for_timeout(150)
        self.assertEqual(state("state.frame"), frame)
        tab.click("#start")
        self.assertEqual(state("state.frame"), 0)
        tab.keyboard.press("ArrowRight")
        self.assertEqual(state("state.frame"), 1)
        tab.keyboard.press("End")
        self.assertEqual(state("state.frame"), len(drawing.times) - 1)
        tab.locator("body").press("Home")
        tab.locator("#time").fill(str(30))
        self.assertEqual(state("state.frame"), 30)
        self.assertIn("0.500 s", tab.text_content("#clock"))
        tab.select_option("#speed", "0.25")
        self.assertEqual(state("state.speed"), 0.25)
        tab.select_option("#follow", "front")
        before = np.array(state("controls.target.toArray()"))
        self.assertLess(np.abs(before - state("pose('front').position")).max(), 1e-5)
        tab.evaluate("tandem.setTime(0.9)")
        self.assertLess(np.abs(np.array(state("controls.target.toArray()")) - state("pose('front').position")).max(), 1e-4)
        tab.select_option("#follow", "")
        here = state("camera.position.toArray()")
        tab.mouse.move(300, 300)
        tab.mouse.down()
        tab.mouse.move(400, 330, steps=4)
        tab.mouse.up()
        self.assertNotEqual(state("camera.position.toArray()"), here)
        tab.click("#reset")
        tab.uncheck("#tracks")
        lines = "scene.children.filter(one => one.type === 'Line').map(one => one.visible)"
        self.assertEqual(set(state(lines)), {False})
        tab.check("#tracks")
        self.assertEqual(set(state(lines)), {True})
        tab.select_option("#curve", "1")
        box = tab.locator("#plot").bounding_box()
        tab.mouse.click(box["x"] + box["width"]/2, box["y"] + 70)
        self.assertAlmostEqual(state("state.frame"), (len(drawing.times) - 1)/2, delta=1)
        tab.uncheck("#loop")
        tab.select_option("#speed", "20")
        tab.click("#play")
        tab.wait_for_function("!tandem.state.playing")
        self.assertEqual(state("state.frame"), len(drawing.times) - 1)
        self.quiet()

    def test_it_plays_at_once(self):
        tab, _ = self.open(run("slider_crank"), "plays", hash_="")
        tab.wait_for_function("tandem.state.frame > 2")
        self.quiet()

    def test_pictures_of_the_documentation(self):
        """Pictures doc/figures/SCENE_page.png: the paper's motions as their pages play them."""
        for scene, part in (("rolling_disk", 0.62), ("articulated_vehicle", 0.6), ("motorcycle", 0.5), ("motorcycle_chopper", 0.5)):
            with self.subTest(scene):
                tab, drawing = self.open(tandem.run_scene(scene, error=False), f"{scene}_page", size=(820, 470))
                tab.evaluate("t => tandem.setTime(t)", float(drawing.times[round(part*(len(drawing.times) - 1))]))
                self.not_blank(tab, f"{scene}_page")
                self.quiet()

    def test_pictures_of_the_gallery(self):
        """Pictures doc/figures/gallery_SCENE.png: every shipped mechanism, without the page's controls."""
        for scene, end, part in GALLERY:
            with self.subTest(scene):
                self.assertTrue((ROOT / "doc" / "figures" / f"gallery_{scene}.png").exists())
                one = tandem.run_scene(scene, {"time.end": end, "output.interval": end/200}, error=False)
                tab, drawing = self.open(one, f"gallery_{scene}", size=(480, 300))
                tab.evaluate("t => tandem.setTime(t)", float(drawing.times[round(part*(len(drawing.times) - 1))]))
                tab.add_style_tag(content="header, figure, footer { display: none !important; }")
                self.not_blank(tab, f"gallery_{scene}")
                self.quiet()

    def test_as_with_a_graphics_card(self):
        """`#fine`: instances lit by the renderer. Both methods of drawing give similar pixels."""
        one, seen = run("slider_crank"), {}
        for hash_ in ("#still", "#still-fine"):
            tab, _ = self.open(one, "fine", hash_)
            tab.evaluate("tandem.setTime(0.3)")
            self.not_blank(tab, f"fine{hash_[6:]}")
            seen[hash_] = self.pixels(tab)
            self.assertEqual(tab.evaluate("tandem.scene.children.some(one => one.isInstancedMesh)"), hash_ == "#still-fine")
            self.quiet()
        a, b = (pixels[np.ptp(pixels, axis=1) > 40] for pixels in seen.values())
        # Edges are smoothed in one of them, and round things have fewer faces in the other.
        self.assertLess(abs(len(a) - len(b)), 0.15*len(a))
        self.assertLess(np.abs(a.mean(axis=0) - b.mean(axis=0)).max(), 12)

    def test_arrows(self):
        """Forces and torques of joints: the distance of each arrow's tip agrees with the file, on one scale for each kind. The head of
        an arc points in the right-handed direction."""
        scene = tandem.Mechanism.from_toml(ROOT / "scenes" / "slider_crank.toml")
        scene["results.joints"] = "all"
        result = scene.run({"time.end": 1.0}, error=False)
        tab, drawing = self.open(result, "arrows")
        tab.evaluate("tandem.setTime(0.3)")
        found = tab.evaluate("""() => tandem.scene.children.filter(one => one.type === 'Group' && one.children[1]?.geometry.type === 'ConeGeometry')
            .map(one => { one.updateMatrixWorld(true); const world = (x, y, z) => one.localToWorld(one.position.clone().set(x, y, z)).toArray();
                return one.children.length === 2 ? [one.position.toArray(), world(...one.children[1].position.toArray())]
                    : [one.position.toArray(), world(0, 0, 1), world(0, -1, 0), world(0.5, -1, 0)]; })""")
        # Four joints, of which the motor has a torque: pins have none, and the guide is where the wrist pulls.
        self.assertEqual([arrow.unit for arrow in drawing.arrows].count("N"), 4)
        self.assertEqual([arrow.unit for arrow in drawing.arrows].count("N m"), 1)
        frame = round(0.3*60)
        for (place, tip, *head), arrow in zip(found, drawing.arrows, strict=True):
            joint, what = arrow.name.split()
            self.assertEqual(len(head), 2*(what == "torque"))
            said = result.groups["joints"][joint][what].values[300]
            scale = {"force": 0.5, "torque": 0.12}[what]*drawing_size(tab)/max(
                np.linalg.norm(one.vectors, axis=1).max() for one in drawing.arrows if one.name.endswith(what))
            np.testing.assert_allclose(place, arrow.positions[frame], atol=1e-5)
            # Forces are packed in steps of 1e-4 of the largest, and rows of the file are 1 ms apart.
            np.testing.assert_allclose(np.subtract(tip, place), scale*said, atol=2e-4*drawing_size(tab))
            if head:
                begin, end = np.subtract(head, place)
                self.assertGreater(np.cross(begin, end - begin) @ said, 0.4*np.linalg.norm(said)*np.linalg.norm(begin)**2)
        self.assertRegex(tab.text_content("#arrows-label"), r"forces up to [0-9.e+]+ N, torques up to [0-9.e+-]+ N m")
        # The legend says which is which, on what, and how large it is now; the one that is pointed at is seen alone.
        rows = tab.evaluate("[...document.querySelectorAll('#legend div')].map(row => [row.children[1].textContent, row.children[2].textContent])")
        self.assertEqual([name for name, _ in rows], [f"{arrow.name} on {arrow.on}" for arrow in drawing.arrows])
        for (_, value), arrow in zip(rows, drawing.arrows, strict=True):
            size = np.linalg.norm(arrow.vectors[frame])
            self.assertRegex(value, rf"^[0-9.e+-]+ {arrow.unit}$")
            self.assertAlmostEqual(float(value.split()[0]), size, delta=0.01*size + 1e-3)
        seen = "tandem.scene.children.filter(one => one.type === 'Group' && one.visible && one.children[1]?.geometry.type === 'ConeGeometry').length"
        tab.hover("#legend div:nth-child(2)")
        self.assertEqual(tab.evaluate(seen), 1)
        tab.hover("#play")
        self.assertEqual(tab.evaluate(seen), 5)
        tab.uncheck("#arrows")
        self.assertFalse(tab.evaluate("tandem.scene.children.some(one => one.type === 'Group' && one.visible && one.children[1]?.geometry.type === 'ConeGeometry')"))
        tab.check("#arrows")
        self.not_blank(tab, "arrows")
        self.quiet()

    def test_modes(self):
        """The chosen mode moves; the pose agrees with its take."""
        with tempfile.TemporaryDirectory() as folder:
            tandem.run_program("linearise", "bicycle", "--output", Path(folder) / "modes.h5")
            tab, drawing = self.open(Path(folder) / "modes.h5", "modes")
        self.assertEqual(tab.evaluate("[...document.getElementById('take').options].map(one => one.text)"), [name for name, _ in drawing.takes])
        for i in (1, 0, 2):
            tab.select_option("#take", str(i))
            tab.evaluate("tandem.setTime(0.5)")
            for body in drawing.takes[i][1]:
                found = tab.evaluate("name => tandem.pose(name)", body.name)
                self.assertLess(np.abs(found["position"] - body.position[30]).max(), 1e-5)
        self.not_blank(tab, "modes")
        self.quiet()

    def test_frames_a_second(self):
        """Ten bodies for a minute, in software rendering; a chain of a thousand. The speed depends on the load of the machine: so the
        time of a frame's JavaScript and the processors' time of a frame, of the whole browser, are stated too."""
        for name, given in (("ten", tandem.run_scene("trailers", {"parameters.n": 9, "time.end": 60}, error=False)), ("thousand", chain(1000))):
            tab, drawing = self.open(given, name, size=(1000, 640))
            self.not_blank(tab, name)
            before = processor_seconds()
            script = tab.evaluate("""() => { const gl = tandem.renderer.getContext(), pixel = new Uint8Array(4), times = tandem.drawing.times, took = [];
                for (let i = 0; i < 40; i++) { const start = performance.now(); tandem.setTime(times.first + times.step * (10 + 3.3 * i));
                    took.push(performance.now() - start); gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); }
                return took.sort((a, b) => a - b)[20]; }""")
            alone = 1e3*(processor_seconds() - before)/40
            tab.evaluate("tandem.play()")
            tab.wait_for_timeout(500)
            before, worked = tab.evaluate("tandem.state.drawn"), processor_seconds()
            tab.wait_for_timeout(4000)
            frames, worked = tab.evaluate("tandem.state.drawn") - before, processor_seconds() - worked
            tab.evaluate("tandem.pause()")
            calls, corners = tab.evaluate("[tandem.renderer.info.render.calls, 3*tandem.renderer.info.render.triangles]")
            print(f"{name}: {len(drawing.bodies)} bodies, {len(drawing.times)} frames, {frames/4:.0f} frames a second, {1e3*worked/frames:.0f} ms "
                  f"of processors a frame; {script:.1f} ms of JavaScript and {alone:.0f} ms of processors for a frame's drawing alone; {calls} draw calls, {corners} corners; {(SEEN / f'{name}.html').stat().st_size/1e6:.2f} MB", file=sys.stderr)
            self.quiet()
            self.assertGreater(frames, 0)
            # The work of two threads of a slow core at thirty frames per second.
            self.assertLess(alone, 50)
            # One for all bodies, one for each track, one for the ground; and the fewest faces that look round.
            self.assertLessEqual(calls, 2 + len(drawing.tracks))
            self.assertLess(corners, 1200*len(drawing.bodies))

    def test_nothing_is_done_where_nothing_moves(self):
        """A paused motion requests no frames from the browser and draws none; a user's action is drawn once."""
        tab, _ = self.open(run("slider_crank"), "idle")
        tab.evaluate("""() => { window.asked = 0; const ask = requestAnimationFrame; window.requestAnimationFrame = act => { asked++; return ask(act); }; }""")
        tab.click("#play")
        tab.wait_for_function("tandem.state.frame > 2")
        tab.click("#play")
        tab.wait_for_timeout(100)
        before = tab.evaluate("[asked, tandem.state.drawn]")
        self.assertGreater(before[0], 2)
        tab.wait_for_timeout(300)
        self.assertEqual(tab.evaluate("[asked, tandem.state.drawn]"), before)
        tab.keyboard.press("ArrowRight")
        self.assertEqual(tab.evaluate("[asked, tandem.state.drawn]"), [before[0], before[1] + 1])
        tab.click("#play")
        tab.wait_for_function(f"tandem.state.frame > {tab.evaluate('tandem.state.frame')} + 2")
        self.quiet()


def drawing_size(tab):
    return tab.evaluate("tandem.drawing.size")


def processor_seconds():
    """Processor time used so far by the processes of the browser that this process has started."""
    parents, times = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        parents[int(folder.name)], times[int(folder.name)] = int(fields[1]), int(fields[11]) + int(fields[12])
    ours = {os.getpid()}
    while more := {process for process, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return sum(times.get(process, 0) for process in ours - {os.getpid()})/os.sysconf("SC_CLK_TCK")


class Gltf(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.place = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.place.cleanup)
        cls.drawings = {}
        for scene in SCENES:
            cls.drawings[scene] = draw(run(scene))
            write_glb(cls.drawings[scene], Path(cls.place.name) / f"{scene}.glb")

    def test_khronos_validator(self):
        tools = ROOT / "build" / "gltf-validator"
        if not (tools / "node_modules" / "gltf-validator").exists():
            tools.mkdir(parents=True, exist_ok=True)
            subprocess.run(["npm", "install", "--silent", "--no-save", "--prefix", str(tools), VALIDATOR], check=True, cwd=tools)
        code = """const validator = require('gltf-validator'), fs = require('fs');
            (async () => { const all = {}; for (const file of process.argv.slice(1)) {
                const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
                all[file] = report.issues; } console.log(JSON.stringify(all)); })();"""
        files = sorted(map(str, Path(self.place.name).glob("*.glb")))
        done = subprocess.run(["node", "-e", code, *files], capture_output=True, text=True, cwd=tools,
                              env={**os.environ, "NODE_PATH": str(tools / "node_modules")})
        self.assertEqual(done.returncode, 0, done.stderr)
        issues = json.loads(done.stdout)
        self.assertEqual(len(issues), len(SCENES))
        for file, found in issues.items():
            self.assertEqual((found["numErrors"], found["numWarnings"]), (0, 0), f"{Path(file).name}: {found['messages'][:3]}")

    def test_other_readers(self):
        for scene, drawing in self.drawings.items():
            with self.subTest(scene):
                path = Path(self.place.name) / f"{scene}.glb"
                loaded = pygltflib.GLTF2().load(str(path))
                self.assertEqual({node.name for node in loaded.nodes if node.name} & {body.name for body in drawing.bodies},
                                 {body.name for body in drawing.bodies})
                opened = trimesh.load(path)
                # At the first frame, the box around all bodies, seen with y upwards.
                up = rotations.conjugate(rotations.rotation_onto(drawing.up, (0.0, 1.0, 0.0)))
                for body in drawing.bodies:
                    found = opened.graph.get(body.name)[0][:3, 3]
                    self.assertLess(np.abs(found - rotations.rotated(up, body.position[0])).max(), 1e-5*max(1, np.abs(body.position[0]).max()))


if __name__ == "__main__":
    unittest.main()
