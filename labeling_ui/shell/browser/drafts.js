// What is said of a pair but not yet answered outlives the connection and the server: it
// lies in this tab's own storage, by the question, and is put back once.

const draft = { question: null, opened: 0, restoring: 0, writing: false };
const draftKey = (question) => `gp-draft:${question}`;
const noteField = () => document.querySelector("#root textarea");
const fieldOf = (label) => {
  const found = [...document.querySelectorAll("#root label")]
    .find((element) => element.textContent === label);
  return found ? byId(found.htmlFor) : null;
};

function saidNow() {
  const sure = fieldOf(words.sure)?.value || "";
  return {
    note: noteField()?.value || "",
    sure: words.sureKeys[sure] ? sure : "",
    why: document.querySelector("#root [data-gp-why]")?.dataset.gpWhy || "",
  };
}

function keepDraft() {
  const question = ready()?.dataset.gpQuestion;
  if (!question || draft.restoring || question !== draft.question) return;
  const said = saidNow();
  const text = said.note || said.sure || said.why ? JSON.stringify(said) : "";
  const known = sessionStorage.getItem(draftKey(question)) || "";
  if (text === known) return;
  if (text) sessionStorage.setItem(draftKey(question), text);
  else sessionStorage.removeItem(draftKey(question));
}

// Called often; what was kept is put back where the page is new or the line was cut. The
// server knows what was said over the same line, and who takes a reason back at once is
// not contradicted.
function followDraft() {
  const question = ready()?.dataset.gpQuestion || null;
  const opened = draft.opened !== line.opened;
  if (root.dataset.gp === "" && (opened || question !== draft.question)) {
    draft.question = question;
    draft.opened = line.opened;
    clearTimeout(draft.restoring);
    draft.restoring = 0;
    const text = question && sessionStorage.getItem(draftKey(question));
    if (text && opened) {
      draft.restoring = setTimeout(() => restore(JSON.parse(text)), 250);
    } else if (question && !text) {
      forgetOthers();
    }
  }
  if (root.dataset.gp === "") keepDraft();
}

function restore(kept) {
  draft.restoring = 0;
  const now = saidNow();
  const field = noteField();
  if (field && now.note !== kept.note) {
    const set = Object.getOwnPropertyDescriptor(HTMLTextAreaElement.prototype, "value").set;
    set.call(field, kept.note);
    field.dispatchEvent(new Event("input", { bubbles: true }));
  }
  if (kept.sure && now.sure !== kept.sure) press(words.sureKeys[kept.sure]);
  if (kept.why && now.why !== kept.why) press(words.whyKeys[kept.why]);
  if (field && draft.writing) {
    field.focus();
    field.setSelectionRange(field.value.length, field.value.length);
  }
}

function press(name) {
  const key = name === "space" ? " " : name;
  const code = key === " " ? "Space" : /\d/.test(key) ? `Digit${key}` : `Key${key}`;
  const low = key.toLowerCase();
  document.body.dispatchEvent(new KeyboardEvent("keydown", { key: low, code, bubbles: true }));
}

// A question comes back while it is open: of those answered long ago nothing is kept.
function forgetOthers() {
  const keys = Object.keys(sessionStorage).filter((key) => key.startsWith("gp-draft:"));
  for (const key of keys.slice(0, Math.max(0, keys.length - 20))) sessionStorage.removeItem(key);
}

document.addEventListener("input", (event) => {
  if (event.target === noteField()) keepDraft();
});

// Whether somebody writes; a field that is taken away was not left.
document.addEventListener("focusin", (event) => {
  draft.writing = event.target === noteField();
});
document.addEventListener("focusout", (event) => {
  const field = event.target;
  setTimeout(() => {
    if (field.isConnected && document.activeElement !== field) draft.writing = false;
  });
});

// How the rater likes to look, and which moments are marked: the page says it, and is
// told when it is opened again.
function keepHabits() {
  const text = document.querySelector("#root [data-gp-habits]")?.dataset.gpHabits;
  if (root.dataset.gp !== "" || !text || text === keepHabits.kept) return;
  keepHabits.kept = text;
  keepCookie(`gp-habits=${text}; max-age=31536000`);
}

function keepMarks() {
  const question = ready()?.dataset.gpQuestion;
  if (root.dataset.gp !== "" || !question) return;
  const text = ready().dataset.gpHere;
  const known = document.cookie.match(/(?:^|; )gp-here=([^;]*)/)?.[1] || "";
  // Those of another question wait until it is open again.
  if (text === known || (!text && !known.startsWith(`${question}_`))) return;
  keepCookie(text ? `gp-here=${text}` : "gp-here=; max-age=0");
}

function keepCookie(text) {
  // viser's client opens its socket at the folder's address without the last slash.
  const path = location.pathname.replace(/\/[^/]*$/, "") || "/";
  document.cookie = `${text}; path=${path}; samesite=strict`;
}

setInterval(() => {
  show();
  followDraft();
  keepHabits();
  keepMarks();
  nameAll();
  markAnswers();
  announce();
}, 200);
show();
