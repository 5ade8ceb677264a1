// The 3-D view: robot, world, trace, force arrows and cameras.
import {
  AmbientLight, BufferAttribute, BufferGeometry, CanvasTexture, Color, ConeGeometry, CylinderGeometry,
  DirectionalLight, DoubleSide, FrontSide, Group, HemisphereLight, Line, LineBasicMaterial,
  LineSegments, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Points, PointsMaterial,
  Quaternion, RingGeometry, Scene, SRGBColorSpace, Sprite, SpriteMaterial, Vector3, WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { decode } from './frames.js';

const UP = new Vector3(0, 0, 1);
const FOV = 45; // degrees, vertical
const ASPECT = 1.3; // as in views3d.py
const FORCE_SCALE = 0.04; // length of an arrow, in m for each N ...
const FORCE_MOST = 0.8; // ... up to this length (m)
const FELT = 0.2; // N, above which a ring marks a contact: force estimates of hands are noisy
const MEASURED = 0xb3005e, DEMANDED = 0x1b1b1b; // different lightness; demanded arrows are thinner
const TRACE = 20000; // most points of the trace

const colour = ([r, g, b]) => new Color().setRGB(r / 255, g / 255, b / 255, SRGBColorSpace);

class Arrow {
  constructor(scene, hex, thin) {
    const r = thin ? 0.006 : 0.011;
    const material = new MeshBasicMaterial({ color: hex, transparent: true, opacity: thin ? 0.75 : 1 });
    this.shaft = new Mesh(new CylinderGeometry(r, r, 1, 10).translate(0, 0.5, 0), material);
    this.head = new Mesh(new ConeGeometry(3 * r, 8 * r, 14).translate(0, -4 * r, 0), material);
    this.group = new Group();
    this.group.add(this.shaft, this.head);
    this.group.visible = false;
    this.reach = 8 * r;
    scene.add(this.group);
  }

  // Draws the arrow from an origin along a unit vector, with a length in metres.
  set(origin, direction, length) {
    this.group.visible = length > 1e-3;
    if (!this.group.visible) return;
    this.group.position.copy(origin);
    this.group.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), direction);
    const slim = Math.min(1, Math.max(0.2, length / 0.35)); // must not hide its contact
    this.shaft.scale.set(slim, Math.max(length - 0.8 * slim * this.reach, 1e-3), slim);
    this.head.scale.setScalar(slim);
    this.head.position.y = length;
  }
}

// Returns lines on the ground every metre, up to `half` metres from W's origin. They are drawn metre
// by metre, because renderers without a GPU leave out a line that ends behind the camera.
function drawGrid(half) {
  const axes = [], others = [];
  for (let i = -half; i <= half; i += 1) {
    for (let k = -half; k < half; k += 1) {
      (i === 0 ? axes : others).push(i, k, 0, i, k + 1, 0, k, i, 0, k + 1, i, 0);
    }
  }
  return [[axes, 0xaab3bd], [others, 0xd4d9df]].map(([places, color]) => {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(new Float32Array(places), 3));
    return new LineSegments(geometry, new LineBasicMaterial({ color }));
  });
}

