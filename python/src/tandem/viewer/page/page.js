// SPDX-License-Identifier: MIT
// Plays a motion: bodies composed of four unit shapes, springs, growing tracks, arrows, and a plot with a cursor.
//
// Without a graphics card, every vertex and every pixel takes processor time. Then all pieces form one mesh, which this program moves
// and lights itself. Shapes have fewer faces, colours are in the colour space of the screen so that no pixel is converted, and the texts
// are updated only ten times per second.
import * as THREE from "three";
import { OrbitControls } from "orbit";

const element = id => document.getElementById(id);

/** Unpack the channels of the motion: integer multiples of steps, whose third differences are stored in planes of bytes (packing.py). */
function unpack(buffer, steps, frames) {
    const planes = new Uint8Array(buffer), count = steps.length * frames, channels = [];
    for (let c = 0; c < steps.length; c++) {
        const channel = new Float32Array(frames);
        let third, second = 0, first = 0, value = 0;
        for (let f = 0, i = c * frames; f < frames; f++, i++) {
            const zigzag = (planes[i] | planes[count + i] << 8 | planes[2 * count + i] << 16 | planes[3 * count + i] << 24) >>> 0;
            third = (zigzag >>> 1) ^ -(zigzag & 1);
            second = second + third | 0;
            first = first + second | 0;
            value = value + first | 0;
            channel[f] = value * steps[c];
        }
        channels.push(channel);
    }
    return channels;
}

/** A coil of radius 1 along z from 0 to 1. */
function coil() {
    const points = [], turns = 8;
    for (let i = 0; i <= 24 * turns; i++) {
        const part = i / (24 * turns), angle = 2 * Math.PI * turns * part, out = Math.min(1, 12 * part, 12 * (1 - part));
        points.push(new THREE.Vector3(out * Math.cos(angle), out * Math.sin(angle), part));
    }
    return new THREE.BufferGeometry().setFromPoints(points);
}

const shapes = round => ({
    box: () => new THREE.BoxGeometry(1, 1, 1),
    cylinder: () => new THREE.CylinderGeometry(1, 1, 1, round).rotateX(Math.PI / 2),
    sphere: () => new THREE.SphereGeometry(1, round, Math.round(0.65 * round)),
    rim: () => new THREE.TorusGeometry(1, 0.05, Math.round(0.35 * round), 2 * round),
    ...fromFiles,
});

/** Add the meshes of files. They are compressed lists of triangles, which do not share corners. */
async function addMeshes(meshes) {
    for (const [name, text] of Object.entries(meshes)) {
        const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
        const corners = new Float32Array(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
        fromFiles[name] = () => {
            const geometry = new THREE.BufferGeometry();
            geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
            geometry.computeVertexNormals();
            geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from({ length: corners.length / 3 }, (_, i) => i), 1));
            return geometry;
        };
    }
}
const fromFiles = {};

/** Transformation of a piece to the axes of its body. */
const matrixOf = ([, size, , at, turn]) => new THREE.Matrix4().compose(new THREE.Vector3(...at),
    new THREE.Quaternion(turn[1], turn[2], turn[3], turn[0]), new THREE.Vector3(...size));

/** Add all pieces; those of one shape are rendered at once. An owner is a node with its pieces. Returns a function that moves the pieces to their nodes. */
function makeInstances(scene, owners) {
    const found = {}, colour = new THREE.Color(), made = shapes(28), matrix = new THREE.Matrix4();
    for (const { node, pieces } of owners) for (const piece of pieces) (found[piece[0]] ??= []).push([node, piece]);
    const groups = Object.entries(found).map(([shape, pieces]) => {
        const mesh = new THREE.InstancedMesh(made[shape](), new THREE.MeshLambertMaterial(), pieces.length);
        mesh.frustumCulled = false;
        const locals = pieces.map(([node, piece], i) => {
            mesh.setColorAt(i, colour.set(piece[2]));
            return [node, matrixOf(piece)];
        });
        scene.add(mesh);
        return { mesh, locals };
    });
    return () => {
        for (const { mesh, locals } of groups) {
            locals.forEach(([node, local], i) => mesh.setMatrixAt(i, matrix.multiplyMatrices(node.matrixWorld, local)));
            mesh.instanceMatrix.needsUpdate = true;
        }
    };
}

