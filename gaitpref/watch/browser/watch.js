"use strict";
// Asks for one JSON again and again, and draws it; nothing is sent.

const OFTEN_MS = 2000, SELDOM_MS = 10000;
const at = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";

function duration(s) {
  if (s === null || s === undefined) return "-";
  const whole = Math.max(1, Math.round(s));
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  const minutes = Math.round(whole / 60);
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

function large(n) {
  if (Math.abs(n) >= 1e6) return `${+(n / 1e6).toPrecision(3)} M`;
  if (Math.abs(n) >= 1e4) return `${+(n / 1e3).toPrecision(3)} k`;
  return `${+n.toPrecision(3)}`;
}

function element(name, text, cls) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (cls) made.className = cls;
  return made;
}

function drawn(parent, name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.appendChild(made);
  return made;
}

// Round values of an axis that lie in its range.
function ticks(low, high) {
  const rough = (high - low) / 4 || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
  const found = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push(v);
  return found;
}

function figure(curve) {
  const W = 560, H = 230, L = 48, R = 12, T = 20, B = 34;
  const lines = curve.lines.filter((line) => line.points.length);
  const made = element("figure");
  made.appendChild(element("figcaption", curve.name + (curve.unit ? `, ${curve.unit}` : "")));
  const all = lines.flatMap((line) => line.points).filter((p) => p[1] !== null);
  if (!all.length) {
    made.appendChild(element("p", "Nothing was measured yet.", "soft"));
    return made;
  }
  const right = Math.max(...all.map((p) => p[0])) || 1;
  let low = Math.min(...all.map((p) => p[1])), high = Math.max(...all.map((p) => p[1]));
  if (low > 0 && low < 0.5 * high) low = 0;
  const margin = 0.06 * (high - low) || 0.5;
  high += margin;
  if (low !== 0) low -= margin;
  const x = (v) => L + (W - L - R) * v / right;
  const y = (v) => H - B - (H - T - B) * (v - low) / (high - low);
  const last = all[all.length - 1];
  const svg = drawn(made, "svg", {
    viewBox: `0 0 ${W} ${H}`, role: "img",
    "aria-label": `${curve.name}: ${large(last[1])} ${curve.unit} after ${large(last[0])} steps`,
  });
  for (const v of ticks(low, high)) {
    drawn(svg, "line", {class: "grid", x1: L, x2: W - R, y1: y(v), y2: y(v)});
    drawn(svg, "text", {x: L - 6, y: y(v) + 4, "text-anchor": "end"}, large(v));
  }
  for (const v of ticks(0, right)) {
    const anchor = x(v) > W - R - 20 ? "end" : "middle";
    drawn(svg, "text", {x: x(v), y: H - B + 16, "text-anchor": anchor}, large(v));
  }
  drawn(svg, "text", {x: (L + W - R) / 2, y: H - 3, "text-anchor": "middle"}, "environment steps");
  lines.forEach((line, index) => {
    const points = line.points.filter((p) => p[1] !== null);
    if (!points.length) return;
    drawn(svg, "polyline", {
      class: index % 2 ? "line odd" : "line",
      points: points.map((p) => `${x(p[0]).toFixed(1)},${y(p[1]).toFixed(1)}`).join(" "),
    });
    if (curve.lines.length > 1 && line.round !== undefined) {
      const edge = x(points[0][0]);
      drawn(svg, "line", {class: "grid", x1: edge, x2: edge, y1: T, y2: H - B});
      drawn(svg, "text", {x: edge + 4, y: T - 6}, `round ${line.round}`);
    }
  });
  return made;
}

function facts(found) {
  const rows = [];
  if (found.kind === "loop") {
    if (found.answers) {
      rows.push(["Answers", `${found.answers.given} of at most ${found.answers.most}`]);
      if (found.answers.open && found.rater === "human") rows.push(["Open questions", `${found.answers.open}`]);
    }
  }
  if (found.progress) {
    const {done, of, unit} = found.progress;
    rows.push([unit === "steps" ? "Steps" : "Of this", `${large(done)} of ${large(of)}`]);
  }
  if (!found.finished && found.kind !== "empty" && found.kind !== "unread") {
    if (found.left_s !== null && found.left_s !== undefined) rows.push(["This training ends in", duration(found.left_s)]);
    if (found.run_left_s) {
      const people = found.rater === "human" ? ", and people" : "";
      rows.push(["The run ends in", `${duration(found.run_left_s)}${people}`]);
    }
  }
  for (const curve of found.curves || []) {
    const points = curve.lines.flatMap((line) => line.points);
    if (points.length) rows.push([`${curve.short} now`, `${large(points[points.length - 1][1])} ${curve.unit}`]);
  }
  if (found.quiet_s !== null) rows.push(["Last written", `${duration(found.quiet_s)} ago`]);
  return rows;
}