export class View {
  constructor(canvas, labels) {
    this.canvas = canvas;
    this.labelBox = labels;
    this.forceBox = document.getElementById('forces');
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene = new Scene();
    this.scene.background = new Color(0xf4f5f7);
    this.camera = new PerspectiveCamera(FOV, 1, 0.02, 200);
    this.camera.up.copy(UP);
    this.camera.position.set(-3, -4, 2.5);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.listenToKeyEvents(canvas); // arrow keys move the view
    this.orbit.addEventListener('start', () => { if (this.mode !== 'first person') this.free(); });
    this.orbit.addEventListener('change', () => { this.dirty = true; });
    canvas.addEventListener('webglcontextrestored', () => { this.dirty = true; });
    this.orbit.target.set(0, 0, 1);
    this.scene.add(new HemisphereLight(0xffffff, 0x8a93a0, 2.2), new AmbientLight(0xffffff, 0.3));
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.set(-3, -4, 8);
    this.scene.add(sun);
    this.scene.add(...drawGrid(15));
    this.mode = 'free';
    this.onmode = () => {};
    this.world = new Group();
    this.scene.add(this.world);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
  }

  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    this.renderer.setSize(box.width, box.height, false);
    this.camera.aspect = box.width / Math.max(box.height, 1);
    this.setLens();
  }

  // The views of a run are placed for windows of ASPECT or wider. In a narrower one the vertical
  // angle grows, so that the horizontal one, and what it shows, stay.
  setLens() {
    const own = this.data?.camera.name === this.mode;
    const grow = own ? 1 : Math.max(1, ASPECT / Math.max(this.camera.aspect, 0.1));
    const half = Math.tan((own ? this.data.camera.fov : FOV) * Math.PI / 360);
    this.camera.fov = Math.atan(half * grow) * 360 / Math.PI;
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  // Draws the scene of a run in place of the previous one.
  load(data) {
    this.world.traverse((o) => { o.geometry?.dispose?.(); o.material?.dispose?.(); });
    this.scene.remove(this.world);
    this.world = new Group();
    this.scene.add(this.world);
    this.data = data;
    this.labels = [];
    this.labelBox.replaceChildren();
    this.parts = data.parts.map((p) => {
      const group = new Group();
      group.position.fromArray(p.p);
      group.quaternion.set(p.q[1], p.q[2], p.q[3], p.q[0]);
      return group;
    });
    data.parts.forEach((p, i) => (p.parent < 0 ? this.world : this.parts[p.parent]).add(this.parts[i]));
    this.later = [];
    for (const item of data.meshes) {
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(decode(item.v, Float32Array), 3));
      geometry.setIndex(new BufferAttribute(decode(item.f, Uint32Array), 1));
      geometry.computeVertexNormals();
      const material = new MeshLambertMaterial({
        color: colour(item.rgb), transparent: item.a < 1, opacity: item.a,
        side: item.double ? DoubleSide : FrontSide, depthWrite: item.a >= 1,
      });
      const mesh = new Mesh(geometry, material);
      (item.part < 0 ? this.world : this.parts[item.part]).add(mesh);
      if (item.since !== undefined) {
        mesh.visible = false;
        this.later.push([item.since, mesh]);
      }
    }
    for (const item of data.lines) {
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(decode(item.v, Float32Array), 3));
      this.world.add(new LineSegments(geometry, new LineBasicMaterial({ color: colour(item.rgb) })));
    }
    for (const item of data.arrows) {
      const from = new Vector3().fromArray(item.from), way = new Vector3().fromArray(item.to).sub(from);
      const arrow = new Arrow(this.world, colour(item.rgb), false);
      const length = way.length();
      arrow.set(from, way.normalize(), length);
    }
    for (const item of data.labels) this.label(new Vector3().fromArray(item.p), item.text);
    this.forces = data.layout.arrows.map((a) => ({
      ...a, arrow: new Arrow(this.world, a.demanded ? DEMANDED : MEASURED, a.demanded),
      ring: !a.demanded && a.name !== 'platform, felt' ? this.addRing() : null,
    }));
    this.resetTrace();
    const [, position, look] = data.views[0];
    this.camera.position.fromArray(position);
    this.orbit.target.fromArray(look);
    this.look(data.views[0][0]);
    this.dirty = true;
  }

  resetTrace() {
    if (this.trace) { this.world.remove(this.trace, this.line); this.trace.geometry.dispose(); }
    const geometry = new BufferGeometry();
    this.tracePoints = new BufferAttribute(new Float32Array(3 * TRACE), 3);
    this.traceColours = new BufferAttribute(new Float32Array(3 * TRACE), 3);
    geometry.setAttribute('position', this.tracePoints);
    geometry.setAttribute('color', this.traceColours);
    geometry.setDrawRange(0, 0);
    this.line = new Line(geometry, new LineBasicMaterial({ vertexColors: true }));
    this.trace = new Points(geometry, new PointsMaterial({ vertexColors: true, size: 3.5, sizeAttenuation: false }));
    this.line.frustumCulled = this.trace.frustumCulled = false;
    this.world.add(this.trace, this.line);
    this.traced = 0;
  }

  // Adds a point to the trace: x, y, z, quality.
  addTrace(x, y, z, quality) {
    if (!Number.isFinite(x)) return;
    if (this.traced >= TRACE) { // removes the older half
      for (const a of [this.tracePoints, this.traceColours]) a.array.copyWithin(0, 3 * (TRACE / 2));
      this.traced = TRACE / 2;
    }
    this.tracePoints.setXYZ(this.traced, x, y, z);
    const c = colour(this.data.qualities[quality] ?? this.data.qualities[0]);
    this.traceColours.setXYZ(this.traced, c.r, c.g, c.b);
    this.traced++;
    this.tracePoints.needsUpdate = this.traceColours.needsUpdate = true;
    this.trace.geometry.setDrawRange(0, this.traced);
    this.dirty = true;
  }

  // Shows only the first `n` points of the trace.
  cutTrace(n) {
    this.trace.geometry.setDrawRange(0, Math.min(n, this.traced));
    this.dirty = true;
  }

  // Moves all parts to a frame at time t (s).
  show(row, layout, t) {
    for (let i = 0; i < layout.parts; i++) {
      const k = 7 * i;
      if (!Number.isFinite(row[k] + row[k + 3])) continue;
      this.parts[i].position.set(row[k], row[k + 1], row[k + 2]);
      this.parts[i].quaternion.set(row[k + 4], row[k + 5], row[k + 6], row[k + 3]);
    }
    this.forces.forEach((f, i) => {
      if (f.ring) f.ring.visible = false;
      const k = layout.arrows + 6 * i;
      const origin = new Vector3(row[k], row[k + 1], row[k + 2]);
      const force = new Vector3(row[k + 3], row[k + 4], row[k + 5]);
      const size = force.length();
      f.newton = Number.isFinite(size) ? size : 0;
      if (!Number.isFinite(size) || size < 1e-6) { f.arrow.group.visible = false; return; }
      const way = force.clone().divideScalar(size);
      f.arrow.set(origin, way, Math.min(FORCE_SCALE * size, FORCE_MOST));
      if (f.ring && size > FELT) {
        f.ring.visible = true;
        f.ring.position.copy(origin);
        f.ring.quaternion.setFromUnitVectors(UP, way);
      }
    });
    for (const [since, mesh] of this.later) mesh.visible = t >= since;
    this.tellForces();
    this.dirty = true;
  }

  // Adds a ring that marks the contact of a tip or hand.
  addRing() {
    const ring = new Mesh(new RingGeometry(0.012, 0.022, 28),
      new MeshBasicMaterial({ color: MEASURED, side: DoubleSide, transparent: true, opacity: 0.85 }));
    ring.visible = false;
    this.world.add(ring);
    return ring;
  }

  // Writes the forces as text: measured and demanded.
  tellForces() {
    const lines = [];
    for (const f of this.forces) {
      if (f.demanded) continue;
      const asked = this.forces.find((g) => g.demanded && g.name === f.name);
      if (f.newton > 0.05 || (asked?.newton ?? 0) > 0.05) {
        lines.push(`${f.name}: ${f.newton.toFixed(1)} N${asked?.newton > 0.05 ? `, demanded ${asked.newton.toFixed(1)} N` : ''}`);
      }
    }
    this.forceBox.replaceChildren(...lines.map((text) => {
      const line = document.createElement('div');
      line.textContent = text;
      return line;
    }));
  }

  label(place, text) {
    const element = document.createElement('span');
    element.textContent = text;
    this.labelBox.append(element);
    this.labels.push([place, element]);
  }

  get names() {
    return [...this.data.views.map((v) => v[0]), 'follow', 'from below', this.data.camera.name];
  }

  // Selects the camera: a view of the run, following the robot, from below it, or the robot's own.
  look(name) {
    if (!this.data || !this.names.includes(name)) return false;
    this.mode = name;
    this.setLens();
    this.orbit.enabled = name !== this.data.camera.name;
    const view = this.data.views.find((v) => v[0] === name);
    this.camera.up.copy(UP);
    if (view) {
      this.camera.position.fromArray(view[1]);
      this.orbit.target.fromArray(view[2]);
    }
    this.last = null;
    this.onmode(name);
    this.dirty = true;
    return true;
  }

  free() {
    if (['follow', 'from below', 'free'].includes(this.mode)) return;
    this.mode = 'free';
    this.onmode('free');
  }

  place() {
    const body = this.parts?.[0];
    if (!body) return;
    this.world.updateMatrixWorld();
    const at = new Vector3().setFromMatrixPosition(body.matrixWorld);
    if (this.mode === 'follow' || this.mode === 'from below') {
      if (!this.last) {
        const away = this.mode === 'follow' ? new Vector3(-1.1, -1.7, 0.8) : new Vector3(-0.9, -1.1, -0.9);
        this.camera.position.copy(at).add(away);
      } else this.camera.position.add(at.clone().sub(this.last));
      this.last = at.clone();
      this.orbit.target.copy(at);
    } else if (this.data && this.mode === this.data.camera.name) {
      const c = this.data.camera, q = new Quaternion();
      this.parts[c.part].getWorldQuaternion(q);
      const turn = (v) => new Vector3().fromArray(v).applyQuaternion(q);
      this.camera.position.setFromMatrixPosition(this.parts[c.part].matrixWorld).add(turn(c.position));
      this.camera.up.copy(turn(c.up));
      this.camera.lookAt(this.camera.position.clone().add(turn(c.forward)));
      return;
    }
    this.orbit.update();
  }

  // Draws the scene only if it has changed: an unchanged picture costs nothing.
  render() {
    if (!this.data) return;
    this.place();
    if (!this.dirty) return;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    const { clientWidth: w, clientHeight: h } = this.canvas;
    for (const [place, element] of this.labels) {
      const p = place.clone().project(this.camera);
      element.hidden = p.z > 1;
      element.style.transform = `translate(${((p.x + 1) / 2) * w}px, ${((1 - p.y) / 2) * h}px)`;
    }
  }
}