/** Shades of a colour as three bytes each, from black to brighter than the screen can show. */
const SHADES = 96, BRIGHTEST = 1.3;
function shadesOf(tint) {
    const linear = [1, 3, 5].map(i => { const c = parseInt(tint.slice(i, i + 2), 16) / 255; return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4; });
    return Uint8Array.from({ length: 3 * SHADES }, (_, i) => {
        const c = Math.min(1, linear[i % 3] * BRIGHTEST * Math.floor(i / 3) / (SHADES - 1));
        return 255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055);
    });
}

/** Number of faces of a round piece, such that its edge deviates from a circle by about half a pixel in the initial view. */
function roundness(length, size) {
    const pixels = 420 * length / size;
    return 2 * Math.round(Math.min(20, Math.max(8, Math.PI * Math.sqrt(pixels))) / 2);
}

/** Variant of `makeInstances` for software rendering: one mesh in the axes of the world, which is moved and lit here. */
function makeMerged(scene, owners, up, sun, size) {
    const known = {}, normalMatrix = new THREE.Matrix3(), v = new THREE.Vector3();
    const shapeOf = ([name, lengths]) => {
        const round = name in fromFiles || name === "box" ? 0 : roundness(name === "cylinder" ? Math.max(lengths[0], lengths[1]) : Math.max(...lengths), size);
        return known[`${name} ${round}`] ??= shapes(round)[name]();
    };
    const count = what => owners.reduce((sum, { pieces }) => sum + pieces.reduce((n, piece) => n + what(shapeOf(piece)), 0), 0);
    const vertices = count(shape => shape.attributes.position.count);
    const own = new Float32Array(6 * vertices), index = new Uint32Array(count(shape => shape.index.count)), tables = {}, parts = [];
    let at = 0, corner = 0;
    for (const { node, pieces } of owners) for (const piece of pieces) {
        const shape = shapeOf(piece), local = matrixOf(piece), { position, normal } = shape.attributes, from = at;
        normalMatrix.getNormalMatrix(local);
        for (let i = 0; i < shape.index.count; i++) index[corner++] = at + shape.index.array[i];
        for (let i = 0; i < position.count; i++, at++) {
            v.fromBufferAttribute(position, i).applyMatrix4(local).toArray(own, 6 * at);
            v.fromBufferAttribute(normal, i).applyMatrix3(normalMatrix).normalize().toArray(own, 6 * at + 3);
        }
        parts.push({ node, from, to: at, shades: tables[piece[2]] ??= shadesOf(piece[2]) });
    }
    const positions = new Float32Array(3 * vertices), colours = new Uint8Array(4 * vertices).fill(255), geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colours, 4, true));
    geometry.setIndex(new THREE.BufferAttribute(index, 1));
    const mesh = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ vertexColors: true, fog: false }));
    mesh.frustumCulled = false;
    scene.add(mesh);
    const back = new THREE.Quaternion(), u = new THREE.Vector3(), s = new THREE.Vector3(), scale = (SHADES - 1) / BRIGHTEST;
    return () => {
        for (const { node, from, to, shades } of parts) {
            const m = node.matrixWorld.elements;
            back.copy(node.quaternion).invert();
            u.copy(up).applyQuaternion(back);
            s.copy(sun).applyQuaternion(back);
            for (let i = from, k = 6 * from; i < to; i++, k += 6) {
                const x = own[k], y = own[k + 1], z = own[k + 2], nx = own[k + 3], ny = own[k + 4], nz = own[k + 5];
                positions[3 * i] = m[0] * x + m[4] * y + m[8] * z + m[12];
                positions[3 * i + 1] = m[1] * x + m[5] * y + m[9] * z + m[13];
                positions[3 * i + 2] = m[2] * x + m[6] * y + m[10] * z + m[14];
                // Light of the sky, the ground and the sun, as in the scene of `show`.
                const lit = SKY * (0.764 + 0.236 * (nx * u.x + ny * u.y + nz * u.z)) + SUN * Math.max(0, nx * s.x + ny * s.y + nz * s.z);
                const shade = 3 * Math.min(SHADES - 1, Math.round(scale * lit / Math.PI));
                colours[4 * i] = shades[shade];
                colours[4 * i + 1] = shades[shade + 1];
                colours[4 * i + 2] = shades[shade + 2];
            }
        }
        geometry.attributes.position.needsUpdate = geometry.attributes.color.needsUpdate = true;
    };
}

