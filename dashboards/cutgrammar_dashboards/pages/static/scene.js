// Fragments in three dimensions, as all pages show them: metres, z upwards, drawn only when something has changed.
import { THREE, OrbitControls } from "./three.js";

const VIEWS = { front: [0.12, -1.0, 0.72], top: [0.0, -0.02, 1.0], side: [1.0, -0.12, 0.5], back: [-0.12, 1.0, 0.72] };
const HALVES = [["#3a86c8", "#8fbfe6"], ["#e08a1e", "#f4c27d"]];
const CREASE_DEG = 28;
const GAP = 0.004; // between the halves of a preview [m]
const FILL = 0.72; // share of the picture's width or height that the fragments fill
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7];

function cornerOf({ min, max }, k) {
  return new THREE.Vector3(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z);
}

function geometriesOf(mesh) {
  const points = new THREE.BufferAttribute(Float32Array.from(mesh.vertices, (number) => number / 1e6), 3);
  const part = (faces) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", points);
    geometry.setIndex(faces);
    return geometry;
  };
  const skin = part(mesh.skin);
  skin.computeVertexNormals();
  const flesh = part(mesh.flesh).toNonIndexed();
  flesh.computeVertexNormals();
  return { skin, flesh, all: part(mesh.skin.concat(mesh.flesh)) };
}

function bodyOf(mesh, colours) {
  const group = new THREE.Group();
  const { skin, flesh, all } = geometriesOf(mesh);
  [skin, flesh].forEach((geometry, i) => {
    if (geometry.getAttribute("position").count && (geometry.index?.count ?? 1)) {
      group.add(new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: colours[i], side: THREE.DoubleSide })));
    }
  });
  const edges = new THREE.EdgesGeometry(all, CREASE_DEG);
  group.add(new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ color: "#3b2a1a", transparent: true, opacity: 0.55 })));
  group.userData.box = new THREE.Box3().setFromBufferAttribute(all.getAttribute("position"));
  all.dispose();
  return group;
}

function dispose(group) {
  group.traverse((part) => {
    part.geometry?.dispose();
    part.material?.dispose();
  });
  group.removeFromParent();
}

export class View {
  // onMove: called when the person turns, moves or zooms the view.
  // renderer: one that several views share, because a browser allows few; each view then shows a copy of its picture.
  constructor(canvas, onMove = () => {}, renderer = null) {
    this.canvas = canvas;
    this.copy = renderer && canvas.getContext("2d");
    this.fragments = new Map();
    this.shifts = {};
    this.explode = 0;
    this.halves = null;
    this.afterDraw = () => {};
    this.renderer = renderer ?? new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color("#dfe5ea");
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.01, 20);
    this.camera.up.set(0, 0, 1);
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#b9a58c", 2.0));
    const lamp = new THREE.DirectionalLight("#ffffff", 1.6);
    lamp.position.set(-0.4, -0.7, 1.2);
    this.scene.add(lamp);
    this.board = new THREE.Mesh(new THREE.BoxGeometry(1, 1, 0.012), new THREE.MeshLambertMaterial({ color: "#c9a87c" }));
    this.scene.add(this.board);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.06;
    this.controls.maxDistance = 3;
    this.controls.addEventListener("change", () => {
      onMove();
      this.draw();
    });
    this.quiet = false;
    this.observer = new ResizeObserver(() => this.#resize());
    this.observer.observe(canvas.parentElement);
    this.#resize();
  }

  // Replaces what is shown: `fresh` are new meshes by id, `alive` the ids that stay, `shifts` how they move apart.
  update(alive, fresh, shifts) {
    const stay = new Set(alive.map(String));
    for (const [id, group] of this.fragments) {
      if (!stay.has(id)) {
        dispose(group);
        this.fragments.delete(id);
      }
    }
    for (const [id, mesh] of Object.entries(fresh)) {
      if (this.fragments.has(id)) dispose(this.fragments.get(id));
      const group = bodyOf(mesh, mesh.colours);
      this.fragments.set(id, group);
      this.scene.add(group);
    }
    this.shifts = shifts;
    this.setExplode(this.explode);
  }

  setExplode(share) {
    this.explode = share;
    for (const [id, group] of this.fragments) group.position.fromArray(this.shifts[id].map((part) => share * part));
    this.draw();
  }

