// The trials of a report that can be turned: goal, results and matched pairs of one trial, all seen from one place.
import { THREE } from "./three.js";
import { View } from "./scene.js";

const OUTLINE_DEG = 28;
const FAINT = 0.12; // opacity of the fragments that are not of the pair that is pointed at
const KEYS = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.12], ArrowDown: [0, -0.12], "+": [0, 0, 0.87], "=": [0, 0, 0.87], "-": [0, 0, 1.15] };

let renderer = null; // the only one of the page: browsers allow few

function hasWebGL() {
  const context = document.createElement("canvas").getContext("webgl2");
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return Boolean(context) && "DecompressionStream" in window;
}

// The meshes as they were before `packed_meshes.pack`: vertices in metres of their own frames.
async function unpack({ sizes, data }) {
  const packed = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  let start = 0;
  return sizes.map(([nVertices, nFaces, step, ...low]) => {
    const count = 3 * (nVertices + nFaces);
    const number = (k) => bytes[start + k] + 256 * bytes[start + count + k];
    const vertices = new Float32Array(3 * nVertices);
    for (let axis = 0; axis < 3; axis++) {
      let steps = 0;
      for (let n = 0; n < nVertices; n++) {
        const code = number(axis * nVertices + n);
        steps += code % 2 ? -(code + 1) / 2 : code / 2;
        vertices[3 * n + axis] = low[axis] + step * steps;
      }
    }
    const faces = [];
    let unused = 0;
    for (let k = 0; k < 3 * nFaces; k++) {
      const corner = unused - number(3 * nVertices + k);
      faces.push(corner);
      if (corner === unused) unused += 1;
    }
    start += 2 * count;
    return { vertices, faces };
  });
}

// A mesh in its pose, as `View.update` takes it.
function placed({ vertices, faces }, { rotation: r, position, colour }, scale) {
  const micrometres = new Float32Array(vertices.length);
  for (let n = 0; n < vertices.length; n += 3) {
    for (let axis = 0; axis < 3; axis++) {
      const turned = r[3 * axis] * vertices[n] + r[3 * axis + 1] * vertices[n + 1] + r[3 * axis + 2] * vertices[n + 2];
      micrometres[n + axis] = 1e6 * (scale * turned + position[axis]);
    }
  }
  return { vertices: micrometres, skin: faces, flesh: [], colours: [colour, colour] };
}

function outlineOf({ vertices, skin }, colour) {
  const whole = new THREE.BufferGeometry();
  whole.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(vertices, (number) => number / 1e6), 3));
  whole.setIndex(skin);
  const edges = new THREE.EdgesGeometry(whole, OUTLINE_DEG);
  whole.dispose();
  return new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ color: colour, transparent: true }));
}

class Turnable {
  constructor(figure) {
    this.figure = figure;
    this.views = [];
    this.stage = figure.querySelector(".stage");
    this.start = figure.querySelector(".turn");
    this.start.hidden = false;
    this.start.addEventListener("click", () => this.open());
    this.apart = figure.querySelector(".apart");
    this.apart.addEventListener("input", () => this.spread());
    figure.querySelector(".reset").addEventListener("click", () => this.look());
    figure.querySelector(".close").addEventListener("click", () => this.close());
    for (const chip of figure.querySelectorAll("[data-pair]")) {
      for (const event of ["pointerenter", "focus"]) chip.addEventListener(event, () => this.point(chip.dataset.pair));
      for (const event of ["pointerleave", "blur"]) chip.addEventListener(event, () => this.point(null));
    }
    figure.turnable = this;
  }

  async open() {
    if (this.figure.dataset.state) return;
    this.figure.dataset.state = "opening";
    const { panels, meshes } = JSON.parse(this.figure.querySelector(".fragments").textContent);
    const solids = await unpack(meshes);
    renderer ??= new THREE.WebGLRenderer({ antialias: true });
    this.stage.hidden = false;
    for (const panel of panels) this.views.push(this.show(panel, solids));
    this.figure.dataset.state = "open";
    this.spread();
    this.look();
    this.views[0].canvas.focus({ preventScroll: true });
  }