/** Intensities of the sky and the sun; the ground reflects 0.53 of the light of the sky. */
const SKY = 2.0, SUN = 1.8;

/** Largest number of segments of a track, because lines are slow in software rendering. */
const MOST_PIECES = 1500;

/** Frames at which a polyline through the positions has corners, such that it deviates from the line by at most `far`. */
function corners(whole, frames, far) {
    const kept = new Uint8Array(frames), waiting = [[0, frames - 1]];
    kept[0] = kept[frames - 1] = 1;
    while (waiting.length) {
        const [first, last] = waiting.pop(), a = 3 * first, d = [0, 1, 2].map(k => whole[3 * last + k] - whole[a + k]);
        const length = d[0] ** 2 + d[1] ** 2 + d[2] ** 2;
        let worst = far * far, at = -1;
        for (let f = first + 1; f < last; f++) {
            const x = whole[3 * f] - whole[a], y = whole[3 * f + 1] - whole[a + 1], z = whole[3 * f + 2] - whole[a + 2];
            const s = length > 0 ? Math.min(1, Math.max(0, (x * d[0] + y * d[1] + z * d[2]) / length)) : 0;
            const off = (x - s * d[0]) ** 2 + (y - s * d[1]) ** 2 + (z - s * d[2]) ** 2;
            if (off > worst) { worst = off; at = f; }
        }
        if (at > 0) { kept[at] = 1; waiting.push([first, at], [at, last]); }
    }
    return Array.from(kept.keys()).filter(f => kept[f]);
}

/** A growing track, and the node at its end. */
function makeLine(scene, track, node, channels, from, frames, size) {
    const whole = new Float32Array(3 * frames);
    for (let f = 0; f < frames; f++) for (let k = 0; k < 3; k++) whole[3 * f + k] = channels[from + k][f];
    let far = 3e-4 * size, turns = corners(whole, frames, far);
    while (turns.length > MOST_PIECES) turns = corners(whole, frames, far *= 2);
    const positions = new Float32Array(3 * turns.length + 3), geometry = new THREE.BufferGeometry();
    const restore = i => { if (i < turns.length) positions.set(whole.subarray(3 * turns[i], 3 * turns[i] + 3), 3 * i); };
    turns.forEach((_, i) => restore(i));
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: track.colour }));
    line.frustumCulled = false;
    scene.add(line);
    let drawn = 0, full = 0;
    /** Show the track up to a frame: complete segments, and a last one to the current position. */
    const grow = frame => {
        while (full + 1 < turns.length && turns[full + 1] <= frame) full++;
        while (turns[full] > frame) full--;
        const here = whole.subarray(3 * frame, 3 * frame + 3);
        node.position.fromArray(here);
        node.updateMatrixWorld();
        // Restore the end of the segment that ended at the current position of the last frame.
        restore(drawn);
        const position = geometry.attributes.position, first = Math.min(drawn, full + 1);
        position.clearUpdateRanges();
        position.addUpdateRange(3 * first, 3 * (Math.max(drawn, full + 1) + 1 - first));
        positions.set(here, 3 * (drawn = full + 1));
        position.needsUpdate = true;
        geometry.setDrawRange(0, full + 2);
    };
    return { line, node, grow };
}

/** An arrow along y with a shaft and a head of constant thickness; `stretch` sets its length. */
function makeArrow(scene, arrow, size) {
    const group = new THREE.Group(), material = new THREE.MeshBasicMaterial({ color: arrow.colour, fog: false });
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.006, 0.006, 1, 10).translate(0, 0.5, 0), material);
    const head = new THREE.Mesh(new THREE.ConeGeometry(0.02, 0.06, 14).translate(0, -0.03, 0), material);
    group.add(shaft, head);
    scene.add(group);
    const stretch = length => {
        // In a short arrow, the head has the length of the arrow.
        const part = Math.min(size, length / 0.06);
        head.scale.setScalar(part);
        head.position.y = length;
        shaft.scale.set(part, Math.max(1e-9 * size, length - 0.05 * part), part);
    };
    const point = (length, direction) => { stretch(length); group.quaternion.setFromUnitVectors(UP, direction); };
    return { group, point };
}