  // Shows both halves of fragment `id`, a little apart, and the plane n.v + d = 0 between them.
  showHalves(id, above, below, normal, offset) {
    this.hideHalves();
    const whole = this.fragments.get(String(id));
    whole.visible = false;
    this.halves = new THREE.Group();
    this.halves.userData.of = whole;
    this.halves.position.copy(whole.position);
    const n = new THREE.Vector3(...normal);
    [above, below].forEach((side, i) => {
      for (const mesh of side) {
        const half = bodyOf(mesh, HALVES[i]);
        half.position.copy(n).multiplyScalar(i ? -GAP / 2 : GAP / 2);
        this.halves.add(half);
      }
    });
    const { centre, radius } = this.#sphereOf(whole.userData.box);
    const distance = n.dot(centre) + offset;
    const plane = new THREE.Mesh(
      new THREE.PlaneGeometry(2.3 * radius, 2.3 * radius),
      new THREE.MeshBasicMaterial({ color: "#d62828", transparent: true, opacity: 0.22, side: THREE.DoubleSide, depthWrite: false }),
    );
    plane.position.copy(centre).addScaledVector(n, -distance);
    plane.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), n);
    this.halves.add(plane);
    this.scene.add(this.halves);
    this.draw();
  }

  hideHalves() {
    if (!this.halves) return;
    this.halves.userData.of.visible = true;
    dispose(this.halves);
    this.halves = null;
    this.draw();
  }

  // Looks at everything from "front", "top", "side" or "back".
  look(name) {
    this.#resize(); // the page may have been laid out anew just now
    const box = this.#bounds();
    const { centre, radius } = this.#sphereOf(box);
    const half = THREE.MathUtils.degToRad(this.camera.fov / 2);
    const narrow = Math.min(half, Math.atan(Math.tan(half) * this.camera.aspect));
    const towards = new THREE.Vector3(...VIEWS[name]).normalize();
    let distance = radius / Math.sin(narrow);
    for (let round = 0; round < 4; round++) { // the box has to fill its share of the picture
      this.camera.position.copy(centre).addScaledVector(towards, distance);
      this.camera.lookAt(centre);
      this.camera.updateMatrixWorld();
      const seen = CORNERS.map((k) => cornerOf(box, k).project(this.camera));
      distance *= Math.max(...seen.map(({ x, y }) => Math.max(Math.abs(x), Math.abs(y)))) / FILL;
    }
    this.camera.position.copy(centre).addScaledVector(towards, distance);
    this.controls.target.copy(centre);
    const size = box.getSize(new THREE.Vector3());
    this.board.scale.set(size.x + 0.09, size.y + 0.09, 1);
    this.board.position.set(centre.x, centre.y, -0.0065);
    this.controls.update();
    this.draw();
  }

  // Looks from where another view looks.
  follow(other) {
    this.camera.position.copy(other.camera.position);
    this.camera.quaternion.copy(other.camera.quaternion);
    this.controls.target.copy(other.controls.target);
    this.draw();
  }

  // Turns the view by angles to the right and upwards [rad], and zooms by a factor.
  turn(right, up, zoom = 1) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.applyAxisAngle(new THREE.Vector3(0, 0, 1), right);
    const flat = Math.hypot(offset.x, offset.y);
    const height = Math.atan2(offset.z, flat) + up;
    const lifted = Math.min(Math.max(height, -1.55), 1.55);
    const length = offset.length() * zoom;
    const heading = Math.atan2(offset.y, offset.x);
    offset.set(Math.cos(heading) * Math.cos(lifted), Math.sin(heading) * Math.cos(lifted), Math.sin(lifted));
    this.camera.position.copy(this.controls.target).addScaledVector(offset, length);
    this.controls.update();
  }

  // The eye and the unit direction through a place on the page, in metres of the world.
  rayAt(x, y) {
    const frame = this.canvas.getBoundingClientRect();
    this.camera.updateMatrixWorld();
    const through = new THREE.Vector3(
      (2 * (x - frame.left)) / frame.width - 1, 1 - (2 * (y - frame.top)) / frame.height, 0.5,
    ).unproject(this.camera);
    return { eye: this.camera.position.toArray(), direction: through.sub(this.camera.position).normalize().toArray() };
  }

  // Where a point of the world is on the canvas, in CSS pixels of the page.
  placeOf(point) {
    const frame = this.canvas.getBoundingClientRect();
    this.camera.updateMatrixWorld();
    const seen = new THREE.Vector3(...point).project(this.camera);
    return { x: frame.left + ((seen.x + 1) / 2) * frame.width, y: frame.top + ((1 - seen.y) / 2) * frame.height };
  }

  // The rectangle that a fragment covers on the page.
  boxOf(id) {
    const group = this.fragments.get(String(id));
    const box = group.userData.box.clone().translate(group.position);
    const places = CORNERS.map((k) => this.placeOf(cornerOf(box, k).toArray()));
    const xs = places.map((place) => place.x), ys = places.map((place) => place.y);
    return { left: Math.min(...xs), right: Math.max(...xs), top: Math.min(...ys), bottom: Math.max(...ys) };
  }

  draw() {
    if (this.quiet) return;
    this.quiet = true;
    requestAnimationFrame(() => {
      this.quiet = false;
      if (this.copy) this.#matchRenderer();
      this.renderer.render(this.scene, this.camera);
      this.copy?.drawImage(this.renderer.domElement, 0, 0);
      this.afterDraw();
    });
  }

  // Frees all that the view holds; a renderer of its own with it.
  dispose() {
    this.quiet = true;
    this.observer.disconnect();
    this.controls.dispose();
    this.update([], {}, {});
    dispose(this.board);
    if (!this.copy) this.renderer.dispose();
  }

  // Gives the shared renderer the size of this view.
  #matchRenderer() {
    const { width, height } = this.renderer.domElement;
    if (width !== this.canvas.width || height !== this.canvas.height) {
      const ratio = this.renderer.getPixelRatio();
      this.renderer.setSize(this.canvas.width / ratio, this.canvas.height / ratio, false);
    }
  }

  #bounds() {
    const box = new THREE.Box3();
    for (const group of this.fragments.values()) box.union(group.userData.box.clone().translate(group.position));
    return box.isEmpty() ? new THREE.Box3(new THREE.Vector3(-0.1, -0.1, 0), new THREE.Vector3(0.1, 0.1, 0.05)) : box;
  }

  #sphereOf(box) {
    const sphere = box.getBoundingSphere(new THREE.Sphere());
    return { centre: sphere.center, radius: sphere.radius };
  }

  #resize() {
    const { clientWidth, clientHeight } = this.canvas.parentElement;
    if (!clientWidth || !clientHeight) return;
    if (this.copy) {
      const ratio = this.renderer.getPixelRatio();
      this.canvas.width = Math.floor(clientWidth * ratio);
      this.canvas.height = Math.floor(clientHeight * ratio);
    } else {
      this.renderer.setSize(clientWidth, clientHeight, false);
    }
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.draw();
  }
}
