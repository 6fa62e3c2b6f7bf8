"use strict";
// Driver input: stick, keys or gamepad. Holding it is the dead man's switch: `Stick.read()` is null if nothing is held.
const Stick = (() => {
  const face = document.getElementById("stick"), knob = document.getElementById("knob");
  const KEYS = { KeyW: [0, 1], ArrowUp: [0, 1], KeyS: [0, -1], ArrowDown: [0, -1], KeyA: [1, 0], ArrowLeft: [1, 0], KeyD: [-1, 0], ArrowRight: [-1, 0] };
  // Axis and buttons of the standard layout of the Gamepad API: left stick, right trigger, left trigger, right bumper, B.
  const STEER = 0, GAS = 7, BRAKE = 6, BUMPER = 5, PAD_STOP = 1, DEAD_ZONE = 0.05;
  const down = new Set();
  let held = null, pointer = null, box = null;
  // Times of the last report of each source [ms]. A value that is read again is no report: its device may be out of range.
  const reported = { pointer: 0, keys: 0, pad: 0 };
  let source = "pointer", padState = "";
  const report = (name) => { reported[name] = performance.now(); };

  const show = (at) => { knob.style.transform = at ? `translate(${-at[0] * 62}px, ${-at[1] * 62}px)` : ""; };
  function put(event) {
    const r = box.width / 2;
    const clamp = (v) => Math.max(-1, Math.min(1, v));
    held = [clamp(-(event.clientX - box.left - r) / r), clamp(-(event.clientY - box.top - r) / r)];
    report("pointer");
  }
  function releasePointer() { held = null; pointer = null; }
  face.addEventListener("pointerdown", (event) => { if (pointer === null) { pointer = event.pointerId; face.setPointerCapture(pointer); box = face.getBoundingClientRect(); put(event); event.preventDefault(); } });
  face.addEventListener("pointermove", (event) => { if (event.pointerId === pointer) put(event); });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) face.addEventListener(name, (event) => { if (event.pointerId === pointer) releasePointer(); });
  // Arrow keys belong to a menu or slider with the focus. Letters drive unless a text field has the focus.
  const TEXT = ["text", "search", "number", "email", "url", "password", "tel"];
  const typing = ({ target, code }) => target.tagName === "TEXTAREA" || target.isContentEditable || (target.tagName === "INPUT" && TEXT.includes(target.type))
    || (code.startsWith("Arrow") && (target.tagName === "SELECT" || target.type === "range"));
  addEventListener("keydown", (event) => { if (event.code in KEYS && !typing(event)) { down.add(event.code); report("keys"); event.preventDefault(); } });
  addEventListener("keyup", (event) => { if (down.delete(event.code)) report("keys"); });
  // A page without the focus releases everything.
  const release = () => { releasePointer(); down.clear(); };
  addEventListener("blur", release);
  addEventListener("pagehide", release);
  document.addEventListener("visibilitychange", () => { if (document.hidden) release(); });

  // The rest position of a worn stick is not exactly 0.
  const applyDeadZone = (v) => Math.abs(v) > DEAD_ZONE ? v : 0;
  // A pad with another layout is refused: its buttons are unknown. Each is reported once.
  const refused = new Set();
  function isStandard(one) {
    if (one.mapping === "standard") return true;
    if (!refused.has(one.id)) Notices.add(`the browser has no standard layout for the gamepad "${one.id}": it does not drive and its B is no STOP. Try another browser, or dart-hal drive --gamepad --map`);
    refused.add(one.id);
    return false;
  }
  const pads = () => [...(navigator.getGamepads ? navigator.getGamepads() : [])].filter((one) => one && one.connected !== false && isStandard(one));
  // Until its first report a trigger may read half of its travel: both have to be seen at rest once.
  const rested = new Set();
  addEventListener("gamepaddisconnected", (event) => { rested.delete(event.gamepad.index); });
  function pad() {
    let held = null;
    for (const one of pads()) {
      const gas = applyDeadZone(one.buttons[GAS].value), brake = applyDeadZone(one.buttons[BRAKE].value);
      if (!gas && !brake) rested.add(one.index);
      if (held || !one.buttons[BUMPER].pressed) continue;
      const state = JSON.stringify([one.axes, one.buttons.map((button) => [button.pressed, button.value])]);
      if (state !== padState) { padState = state; report("pad"); }
      held = [-applyDeadZone(one.axes[STEER]), rested.has(one.index) ? gas - brake : 0];
    }
    if (!held) padState = "";
    return held;
  }
  function keys() {
    if (!down.size) return null;
    const sum = [0, 0];
    for (const code of down) { sum[0] += KEYS[code][0]; sum[1] += KEYS[code][1]; }
    return sum.map((v) => Math.max(-1, Math.min(1, v)));
  }
  return {
    read() {
      const sources = { pointer: () => held, keys, pad };
      let at = null;
      for (source of document.hidden ? [] : Object.keys(sources)) if ((at = sources[source]())) break;
      show(at);
      return at;
    },
    // ms since the source of the last read() reported anything
    unchanged() { return performance.now() - reported[source]; },
    isStopPressed() { return pads().some((one) => one.buttons[PAD_STOP].pressed); },
    enable(on) { face.classList.toggle("off", !on); },
    release,
  };
})();