/** A torque: an arc with a head about its axis in the right-handed sense, and the axis, which is visible if the arc is seen from the side. */
function makeArc(scene, arrow) {
    const group = new THREE.Group(), material = new THREE.MeshBasicMaterial({ color: arrow.colour, fog: false });
    const arc = new THREE.Mesh(new THREE.TorusGeometry(1, 0.05, 6, 24, 1.5 * Math.PI), material);
    const head = new THREE.Mesh(new THREE.ConeGeometry(0.17, 0.5, 14).rotateZ(-Math.PI / 2).translate(0.25, -1, 0), material);
    const axis = new THREE.Mesh(new THREE.CylinderGeometry(0.03, 0.03, 1, 6).rotateX(Math.PI / 2).translate(0, 0, 0.5), material);
    group.add(arc, head, axis);
    scene.add(group);
    const point = (radius, direction) => { group.scale.setScalar(radius); group.quaternion.setFromUnitVectors(AHEAD, direction); };
    return { group, point };
}
const UP = new THREE.Vector3(0, 1, 0), AHEAD = new THREE.Vector3(0, 0, 1);

/** Legend of the arrows: colour, element, body on which the arrow acts, and current value. Pointing at an entry shows only this arrow. */
function makeLegend(arrows) {
    const most = 14, legend = { alone: null, whenAlone: () => {}, update: () => {} }, box = document.getElementById("legend");
    if (!arrows.length) return legend;
    const rows = arrows.slice(0, most).map(({ arrow, from }) => {
        const row = document.createElement("div"), colour = document.createElement("i"), name = document.createElement("span"),
            value = document.createElement("output");
        colour.style.background = arrow.colour;
        name.textContent = arrow.on ? `${arrow.name} on ${arrow.on}` : arrow.name;
        row.append(colour, name, value);
        row.addEventListener("pointerenter", () => { legend.alone = arrow; legend.whenAlone(); });
        row.addEventListener("pointerleave", () => { legend.alone = null; legend.whenAlone(); });
        box.append(row);
        return { from, value, unit: arrow.unit };
    });
    if (arrows.length > most) box.append(`and ${arrows.length - most} more`);
    box.hidden = false;
    // The height of the row of buttons depends on the width of the window.
    const footer = document.querySelector("footer");
    new ResizeObserver(() => { box.style.bottom = `${footer.offsetHeight + 20}px`; }).observe(footer);
    legend.update = (channels, frame) => {
        for (const { from, value, unit } of rows) {
            const size = Math.hypot(channels[from + 3][frame], channels[from + 4][frame], channels[from + 5][frame]);
            value.textContent = `${size.toPrecision(3)} ${unit}`;
        }
    };
    return legend;
}

function makeGround(scene, drawing, size, isSoft, camera) {
    const group = new THREE.Group(), cell = 10 ** Math.round(Math.log10(size / 3)), cells = isSoft ? 40 : 60, reach = cell * cells;
    const plate = new THREE.Mesh(new THREE.CircleGeometry(reach, 64),
        new THREE.MeshBasicMaterial({ color: 0xe8ecef, depthWrite: false, side: THREE.DoubleSide }));
    const positions = new Float32Array(12 * (2 * cells + 1)), geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    const grid = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: 0xc6ccd2 }));
    grid.frustumCulled = false;
    // The ground is rendered first and hides nothing, so that its grid and tracks on it remain visible.
    plate.renderOrder = -2;
    grid.renderOrder = -1;
    grid.material.depthWrite = false;
    // In software rendering the plate is omitted, because it would cover all pixels again.
    if (!isSoft) scene.add(group.add(plate));
    scene.add(grid);
    group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), new THREE.Vector3(...drawing.normal));
    scene.fog = new THREE.Fog(scene.background.getHex(), 4 * size, Math.max(12 * size, 0.9 * reach));
    const origin = new THREE.Vector3(...drawing.ground), away = new THREE.Vector3(), back = group.quaternion.clone().invert();
    const axes = [new THREE.Vector3(1, 0, 0), new THREE.Vector3(0, 1, 0)].map(axis => axis.applyQuaternion(group.quaternion));
    const frustum = new THREE.Frustum(), matrix = new THREE.Matrix4(), from = new THREE.Vector3();
    /** Clip a line to the view of the camera: some renderers omit lines that begin far behind the camera, and shorter lines are faster. */
    const put = (along, at) => {
        let low = 0, high = 2 * reach;
        for (const plane of frustum.planes) {
            const distance = plane.distanceToPoint(from), slope = plane.normal.dot(along);
            if (slope > 0) low = Math.max(low, -distance / slope);
            else if (slope < 0) high = Math.min(high, -distance / slope);
            else if (distance < 0) return at;
        }
        if (!(low < high)) return at;
        for (const s of [low, high]) {
            positions[at++] = from.x + s * along.x;
            positions[at++] = from.y + s * along.y;
            positions[at++] = from.z + s * along.z;
        }
        return at;
    };
    /** Move the grid with the target of the camera by whole cells, so that it appears infinite. */
    return target => {
        away.copy(target).sub(origin).applyQuaternion(back);
        group.position.set(cell * Math.round(away.x / cell), cell * Math.round(away.y / cell), 0).applyQuaternion(group.quaternion).add(origin);
        camera.updateMatrixWorld();
        frustum.setFromProjectionMatrix(matrix.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
        let at = 0;
        for (let k = 0; k < 2; k++) for (let i = -cells; i <= cells; i++) {
            from.copy(group.position).addScaledVector(axes[k], -reach).addScaledVector(axes[1 - k], i * cell);
            at = put(axes[k], at);
        }
        geometry.setDrawRange(0, at / 3);
        geometry.attributes.position.needsUpdate = true;
    };
}

