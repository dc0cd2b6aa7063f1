// The demonstration page: two clicks define a cut, both halves are shown, then the cut is made.
import { View } from "./scene.js";
import { Problem, RETRY, send } from "./server.js";

const $ = (id) => document.getElementById(id);
const MOVED = { mouse: 5, pen: 8, touch: 12 }; // a press that moves farther turns the view and is no click [pixels]

let key = "", code = "", after = 0, shown = null, shownAt = 0, baseSeconds = 0;
let first = null; // the first click: place, ray, time
let stroke = null; // both clicks, while the halves are shown
let press = null, busy = false, robot = navigator.webdriver === true;

const canvas = $("canvas");
const view = new View(canvas, () => {
  dropFirst();
  goalView?.follow(view);
});
let goalView = null; // of a goal to be reproduced: both views are turned together
canvas.view = view;
view.afterDraw = placeLabels;

const seconds = () => baseSeconds + (performance.now() - shownAt) / 1000;

function say(text, kind = "") {
  $("message").textContent = text;
  $("message").className = kind;
}

function setState(name) {
  document.body.dataset.state = name;
  $("cut").disabled = name !== "preview" || busy;
  $("cancel").disabled = !(name === "first" || name === "preview") || busy;
  for (const id of ["undo", "save"]) $(id).disabled = name !== "ready" || busy || !shown || shown.cuts === 0;
}

// --- talking to the server -------------------------------------------------------------------------------------------

const ask = (path, message) => send(path, key, message);

// Carries out an action; while it runs, all buttons wait.
async function act(work) {
  if (busy) return;
  busy = true;
  setState(document.body.dataset.state);
  try {
    await work();
  } catch (problem) {
    if (!(problem instanceof Problem)) throw problem;
    await explain(problem);
  } finally {
    busy = false;
    setState(document.body.dataset.state);
  }
}

async function explain(problem) {
  if (problem.status === 0) {
    cancel();
    await reconnect();
  } else if (problem.status === 409) {
    cancel();
    try {
      show(await ask("/api/state"));
      say("This page was out of date; it shows your last cut again.", "problem");
    } catch (other) {
      if (!(other instanceof Problem)) throw other;
      say(other.message, "problem");
    }
  } else if (problem.status === 403) {
    cancel();
    setState("joining");
    $("join-problem").textContent = problem.message;
    $("join-problem").hidden = false;
    $("join").showModal();
  } else {
    if (problem.status === 422) cancel();
    say(problem.message, "problem");
  }
}

async function reconnect() {
  setState("lost");
  say("The server does not answer. Your cuts so far are kept. Trying again …", "problem");
  for (;;) {
    await new Promise((resume) => setTimeout(resume, RETRY));
    try {
      const before = shown?.task?.trial;
      await join(code, true);
      if (shown && shown.task.trial === before) say("Connected again. You continue at your last cut.", "good");
      else if (shown) say("Connected again. Your demonstration was saved or is with somebody else; this is your next task.", "good");
      return;
    } catch (problem) {
      if (!(problem instanceof Problem) || ![0, 507].includes(problem.status)) throw problem;
      if (problem.status === 507) say(problem.message, "problem");
    }
  }
}

async function join(entered, quietly = false) {
  const answer = await ask("/api/join", { code: entered, robot });
  key = answer.key;
  code = entered;
  sessionStorage.setItem("code", code);
  progress(answer.progress);
  if (!answer.task) {
    shown = null;
    setState("done");
    $("done-text").textContent =
      answer.progress[0] === answer.progress[1]
      ? "All tasks are done."
      : "Others are working on the tasks that are left. A task that somebody leaves for an hour becomes free again: " +
        "come back later with the same code.";
    $("done").showModal();
    return;
  }
  show(answer);
  if (answer.cuts > 0 && !quietly) {
    const cuts = answer.cuts === 1 ? "1 cut" : `${answer.cuts} cuts`;
    $("resumed-text").textContent = `${answer.task.instructions.join(" ")} You have made ${cuts} so far.`;
    $("resumed").showModal();
  }
}

// --- showing ---------------------------------------------------------------------------------------------------------

function progress([saved, total]) {
  $("progress-text").textContent = `${saved} of ${total} tasks saved`;
  $("progress-bar").max = total;
  $("progress-bar").value = saved;
}

