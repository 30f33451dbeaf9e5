// The keyboard alone does everything, and every element has a name.

const FIELDS = "input, textarea, select";
const PRESSABLE = "button, a[href], [role=button], [role=tab], summary";
const isField = (element) => element instanceof Element && element.matches(FIELDS);

// viser sends what is typed up to 50 ms later, but a key or a click at once: an answer
// would be stored without the end of its note, and the next question would get it. So both
// wait for it. Timers fire in the order they are due, however busy the tab is.
const SENT_MS = 80;
const unsent = { fields: 0, waiting: [] };

document.addEventListener("input", (event) => {
  if (!isField(event.target)) return;
  unsent.fields += 1;
  setTimeout(() => {
    unsent.fields -= 1;
    if (!unsent.fields) unsent.waiting.splice(0).forEach((again) => again());
  }, SENT_MS);
}, true);

function waits(event, again) {
  if (!unsent.fields || !event.isTrusted) return false;
  event.preventDefault();
  event.stopImmediatePropagation();
  unsent.waiting.push(again);
  return true;
}

window.addEventListener("click", (event) => {
  const button = event.target.closest?.("button");
  if (button) waits(event, () => button.click());
}, true);

window.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const { key, code, shiftKey, target } = event;
  const again = () => target.dispatchEvent(
    new KeyboardEvent("keydown", { key, code, shiftKey, bubbles: true, cancelable: true }),
  );
  if (!isField(target) && waits(event, again)) return;
  const handled = whileCovered(event) || inKeyMap(event) || inField(event) || onFocused(event);
  if (handled) event.stopImmediatePropagation();
}, true);

// Nothing is stored while the page is covered: what was pressed is told.
function whileCovered(event) {
  if (!root.dataset.gp || isField(event.target) || event.key === "Tab") return false;
  if (event.target.closest?.("#gp-cover") && /^(Enter| )$/.test(event.key)) return true;
  const answer = words.answers[event.key.toUpperCase()];
  if (answer && root.dataset.gp !== "loading") miss(answer);
  return true;
}

function inKeyMap(event) {
  const map = byId("gp-keys");
  if (!map.open) {
    if (event.key !== "?" || isField(event.target)) return false;
    event.preventDefault();
    openKeyMap();
    return true;
  }
  if (event.key === "?" || event.key === "Escape") {
    event.preventDefault();
    map.close();
  }
  return !(event.target.closest?.("#gp-keys") && /^(Enter| |Tab)$/.test(event.key));
}

function openKeyMap() {
  const map = byId("gp-keys");
  map.append(map.querySelector("template").content.cloneNode(true));
  map.showModal();
}
byId("gp-keys").addEventListener("close", (event) => {
  event.target.querySelectorAll(":scope > :not(template)").forEach((part) => part.remove());
});

function inField(event) {
  const field = event.target;
  if (!isField(field)) return false;
  const box = field.closest("[role=dialog]");
  if (event.key === "Escape" && field.getAttribute("aria-expanded") !== "true") {
    field.blur();
    // Hotkeys are not heard in a field, and Escape closes the dialog around it.
    if (box) document.body.dispatchEvent(new KeyboardEvent("keydown", {
      key: "Escape", code: "Escape", bubbles: true,
    }));
    return true;
  }
  if (event.key === "Enter" && box && field.matches("input")) {
    const send = [...box.querySelectorAll("button")]
      .find((button) => button.textContent.trim() === words.send);
    // The last letters are on their way for some 50 ms.
    if (send && !event.repeat) setTimeout(() => send.click(), 150);
    return true;
  }
  return false;
}

// Enter and Space press what has the focus, and do nothing else there.
function onFocused(event) {
  if (event.key !== "Enter" && event.key !== " ") return false;
  const focused = event.target;
  if (!(focused instanceof Element) || !focused.matches(PRESSABLE)) return false;
  if (event.repeat || !focused.matches("button, a[href], summary")) event.preventDefault();
  if (!event.repeat && !focused.matches("button, a[href], summary")) focused.click();
  return true;
}

// A button that was clicked gives the focus back, or Space would press it again.
document.addEventListener("click", (event) => {
  if (event.target.closest?.("[data-gp-keys]")) openKeyMap();
  if (event.target.closest?.("#gp-keys") && !event.target.closest("table")) byId("gp-keys").close();
  const tap = event.target.closest?.("[data-gp-press]");
  if (tap) {
    tap.blur();
    press(tap.dataset.gpPress);
  }
  if (event.target.closest?.("[data-gp-anyway]")) {
    sessionStorage.setItem("gp-anyway", "1");
    root.dataset.gpAnyway = "1";
  }
  const button = event.target.closest?.("#root button");
  if (event.detail > 0 && button && button === document.activeElement
      && !button.closest("[role=dialog]")) button.blur();
});
if (sessionStorage.getItem("gp-anyway")) root.dataset.gpAnyway = "1";

function nameAll() {
  for (const icon of document.querySelectorAll(
    "#root .mantine-Paper-root > .tabler-icon-chevron-down, "
    + "#root .mantine-Paper-root > .tabler-icon-chevron-up")) {
    const folder = icon.parentElement;
    const open = icon.classList.contains("tabler-icon-chevron-up");
    put(folder, { role: "button", tabindex: "0", "aria-expanded": String(open) });
  }
  for (const canvas of document.querySelectorAll("#root canvas[data-engine]")) {
    put(canvas, { role: "img", "aria-label": words.scene });
    const wide = `${Math.round(canvas.clientWidth)}px`;
    if (root.style.getPropertyValue("--gp-scene") !== wide) {
      root.style.setProperty("--gp-scene", wide);
    }
  }
  for (const bar of document.querySelectorAll("#root [role=progressbar]")) {
    put(bar, { "aria-label": words.progress });
  }
  for (const part of document.querySelectorAll(
    "#root [role=slider], #root input[inputmode], #root .mantine-NumberInput-input, "
    + "#root textarea")) {
    const label = part.closest(".mantine-Flex-root")?.parentElement
      ?.querySelector("label")?.textContent;
    put(part, { "aria-label": label || words.slider });
  }
  for (const button of document.querySelectorAll("#root button")) {
    const text = button.textContent.trim();
    if (words.openEntry && text.endsWith(words.openEntry)) put(button, { "aria-current": "true" });
    else button.removeAttribute("aria-current");
    if (words.wide?.includes(text)) put(button, { "data-gp-wide": "" });
  }
  for (const icon of document.querySelectorAll("#root button:not([aria-label])")) {
    if (!icon.textContent.trim()) put(icon, { "aria-label": words.icon });
  }
}

// On a phone the answers stand beside one another: which part is which, for the style.
function markAnswers() {
  const shown = ready();
  if (!shown) return;
  const keys = new Map(Object.entries(words.answers || {}).map(([key, label]) => [label, key]));
  for (const button of document.querySelectorAll("#root button")) {
    const key = keys.get(button.textContent.trim());
    if (key === undefined) continue;
    let part = button;
    while (part.parentElement && !part.parentElement.contains(shown)) part = part.parentElement;
    if (!part.parentElement) continue;
    put(part, { "data-gp-answer": key });
    put(part.parentElement, { "data-gp-panel": "" });
  }
}

function put(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (element.getAttribute(name) !== value) element.setAttribute(name, value);
  }
}

// What a screen reader is told: each new question, and what became of the last.
function announce() {
  const said = ready()?.dataset.gpSpoken || "";
  if (!root.dataset.gp && said !== announce.last) {
    announce.last = said;
    byId("gp-live").textContent = said;
  }
}