/** The plot: a curve with its smallest and largest value, and a cursor at the current time. */
function makePlot(canvas, times, curves, channels, seek) {
    const context = canvas.getContext("2d"), last = times.count - 1;
    let chosen = 0;
    const number = value => Number(value.toPrecision(4)).toString();
    const curve = document.createElement("canvas");
    let of = "";
    /** The curve itself, drawn once: a frame then copies it and adds the cursor. */
    const drawCurve = (width, height, ratio, x, y, values) => {
        const key = `${chosen} ${width} ${height} ${ratio}`;
        if (of === key) return;
        of = key;
        curve.width = canvas.width = Math.round(width * ratio);
        curve.height = canvas.height = Math.round(height * ratio);
        const pen = curve.getContext("2d"), { low, high } = curves[chosen];
        pen.setTransform(ratio, 0, 0, ratio, 0, 0);
        pen.fillStyle = "#fff";
        pen.fillRect(0, 0, width, height);
        pen.strokeStyle = "#dadce0";
        pen.strokeRect(6, 18, width - 12, height - 38);
        pen.beginPath();
        const by = Math.max(1, Math.floor(times.count / (2 * width)));
        for (let f = 0; f < times.count; f += by) f ? pen.lineTo(x(f), y(values[f])) : pen.moveTo(x(f), y(values[f]));
        pen.lineTo(x(last), y(values[last]));
        pen.strokeStyle = "#0072b2";
        pen.lineWidth = 1.4;
        pen.stroke();
        pen.font = "12px system-ui, sans-serif";
        pen.fillStyle = "#5f6368";
        pen.fillText(`${number(low)} to ${number(high)}`, 7, 13);
        pen.fillText(`${number(times.first)} s`, 7, height - 6);
        pen.textAlign = "right";
        pen.fillText(`${number(times.first + times.step * last)} s`, width - 7, height - 6);
    };
    const draw = frame => {
        const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
        if (!width) return;
        const values = channels[curves[chosen].channel], { low, high } = curves[chosen];
        const x = f => 6 + (last ? (width - 12) * f / last : 0), y = v => height - 20 - (height - 38) * (v - low) / (high - low);
        drawCurve(width, height, ratio, x, y, values);
        context.setTransform(1, 0, 0, 1, 0, 0);
        context.drawImage(curve, 0, 0);
        context.setTransform(ratio, 0, 0, ratio, 0, 0);
        const near = Math.round(frame);
        context.fillStyle = "#d55e00";
        context.fillRect(x(frame) - 0.6, 18, 1.2, height - 38);
        context.beginPath();
        context.arc(x(near), y(values[near]), 3.5, 0, 7);
        context.fill();
        context.font = "12px system-ui, sans-serif";
        context.textAlign = "right";
        context.fillText(`${number(values[near])} ${curves[chosen].unit}`, width - 7, 13);
    };
    const at = event => {
        const box = canvas.getBoundingClientRect();
        seek(last * Math.min(1, Math.max(0, (event.clientX - box.left - 6) / (box.width - 12))));
    };
    canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); at(event); });
    canvas.addEventListener("pointermove", event => { if (event.buttons) at(event); });
    return { draw, choose: i => { chosen = i; } };
}