// Shows a whole state, as the server sends it for a new or resumed task.
function show(state) {
  shown = state;
  baseSeconds = state.seconds;
  shownAt = performance.now();
  const { instructions, categories } = state.task;
  $("instruction").textContent = instructions.join("\n");
  $("sides").hidden = !instructions.some((text) => /left/.test(text));
  $("examples").replaceChildren(...categories.map((category) => {
    const figure = document.createElement("figure");
    const image = document.createElement("img");
    image.src = `/examples/${category}.png`;
    image.alt = `An example: a food cut into ${category}`;
    const caption = document.createElement("figcaption");
    caption.textContent = `Example: ${category}`;
    figure.append(image, caption);
    return figure;
  }));
  $("explode").value = 0;
  view.hideHalves();
  view.update([], {}, {});
  view.explode = 0;
  change(state);
  showGoal(state.goal);
  view.look("front");
  setState("ready");
  say("Click at one side of the food, then at the other.");
}

function showGoal(goal) {
  $("goal-stage").hidden = !goal;
  if (!goal) return;
  goalView ??= new View($("goal"), () => {
    dropFirst();
    view.follow(goalView);
  });
  $("goal").view = goalView;
  goalView.update([], {}, {});
  goalView.explode = 0;
  goalView.update(Object.keys(goal.new), goal.new, goal.shifts);
  goalView.look("front");
}

// Shows what an action has changed.
function change(state) {
  after = state.after;
  shown = { ...shown, ...state };
  view.update(state.alive, state.new, state.shifts);
  const fragments = state.alive.length;
  $("count").textContent = `${fragments} ${fragments === 1 ? "fragment" : "fragments"}`;
}

function placeLabels() {
  const frame = canvas.getBoundingClientRect();
  const names = shown?.names ?? [];
  const texts = names.length < 2 ? [] : names.map((name, number) => {
    const boxes = shown.alive.filter((_, i) => shown.objects[i] === number).map((id) => view.boxOf(id));
    const leftmost = boxes.reduce((a, b) => (b.left < a.left ? b : a));
    const text = document.createElementNS("http://www.w3.org/2000/svg", "text");
    text.setAttribute("x", Math.max(leftmost.left - frame.left - 8, 8 * name.length + 4));
    text.setAttribute("y", (leftmost.top + leftmost.bottom) / 2 - frame.top + 5);
    text.textContent = name;
    return text;
  });
  $("labels").replaceChildren(...texts);
}

// --- cutting ---------------------------------------------------------------------------------------------------------

function knife(x, y) {
  const frame = canvas.getBoundingClientRect();
  const set = (element, values) => Object.entries(values).forEach(([name, value]) => element.setAttribute(name, value));
  const from = { x: first.x - frame.left, y: first.y - frame.top }, to = { x: x - frame.left, y: y - frame.top };
  set($("knife"), { x1: from.x, y1: from.y, x2: to.x, y2: to.y });
  set($("first"), { cx: from.x, cy: from.y });
  $("knife").removeAttribute("hidden");
  $("first").removeAttribute("hidden");
}

function hideKnife() {
  $("knife").setAttribute("hidden", "");
  $("first").setAttribute("hidden", "");
}

// Both clicks need one view: the first one is dropped when the view moves.
function dropFirst() {
  if (!first || stroke) return;
  first = null;
  hideKnife();
  setState("ready");
  say("The view has moved: click at one side of the food again.");
}

function cancel() {
  first = null;
  stroke = null;
  hideKnife();
  view.hideHalves();
  if (shown) {
    setState("ready");
    say("Click at one side of the food, then at the other.");
  }
}

function click(x, y, trusted) {
  if (busy || !["ready", "first"].includes(document.body.dataset.state)) return;
  robot ||= !trusted;
  const ray = view.rayAt(x, y);
  if (!first) {
    first = { x, y, ray, seconds: seconds() };
    knife(x, y);
    setState("first");
    say("Now click at the other side.");
    return;
  }
  stroke = {
    eye: first.ray.eye, first: first.ray.direction, second: ray.direction, explode: view.explode,
    first_seconds: first.seconds, second_seconds: seconds(),
  };
  knife(x, y);
  act(async () => {
    const halves = await ask("/api/preview", { ...stroke, after, seconds: seconds(), robot });
    view.showHalves(halves.fragment, halves.above, halves.below, halves.normal, halves.offset);
    first = null;
    hideKnife();
    setState("preview");
    say("Both halves are shown. Turn the view to look. Cut here?");
  });
}

