// A gamepad steers as the keys do: what is held is its key, and the keys that steer are
// pressed again as long as it is. So the guards of keys are its guards too.

const PAD_MS = { look: 50, again: 150 };
const PUSHED = 0.5; // Of a stick's way: less is how it rests, or slipped.
const pad = { timer: 0, pressed: new Map() };

function heldKeys() {
  const held = new Set();
  for (const device of navigator.getGamepads()) {
    if (!device?.connected) continue;
    for (const [axis, low, high] of words.pad.axes) {
      const at = device.axes[axis] || 0;
      if (Math.abs(at) > PUSHED) held.add(at < 0 ? low : high);
    }
    for (const [button, key] of Object.entries(words.pad.buttons)) {
      if (device.buttons[button]?.pressed) held.add(key);
    }
  }
  return held;
}

function followPad() {
  if (document.hidden) return;
  const now = Date.now();
  const held = heldKeys();
  for (const key of pad.pressed.keys()) if (!held.has(key)) pad.pressed.delete(key);
  for (const key of held) {
    const last = pad.pressed.get(key);
    const again = words.pad.again.includes(key) && now - last >= PAD_MS.again;
    if (last !== undefined && !again) continue;
    pad.pressed.set(key, now);
    press(key);
  }
}

// The browser tells of a gamepad once one of its buttons is pressed.
window.addEventListener("gamepadconnected", () => {
  if (words.pad && !pad.timer) pad.timer = setInterval(followPad, PAD_MS.look);
});