/** True if there is no graphics card. `#fine` after the address selects the rendering for graphics cards. */
function drawnBySoftware() {
    if (location.hash.includes("fine")) return false;
    const context = document.createElement("canvas").getContext("webgl2");
    const about = context?.getExtension("WEBGL_debug_renderer_info");
    return about ? /swiftshader|llvmpipe|software|basic render/i.test(context.getParameter(about.UNMASKED_RENDERER_WEBGL)) : false;
}

export async function show(drawing, buffer) {
    const { times, bodies } = drawing, frames = times.count, last = frames - 1;
    const channels = unpack(buffer, drawing.steps, frames);
    await addMeshes(drawing.meshes);
    const isSoft = drawnBySoftware();
    if (isSoft) THREE.ColorManagement.enabled = false;
    const renderer = new THREE.WebGLRenderer({ canvas: element("view"), antialias: !isSoft });
    if (isSoft) renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    const scene = new THREE.Scene(), up = new THREE.Vector3(...drawing.up), size = drawing.size;
    scene.background = new THREE.Color(isSoft && drawing.ground ? 0xeef1f4 : 0xf4f6f8);
    const sky = new THREE.HemisphereLight(0xffffff, 0xb8c0c8, SKY), sun = new THREE.DirectionalLight(0xffffff, SUN);
    sky.position.copy(up);
    const toSun = up.clone().multiplyScalar(5).add(new THREE.Vector3(2, -3, 2));
    if (!isSoft) scene.add(sky, sun, sun.target);
    const camera = new THREE.PerspectiveCamera(40, 1, size / 200, size * 400);
    camera.up.copy(drawing.flat ? new THREE.Vector3(...drawing.up) : up);
    const controls = new OrbitControls(camera, renderer.domElement);
    controls.enableDamping = false;

    const nodes = bodies.map(body => {
        const node = new THREE.Object3D();
        node.name = body.name;
        scene.add(node);
        return node;
    });
    const byName = Object.fromEntries(nodes.map(node => [node.name, node]));
    const owners = bodies.map((body, i) => ({ node: nodes[i], pieces: body.pieces }));
    let channel = 7 * bodies.length * Math.max(1, drawing.takes.length), take = 0;
    const lines = drawing.tracks.map(track => {
        const node = new THREE.Object3D();
        owners.push({ node, pieces: [["sphere", [track.marker, track.marker, track.marker], track.colour, [0, 0, 0], [1, 0, 0, 0]]] });
        channel += 3;
        return makeLine(scene, track, node, channels, channel - 3, frames, size);
    });
    const movePieces = isSoft ? makeMerged(scene, owners, up, toSun.clone().normalize(), size) : makeInstances(scene, owners);
    const arrows = drawing.arrows.map(arrow => { channel += 6; return { ...(arrow.isTorque ? makeArc(scene, arrow) : makeArrow(scene, arrow, size)), from: channel - 6, arrow }; });
    const coilGeometry = coil();
    const springs = drawing.springs.map(spring => {
        const line = new THREE.Line(coilGeometry, new THREE.LineBasicMaterial({ color: 0x3c4043 }));
        line.frustumCulled = false;
        scene.add(line);
        return { line, spring, ends: spring.positions.map(position => new THREE.Vector3(...position)), nodes: spring.bodies.map(name => byName[name]) };
    });
    const moveGround = drawing.ground ? makeGround(scene, drawing, size, isSoft, camera) : () => {};

    const state = { frame: 0, playing: false, speed: 1, follow: drawing.follow, drawn: 0 };
    const before = new THREE.Quaternion(), after = new THREE.Quaternion();
    const a = new THREE.Vector3(), b = new THREE.Vector3(), z = new THREE.Vector3(0, 0, 1);

    const showArrows = element("arrows"), legend = makeLegend(arrows);

    /** Move everything to its position at a frame; fractional frames are interpolated. */
    function pose(frame) {
        const f = Math.min(Math.floor(frame), Math.max(0, last - 1)), s = last ? frame - f : 0, g = Math.min(f + 1, last);
        for (let i = 0; i < nodes.length; i++) {
            const node = nodes[i], c = 7 * (i + take * nodes.length), x = channels[c], y = channels[c + 1], z = channels[c + 2];
            node.position.set(x[f] + s * (x[g] - x[f]), y[f] + s * (y[g] - y[f]), z[f] + s * (z[g] - z[f]));
            before.set(channels[c + 4][f], channels[c + 5][f], channels[c + 6][f], channels[c + 3][f]).normalize();
            after.set(channels[c + 4][g], channels[c + 5][g], channels[c + 6][g], channels[c + 3][g]).normalize();
            node.quaternion.slerpQuaternions(before, after, s);
            node.updateMatrixWorld();
        }
        const near = Math.round(frame);
        for (const { grow } of lines) grow(near);
        movePieces();
        for (const { line, spring, ends, nodes: at } of springs) {
            a.copy(ends[0]);
            b.copy(ends[1]);
            if (at[0]) a.applyMatrix4(at[0].matrixWorld);
            if (at[1]) b.applyMatrix4(at[1].matrixWorld);
            line.position.copy(a);
            const length = Math.max(a.distanceTo(b), 1e-9 * size);
            line.quaternion.setFromUnitVectors(z, b.sub(a).normalize());
            line.scale.set(spring.radius, spring.radius, length);
        }
        // Numbers that change 60 times per second would be unreadable.
        if (!state.playing || near % 6 === 0) legend.update(channels, near);
        for (const { group, point, from, arrow } of arrows) {
            group.position.set(channels[from][near], channels[from + 1][near], channels[from + 2][near]);
            b.set(channels[from + 3][near], channels[from + 4][near], channels[from + 5][near]);
            const length = b.length() * arrow.scale;
            group.visible = showArrows.checked && length > 1e-3 * size && (!legend.alone || legend.alone === arrow);
            if (group.visible) point(length, b.normalize());
        }
    }

    const moving = nodes.some((_, i) => !bodies[i].still) ? nodes.filter((_, i) => !bodies[i].still) : nodes;
    const centre = new THREE.Vector3(), old = new THREE.Vector3();
    function followed(into) {
        if (state.follow === "*") {
            into.set(0, 0, 0);
            for (const node of moving) into.addScaledVector(node.position, 1 / moving.length);
        } else if (byName[state.follow]) into.copy(byName[state.follow].position);
        else return false;
        return true;
    }

    function reset() {
        pose(state.frame);
        const target = new THREE.Vector3(...drawing.centre);
        if (followed(centre)) target.copy(centre).addScaledVector(up, 0.1 * size);
        controls.target.copy(target);
        const aspect = Math.min(1, camera.aspect * 0.8);
        camera.position.copy(target).addScaledVector(a.set(...drawing.eye).normalize(), drawing.distance / aspect);
        controls.update();
    }

    const plot = drawing.curves.length
        ? makePlot(element("plot"), times, drawing.curves, channels, frame => { state.playing = false; set(frame); }) : null;
    if (plot) {
        drawing.curves.forEach((curve, i) => { curve.channel = channel + i; element("curve").add(new Option(curve.unit ? `${curve.name} [${curve.unit}]` : curve.name, i)); });
        element("chart").hidden = false;
        element("curve").addEventListener("change", event => { plot.choose(+event.target.value); draw(); });
    }

    let updatedAt = 0;
    function draw() {
        sun.position.copy(controls.target).addScaledVector(toSun, size);
        sun.target.position.copy(controls.target);
        moveGround(controls.target);
        renderer.render(scene, camera);
        state.drawn++;
        const now = performance.now();
        if (isSoft && state.playing && now - updatedAt < 100) return;
        updatedAt = now;
        const t = times.first + times.step * state.frame;
        element("time").value = state.frame;
        element("clock").textContent = `${t.toFixed(3)} s of ${(times.first + times.step * last).toPrecision(4)} s`;
        element("play").querySelector("path").setAttribute("d", state.playing ? "M3 2h4v12H3zM9 2h4v12H9z" : "M4 2 14 8 4 14z");
        plot?.draw(state.frame);
    }

    /** Go to a frame; the camera follows the selected body. */
    function set(frame) {
        const follows = followed(old);
        state.frame = Math.min(last, Math.max(0, frame));
        pose(state.frame);
        if (follows && followed(centre)) {
            centre.sub(old);
            controls.target.add(centre);
            camera.position.add(centre);
        }
        draw();
    }

    let then = 0, slow = 0, asked = 0;
    /** Show the next frame while the motion plays. A paused motion requests no frames from the browser. */
    function tick(now) {
        asked = 0;
        if (!state.playing) return;
        // Reduce the resolution if the graphics card is slow. In software rendering the number of corners matters, not the number of pixels.
        slow = now - then > 45 ? slow + 1 : Math.max(0, slow - 1);
        if (!isSoft && slow > 12 && renderer.getPixelRatio() > 0.5) { slow = 0; renderer.setPixelRatio(Math.max(0.5, 0.75 * renderer.getPixelRatio())); }
        const ahead = Math.min(0.25, Math.max(0, now - then) / 1000) * state.speed / times.step;
        let frame = state.frame + ahead;
        if (frame >= last) {
            if (element("loop").checked && last) frame = 0; else { frame = last; state.playing = false; }
        }
        then = now;
        if (state.playing) asked = requestAnimationFrame(tick);
        set(frame);
    }

    function start() {
        state.playing = true;
        then = performance.now();
        if (!asked) asked = requestAnimationFrame(tick);
        draw();
    }

    function resize() {
        renderer.setPixelRatio(isSoft ? 1 : Math.min(2, window.devicePixelRatio || 1));
        renderer.setSize(window.innerWidth, window.innerHeight, false);
        camera.aspect = window.innerWidth / window.innerHeight;
        camera.updateProjectionMatrix();
        draw();
    }

    const pause = () => { state.playing = false; draw(); };
    const play = () => { if (state.playing) { pause(); return; } if (state.frame >= last) set(0); start(); };
    element("time").max = last;
    element("time").addEventListener("input", event => { state.playing = false; set(+event.target.value); });
    element("play").addEventListener("click", play);
    element("start").addEventListener("click", () => set(0));
    element("speed").addEventListener("change", event => { state.speed = +event.target.value; });
    drawing.takes.forEach((name, i) => element("take").add(new Option(name, i)));
    element("take-label").hidden = !drawing.takes.length;
    element("take").addEventListener("change", event => { take = +event.target.value; set(state.frame); });
    bodies.forEach(body => element("follow").add(new Option(body.name, body.name)));
    element("follow").value = state.follow;
    element("follow").addEventListener("change", event => { state.follow = event.target.value; if (followed(centre)) { a.copy(centre).sub(controls.target); controls.target.add(a); camera.position.add(a); } controls.update(); draw(); });
    element("reset").addEventListener("click", () => { reset(); draw(); });
    element("tracks").addEventListener("change", event => { lines.forEach(({ line, node }) => { line.visible = event.target.checked; node.scale.setScalar(line.visible ? 1 : 1e-9); }); set(state.frame); });
    if (arrows.length) {
        element("arrows-label").hidden = false;
        element("arrows-label").append(drawing.largest);
    }
    element("arrows").addEventListener("change", () => { element("legend").hidden = !showArrows.checked; set(state.frame); });
    legend.whenAlone = () => set(state.frame);
    if (drawing.speed !== 1) {
        const choice = [...element("speed").options].find(option => +option.value === drawing.speed);
        if (choice) { choice.selected = true; state.speed = drawing.speed; }
    }
    controls.addEventListener("change", () => { if (!state.playing) draw(); });
    window.addEventListener("resize", resize);
    window.addEventListener("keydown", event => {
        if (event.target.matches("select, input[type=checkbox], button") && event.key === " ") return;
        const moves = { ArrowRight: 1, ArrowLeft: -1, PageDown: 60, PageUp: -60 };
        if (event.key === " ") play();
        else if (event.key === "Home") set(0);
        else if (event.key === "End") set(last);
        else if (event.key in moves && !event.target.matches("select")) { state.playing = false; set(Math.round(state.frame) + moves[event.key]); }
        else return;
        event.preventDefault();
    });
    camera.aspect = window.innerWidth / window.innerHeight;
    reset();
    resize();
    set(0);
    if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches && !location.hash.includes("still")) start();

    /** Interface for scripts and tests. */
    return {
        drawing, state, scene, camera, controls, renderer, channels,
        setTime: t => set((t - times.first) / times.step),
        time: () => times.first + times.step * state.frame,
        play: () => { if (!state.playing) play(); }, pause,
        pose: name => ({ position: byName[name].getWorldPosition(new THREE.Vector3()).toArray(), quaternion: byName[name].getWorldQuaternion(new THREE.Quaternion()).toArray() }),
    };
}