const makeCut = () => act(async () => {
  if (!stroke) return;
  const answer = await ask("/api/cut", { ...stroke, after, seconds: seconds(), robot });
  stroke = null;
  view.hideHalves();
  change(answer);
  setState("ready");
  say("Cut. It is kept.", "good");
});

const undo = () => act(async () => {
  if (!shown?.cuts) return;
  cancel();
  change(await ask("/api/undo", { after, seconds: seconds(), robot }));
  say("The last cut is undone.");
});

const save = () => act(async () => {
  if (!shown?.cuts) return;
  cancel();
  const answer = await ask("/api/save", { after, seconds: seconds(), robot });
  progress(answer.progress);
  setState("saved");
  const [saved, total] = answer.progress;
  $("saved-text").textContent = `Your demonstration is on disk as trial ${answer.saved}. ${saved} of ${total} tasks are saved.`;
  say("");
  $("saved").showModal();
});

// --- input -----------------------------------------------------------------------------------------------------------

canvas.addEventListener("pointerdown", (event) => {
  press = event.isPrimary && event.button === 0 ? { x: event.clientX, y: event.clientY, id: event.pointerId } : null;
});
canvas.addEventListener("pointermove", (event) => {
  if (press && Math.hypot(event.clientX - press.x, event.clientY - press.y) > MOVED[event.pointerType]) press = null;
  if (first && !stroke && event.isPrimary) knife(event.clientX, event.clientY);
});
canvas.addEventListener("pointercancel", () => { press = null; });
canvas.addEventListener("pointerup", (event) => {
  if (press && press.id === event.pointerId) click(press.x, press.y, event.isTrusted);
  press = null;
});

function explode(share) {
  $("explode").value = share;
  if (first || stroke) cancel();
  view.setExplode(Number(share));
  goalView?.setExplode(Number(share));
}

$("explode").addEventListener("input", (event) => explode(event.target.value));
$("cut").addEventListener("click", makeCut);
$("cancel").addEventListener("click", cancel);
$("undo").addEventListener("click", undo);
$("save").addEventListener("click", save);
for (const button of document.querySelectorAll("[data-view]")) {
  button.addEventListener("click", () => view.look(button.dataset.view));
}

const KEYS = {
  Enter: makeCut, Escape: cancel, u: undo, s: save, e: () => explode(view.explode > 0 ? 0 : 1),
  1: () => view.look("front"), 2: () => view.look("top"), 3: () => view.look("side"),
  ArrowLeft: () => view.turn(-0.08, 0), ArrowRight: () => view.turn(0.08, 0),
  ArrowUp: () => view.turn(0, 0.08), ArrowDown: () => view.turn(0, -0.08),
  "+": () => view.turn(0, 0, 0.9), "-": () => view.turn(0, 0, 1 / 0.9),
};

document.addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]") || busy) return;
  const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const command = event.ctrlKey || event.metaKey;
  if (command && name === "z") undo();
  else if (command && name === "s") save();
  else if (command || event.altKey || !KEYS[name] || !shown) return;
  else if (["BUTTON", "SUMMARY"].includes(event.target.tagName) && name === "Enter") return;
  else if (event.target.tagName === "INPUT" && name.startsWith("Arrow")) return;
  else KEYS[name]();
  event.preventDefault();
});

$("join").addEventListener("cancel", (event) => event.preventDefault());
$("saved").addEventListener("cancel", (event) => event.preventDefault());
$("join-form").addEventListener("submit", (event) => {
  event.preventDefault();
  act(async () => {
    try {
      await join($("code").value.trim());
      $("join").close();
    } catch (problem) {
      if (!(problem instanceof Problem)) throw problem;
      $("join-problem").textContent = problem.message;
      $("join-problem").hidden = false;
    }
  });
});
$("continue").addEventListener("click", () => $("resumed").close());
$("again").addEventListener("click", () => {
  $("resumed").close();
  act(async () => {
    while (shown.cuts) change(await ask("/api/undo", { after, seconds: seconds(), robot }));
    setState("ready");
  });
});
$("next").addEventListener("click", () => {
  $("saved").close();
  act(() => join(code));
});
$("stop").addEventListener("click", () => {
  $("saved").close();
  setState("done");
  $("done-text").textContent = "You can close this page. With your code you can come back.";
  $("done").showModal();
});

$("how").open = window.innerWidth > 760;
$("code").value = sessionStorage.getItem("code") ?? "";
$("join").showModal();