function state(found) {
  if (found.finished) return ["finished", "finished"];
  if (found.running) return ["running", "running"];
  if (found.kind === "empty") return ["", "waiting"];
  return found.running === false ? ["stopped", "not running"] : ["", "on another machine"];
}

function table(rows, criterion) {
  const heads = ["round", `return under ${criterion}`, "tracking error", "falls/min", "answers", "held-out accuracy", "took"];
  const head = element("tr"), body = [];
  for (const name of heads) { const th = element("th", name); th.scope = "col"; head.appendChild(th); }
  for (const row of rows) {
    const tr = element("tr");
    const number = (v, digits) => (v === null || v === undefined ? "-" : v.toFixed(digits));
    for (const text of [
      `${row.round}`, `${number(row.return, 2)} ± ${number(row.return_ci95, 2)}`,
      `${number(row.tracking_error_m_s, 3)} m/s`, number(row.falls_per_minute, 2),
      row.answers === null ? "-" : `${row.answers}`, number(row.accuracy, 2), duration(row.took_s),
    ]) tr.appendChild(element("td", text));
    body.push(tr);
  }
  at("rounds").querySelector("thead").replaceChildren(head);
  at("rounds").querySelector("tbody").replaceChildren(...body);
  at("rounds").hidden = !rows.length;
}

function links(found) {
  const rows = [];
  const row = (text, code, href) => {
    const li = element("li");
    if (href) { const a = element("a", text); a.href = href; li.appendChild(a); }
    else li.append(`${text} `, element("code", code));
    rows.push(li);
  };
  if (found.report) row("The report", "", "report");
  row("All curves, in TensorBoard:", `tensorboard --logdir ${found.place}`);
  if (found.kind === "loop" && !found.finished && found.running === false) {
    row("It goes on with the command it was started with:", `gaitpref loop --run ${found.place} ...`);
  }
  const same = rows.map((li) => li.textContent).join("|");
  if (at("links").dataset.same !== same) {
    at("links").dataset.same = same;
    at("links").replaceChildren(...rows);
  }
}

function show(found) {
  const [cls, words] = state(found);
  at("name").textContent = found.name;
  at("state").textContent = words;
  at("state").className = `pill ${cls}`;
  const told = found.told.charAt(0).toUpperCase() + found.told.slice(1);
  // A reader of the screen hears it only where it changed.
  if (at("told").textContent !== told) at("told").textContent = told;
  const bar = at("bar"), progress = found.progress;
  bar.hidden = !progress || !progress.of || found.finished;
  const share = progress && progress.of ? Math.floor(100 * progress.done / progress.of) : 0;
  if (!bar.hidden) {
    bar.firstElementChild.style.width = `${share}%`;
    bar.setAttribute("aria-valuenow", share);
  }
  document.title = `${bar.hidden ? words : `${share} %`} · ${found.name} · gaitpref`;
  at("facts").replaceChildren(...facts(found).map(([name, value]) => {
    const box = element("div");
    box.append(element("dt", name), element("dd", value));
    return box;
  }));
  at("verdict").hidden = !found.verdict;
  at("verdict").textContent = found.verdict
    ? `The run: ${found.verdict}. Next: ${found.advice}.`
    : "";
  const alarms = found.alarms || [];
  at("alarms").hidden = !alarms.length;
  at("alarms").querySelector("ul").replaceChildren(...alarms.map((text) => element("li", text)));
  at("curves").replaceChildren(...(found.curves || []).map(figure));
  table(found.table || [], found.criterion);
  at("more").hidden = false;
  links(found);
}

let seen = null;

async function look() {
  let wait = document.hidden ? SELDOM_MS : OFTEN_MS;
  try {
    const answer = await fetch("state.json", {cache: "no-store"});
    if (!answer.ok) throw new Error(answer.statusText);
    show(await answer.json());
    seen = new Date();
    at("lost").hidden = true;
  } catch (error) {
    const since = seen ? ` What you see is of ${seen.toLocaleTimeString()}.` : "";
    at("lost").textContent = `gaitpref watch does not answer.${since} Start it again, and this page goes on.`;
    at("lost").hidden = false;
    wait = OFTEN_MS;
  }
  setTimeout(look, wait);
}

look();
