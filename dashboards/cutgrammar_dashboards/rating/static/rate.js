// The rating page: goal and result side by side, turned together; a key or a click rates, and the next pair is shown.
import { View } from "./scene.js";
import { Problem, RETRY, send } from "./server.js";

const $ = (id) => document.getElementById(id);
const READY_AFTER = 350; // a pair can be rated when it has been on the screen for so long [ms]

let key = "", code = "", shown = null, shownAt = 0, busy = false, robot = navigator.webdriver === true;

let resultView = null;
const goalView = new View($("goal"), () => resultView?.follow(goalView));
resultView = new View($("result"), () => goalView.follow(resultView));
$("goal").view = goalView;
$("result").view = resultView;
const ratingButtons = [...document.querySelectorAll("[data-rating]")];

const ask = (path, message) => send(path, key, message);
const seconds = () => (performance.now() - shownAt) / 1000;

function say(text, kind = "") {
  $("message").textContent = text;
  $("message").className = kind;
}

function setState(name) {
  document.body.dataset.state = name;
  const open = name === "ready" && !busy;
  for (const button of ratingButtons) {
    button.disabled = !open;
    const chosen = Number(button.dataset.rating) === shown?.rating;
    button.classList.toggle("chosen", chosen);
    button.setAttribute("aria-pressed", String(chosen));
  }
  $("back").disabled = !open || !shown.place;
}

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
    await reconnect();
  } else if (problem.status === 409) {
    try {
      await join(code);
      say("This page was out of date; it shows your next pair again.", "problem");
    } catch (other) {
      if (!(other instanceof Problem)) throw other;
      say(other.message, "problem");
    }
  } else if (problem.status === 403) {
    setState("joining");
    $("join-problem").textContent = problem.message;
    $("join-problem").hidden = false;
    $("join").showModal();
  } else {
    say(problem.message, "problem");
  }
}

async function reconnect() {
  setState("lost");
  say("The server does not answer. Your ratings so far are kept. Trying again …", "problem");
  for (;;) {
    await new Promise((resume) => setTimeout(resume, RETRY));
    try {
      await join(code);
      if (document.body.dataset.state !== "done") say("Connected again. You continue where you stopped.", "good");
      return;
    } catch (problem) {
      if (!(problem instanceof Problem) || ![0, 507].includes(problem.status)) throw problem;
      if (problem.status === 507) say(problem.message, "problem");
    }
  }
}

async function join(entered) {
  const answer = await ask("/api/join", { code: entered, robot });
  key = answer.key;
  code = entered;
  sessionStorage.setItem("code", code);
  await show(answer);
}

// --- showing ---------------------------------------------------------------------------------------------------------

function fill(view, side, name) {
  const ids = Object.keys(side.new);
  view.update([], {}, {});
  view.explode = Number($("explode").value);
  view.update(ids, side.new, side.shifts);
  view.look("front");
  $(`${name}-count`).textContent = `${ids.length} ${ids.length === 1 ? "fragment" : "fragments"}`;
}

// Both views look from one place: that of the one which needs to be farther away.
function look(name) {
  goalView.look(name);
  resultView.look(name);
  const [goal, result] = [goalView, resultView].map((view) => view.camera.position.distanceTo(view.controls.target));
  if (goal > result) resultView.follow(goalView);
  else goalView.follow(resultView);
}

async function show(state) {
  shown = state;
  $("progress-text").textContent = `${state.answered} of ${state.pairs} rated`;
  $("progress-bar").max = state.pairs;
  $("progress-bar").value = state.answered;
  if (!state.pair) {
    setState("done");
    say("");
    $("done-text").textContent = state.pairs
      ? `All ${state.pairs} pairs are rated, and your ratings are on disk. You can close this page.`
      : "There is nothing to rate.";
    $("again").hidden = !state.pairs;
    $("done").showModal();
    return;
  }
  fill(goalView, state.goal, "goal");
  fill(resultView, state.result, "result");
  look("front");
  say(state.rating ? `You gave ${state.rating}. Rate again to change it.` : "");
  setState("shown");
  shownAt = performance.now();
  await new Promise((resume) => setTimeout(resume, READY_AFTER));
  setState("ready");
}

const rate = (rating, trusted) => act(async () => {
  if (document.body.dataset.state !== "ready") return;
  robot ||= !trusted;
  await show(await ask("/api/rate", { after: shown.after, pair: shown.pair, rating, seconds: seconds(), robot }));
});

const back = () => act(async () => {
  if (!shown?.place) return;
  await show(await ask(`/api/pair/${shown.place - 1}`));
});

// --- input -----------------------------------------------------------------------------------------------------------

function explode(share) {
  $("explode").value = share;
  goalView.setExplode(Number(share));
  resultView.setExplode(Number(share));
}

for (const button of ratingButtons) {
  button.addEventListener("click", (event) => rate(Number(button.dataset.rating), event.isTrusted));
}
for (const button of document.querySelectorAll("[data-view]")) {
  button.addEventListener("click", () => look(button.dataset.view));
}
$("back").addEventListener("click", back);
$("explode").addEventListener("input", (event) => explode(event.target.value));

const KEYS = {
  b: back, Backspace: back, e: () => explode(goalView.explode > 0 ? 0 : 1),
  f: () => look("front"), t: () => look("top"), s: () => look("side"),
  ArrowLeft: () => goalView.turn(-0.08, 0), ArrowRight: () => goalView.turn(0.08, 0),
  ArrowUp: () => goalView.turn(0, 0.08), ArrowDown: () => goalView.turn(0, -0.08),
  "+": () => goalView.turn(0, 0, 0.9), "-": () => goalView.turn(0, 0, 1 / 0.9),
};

document.addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]") || event.ctrlKey || event.metaKey || event.altKey || !shown?.pair) return;
  const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (/^[1-5]$/.test(name)) {
    if (!event.repeat) rate(Number(name), event.isTrusted);
  } else if (event.target.tagName === "INPUT" && name.startsWith("Arrow")) {
    return;
  } else if (KEYS[name]) {
    KEYS[name]();
  } else {
    return;
  }
  event.preventDefault();
});

$("join").addEventListener("cancel", (event) => event.preventDefault());
$("done").addEventListener("cancel", (event) => event.preventDefault());
$("join-form").addEventListener("submit", (event) => {
  event.preventDefault();
  act(async () => {
    try {
      $("join-problem").hidden = true;
      await join($("code").value.trim());
      $("join").close();
    } catch (problem) {
      if (!(problem instanceof Problem)) throw problem;
      $("join-problem").textContent = problem.message;
      $("join-problem").hidden = false;
    }
  });
});
$("again").addEventListener("click", () => {
  $("done").close();
  back();
});

$("code").value = sessionStorage.getItem("code") ?? "";
$("join").showModal();
