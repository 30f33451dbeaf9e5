// The connection: says in words that it is lost, asks for the server, and is back by
// itself. viser's own client asks every second and gives up each attempt after one, which
// Chromium counts and punishes by delaying the next: so it is not let, and this asks
// /healthz first, and viser's client only once that answers.

const LINE_MS = {
  first: 300, longest: 2000, answer: 3000, open: 8000, watch: 10000, slept: 20000,
  sign: 1500, toast: 8000,
};
const TRIES_BEFORE_RELOAD = 3;
const line = {
  state: "opening", // opening, open, lost, away
  opened: 0, // how often
  worker: null, ask: null, wait: LINE_MS.first, timer: 0, opening: { id: 0 }, tries: 0,
  before: null, missed: [], beat: Date.now(), watched: Date.now(), heard: 0, silent: 0,
};
const root = document.documentElement;
// A login link that was followed once more: its token stays in no address.
if (location.hash.startsWith("#token=")) {
  history.replaceState(null, "", location.pathname + location.search);
}
const byId = (id) => document.getElementById(id);
const ready = () => document.querySelector("#root [data-gp-ready]");

const PlainWorker = window.Worker;
window.Worker = class extends PlainWorker {
  postMessage(message, ...rest) {
    const type = message && message.type;
    if (type === "retry" && line.worker === this) return;
    if (type === "set_server") {
      line.worker = this;
      line.ask = () => super.postMessage({ type: "retry" });
      this.addEventListener("message", (event) => heard(event.data));
    }
    super.postMessage(message, ...rest);
  }
};

function heard(message) {
  line.heard = Date.now();
  if (message.type === "connected") {
    clearTimeout(line.opening.id);
    line.before = ready();
    Object.assign(line, { state: "open", tries: 0, wait: LINE_MS.first, silent: 0 });
    line.opened += 1;
    line.watched = Date.now();
    show();
  } else if (message.type === "closed") {
    const reason = message.closeReason || "";
    if (reason.includes("another window")) {
      line.state = "away";
      show();
    } else if (reason.includes("logged out") || message.versionMismatch) {
      reload();
    } else {
      clearTimeout(line.opening.id);
      if (line.state === "opening") line.tries += 1;
      lose();
    }
  }
}

function lose() {
  line.state = "lost";
  show();
  askIn(line.wait);
}

function askIn(ms) {
  clearTimeout(line.timer);
  line.timer = setTimeout(askServer, ms);
}

// Calls `late` after `ms`. Where this very page was too busy to be on time, as while its
// scene is built in software, the answer may lie there unread: then it waits once more.
function patience(ms, late) {
  const timer = { id: 0, due: Date.now() + ms };
  const over = () => {
    if (Date.now() - timer.due < ms / 2) return late();
    timer.due = Date.now() + ms;
    timer.id = setTimeout(over, ms);
  };
  timer.id = setTimeout(over, ms);
  return timer;
}

async function health() {
  const stop = new AbortController();
  const timer = patience(LINE_MS.answer, () => stop.abort());
  try {
    const answer = await fetch("healthz", { cache: "no-store", signal: stop.signal });
    return answer.ok ? await answer.json() : null;
  } catch {
    return null;
  } finally {
    clearTimeout(timer.id);
  }
}

async function askServer() {
  if (line.state !== "lost") return;
  const found = await health();
  if (line.state !== "lost") return;
  if (found === null) {
    line.wait = Math.min(1.5 * line.wait, LINE_MS.longest);
    askIn(line.wait);
  } else if (found.page !== words.version || line.tries >= TRIES_BEFORE_RELOAD) {
    // Another version, no place, or no login any more: the server says which.
    reload();
  } else {
    open();
  }
}

function reload() {
  if (line.opened) sessionStorage.setItem("gp-back", missedWords());
  location.reload();
}

function open() {
  line.state = "opening";
  line.ask();
  clearTimeout(line.opening.id);
  line.opening = patience(LINE_MS.open, () => {
    line.tries += 1;
    lose();
  });
  show();
}

// Whether the socket is what it seems. After a sleep or a silence it may be dead without
// anybody having heard of its end: if nothing comes through it then, it is opened anew.
async function watch(doubtful) {
  const since = line.watched = Date.now();
  const found = await health();
  if (line.state !== "open") return;
  if (found === null) {
    line.silent += 1;
    line.watched = 0;
    if (line.silent >= 2) lose();
    return;
  }
  const silent = line.silent;
  line.silent = 0;
  if (!found.here) {
    lose();
  } else if (doubtful || silent) {
    setTimeout(() => {
      if (line.state === "open" && line.heard < since) lose();
    }, LINE_MS.sign);
  }
}

setInterval(() => {
  const now = Date.now();
  const slept = now - line.beat > LINE_MS.slept;
  line.beat = now;
  if (document.hidden || line.state !== "open") return;
  if (slept || now - line.watched > LINE_MS.watch) watch(slept);
}, 1000);

function hurry() {
  if (document.hidden) return;
  line.beat = Date.now();
  if (line.state === "lost") askIn(0);
  else if (line.state === "open") watch(false);
}
for (const name of ["online", "focus", "pageshow"]) window.addEventListener(name, hurry);
document.addEventListener("visibilitychange", hurry);

// What lies over the page: "" for nothing, or the name of a state.
function cover() {
  if (line.state === "away") return "away";
  const shown = ready();
  if (line.state === "open" && shown !== null && shown !== line.before) return "";
  return line.opened && root.dataset.gp !== "loading" ? "lost" : "loading";
}

function show() {
  const now = cover();
  const before = root.dataset.gp;
  if (now === before) return;
  root.dataset.gp = now;
  if (now === "") {
    const reloaded = sessionStorage.getItem("gp-back");
    sessionStorage.removeItem("gp-back");
    if (before === "lost" || reloaded !== null) {
      toast(words.back + missedWords() + (reloaded || ""));
    }
    line.missed = [];
  }
  const says = words.covers[now];
  if (!says) return;
  byId("gp-title").textContent = says.title;
  byId("gp-text").textContent = says.text;
  byId("gp-missed").textContent = "";
  const button = byId("gp-act");
  button.hidden = !says.button;
  button.textContent = says.button || "";
}

function missedWords() {
  return line.missed.length ? ` ${words.missed} ${line.missed.join(", ")}.` : "";
}

function miss(what) {
  if (!line.missed.includes(what)) line.missed.push(what);
  byId("gp-missed").textContent = missedWords().trim();
}

function toast(text) {
  const box = byId("gp-toast");
  box.textContent = text;
  box.hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => { box.hidden = true; }, LINE_MS.toast);
}

document.addEventListener("click", (event) => {
  if (event.target.id === "gp-act" && line.state === "away") open();
});