  show(panel, solids) {
    const cell = document.createElement("div");
    const canvas = document.createElement("canvas");
    const title = document.createElement("p");
    title.textContent = panel.title;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${panel.title} of ${this.figure.dataset.name}. Arrows turn it, plus and minus zoom.`);
    const frame = document.createElement("div");
    frame.className = "frame";
    frame.append(canvas);
    cell.append(title, frame);
    this.stage.querySelector(".panels").append(cell);
    const view = new View(canvas, () => this.moved(view), renderer);
    view.scene.background = new THREE.Color(this.style("--stage"));
    canvas.view = view;
    const bodies = {}, shifts = {}, outlines = [];
    view.pairs = new Map();
    panel.fragments.forEach((fragment, id) => {
      const mesh = placed(solids[fragment.mesh], fragment, panel.scale);
      if (fragment.colour === null) {
        outlines.push([id, outlineOf(mesh, this.style("--ink"))]);
        return;
      }
      bodies[id] = mesh;
      shifts[id] = fragment.shift;
      view.pairs.set(String(id), String(fragment.pair));
    });
    view.update(Object.keys(bodies), bodies, shifts);
    for (const [id, outline] of outlines) view.fragments.get(String(id - 1)).add(outline); // of its partner
    canvas.addEventListener("keydown", (event) => this.key(view, event));
    view.onBoard = panel.board;
    return view;
  }

  style(name) {
    return getComputedStyle(this.figure).getPropertyValue(name).trim();
  }

  key(view, event) {
    if (event.key === "Escape") {
      this.close();
    } else if (event.key === "Home") {
      this.look();
    } else if (KEYS[event.key] && !event.ctrlKey && !event.metaKey && !event.altKey) {
      view.turn(...KEYS[event.key]);
    } else {
      return;
    }
    event.preventDefault();
  }

  // All views look from where the farthest of them must be to see all of its fragments; the pairs, which are not to be
  // compared in size with the others, are enlarged until they fill their view, too.
  look() {
    this.following = true;
    const distances = this.views.map((view) => {
      view.camera.zoom = 1;
      view.camera.updateProjectionMatrix();
      view.look("front");
      view.board.visible = view.onBoard;
      return view.camera.position.distanceTo(view.controls.target);
    });
    const farthest = Math.max(...distances);
    this.views.forEach((view, n) => {
      if (!view.onBoard) view.camera.zoom = farthest / distances[n];
      view.camera.updateProjectionMatrix();
    });
    this.following = false;
    this.moved(this.views[distances.indexOf(farthest)]);
  }

  moved(view) {
    if (this.following) return;
    this.following = true; // a view that follows is not to lead
    for (const other of this.views) if (other !== view) other.follow(view);
    view.draw();
    this.following = false;
  }

  spread() {
    for (const view of this.views) view.setExplode(Number(this.apart.value));
  }

  // Shows one pair, in all views; all of them again for null.
  point(pair) {
    for (const view of this.views) {
      for (const [id, group] of view.fragments) {
        const shown = pair === null || view.pairs.get(id) === pair;
        group.traverse((part) => {
          if (!part.material) return;
          part.userData.opacity ??= part.material.opacity;
          part.material.transparent = !shown || part.isLine;
          part.material.opacity = shown ? part.userData.opacity : FAINT * part.userData.opacity;
          part.material.needsUpdate = true;
        });
      }
      view.draw();
    }
  }

  close() {
    for (const view of this.views) view.dispose();
    this.views = [];
    this.stage.querySelector(".panels").replaceChildren();
    this.stage.hidden = true;
    delete this.figure.dataset.state;
    this.start.focus({ preventScroll: true });
  }
}

async function copyText(button) {
  const code = button.previousElementSibling;
  try {
    await navigator.clipboard.writeText(code.textContent);
  } catch { // a page without rights to the clipboard: select it, and copy as by hand
    getSelection().selectAllChildren(code);
    document.execCommand("copy");
  }
  const words = button.textContent;
  button.textContent = "Copied";
  setTimeout(() => { button.textContent = words; }, 1500);
}

for (const button of document.querySelectorAll("button.copy")) {
  button.hidden = false;
  button.addEventListener("click", () => copyText(button));
}
const figures = [...document.querySelectorAll("figure.trial")].filter((figure) => figure.querySelector(".fragments"));
if (hasWebGL()) {
  for (const figure of figures) new Turnable(figure);
} else {
  for (const note of document.querySelectorAll(".no-webgl")) note.hidden = false;
}
