// The page: which file, which port, how far, what came of it.
import { Failure } from "./failures.mjs";
import { flash } from "./flash.mjs";
import { BOOTLOADERS } from "./hello.mjs";
import { parse } from "./hex.mjs";

const OURS = "dart_nano.hex";
const by = (id) => document.getElementById(id);
const busy = (on) => { by("go").disabled = by("file").disabled = on; by("bar").hidden = !on; };
let image = null;

function fail(why) {
  const known = why instanceof Failure ? why : Object.assign(new Failure("garbled", String(why)), { kind: "unknown" });
  by("failure").hidden = false;
  by("failure").dataset.kind = known.kind;
  by("what").textContent = known.message;
  by("remedy").textContent = known.remedy;
  by("status").textContent = "Not flashed";
}

function clear() {
  by("failure").hidden = by("done").hidden = true;
  by("status").textContent = "";
}

async function take(name, text) {  // a hex file that was chosen, or ours
  clear();
  image = null;
  try {
    image = parse(await text());
    by("chosen").textContent = `${name}, ${image.length} bytes`;
  } catch (why) {
    by("chosen").textContent = name;
    fail(why);
  }
  by("go").disabled = !image;
}

async function ours() {
  const answer = await fetch(OURS).catch(() => null);
  if (!answer?.ok) throw new Failure("absent");
  return answer.text();
}

function tell(what, share) {
  by("status").textContent = share === null ? what : `${what} ${Math.round(100 * share)} %`;
  if (share === null) by("bar").removeAttribute("value");
  else by("bar").value = share;
}

function show({ speed, bytes, hello }) {
  by("status").textContent = hello ? "Flashed, and the firmware answers" : "Flashed; the program says no HELLO";
  const rows = { "written and verified": `${bytes} bytes at ${speed} baud` };
  if (hello) Object.assign(rows, {
    "firmware": hello.version.join("."), "board": hello.board.toString(16).padStart(8, "0"),
    "boot": hello.boots, "bootloader": BOOTLOADERS[hello.bootloader] ?? BOOTLOADERS[0],
    "message definitions": hello.schema.toString(16).padStart(8, "0") });
  else rows.HELLO = "none: right for another program; for DART-HAL's firmware press reset and type dart-hal doctor";
  by("done").replaceChildren(...Object.entries(rows).flatMap(([name, value]) => {
    const [dt, dd] = ["dt", "dd"].map((tag) => document.createElement(tag));
    [dt.textContent, dd.textContent] = [name, value];
    return [dt, dd];
  }));
  by("done").hidden = false;
}

async function go() {
  clear();
  busy(true);
  try {
    const port = await navigator.serial.requestPort().catch((why) => { throw new Failure("unchosen", why.message); });
    show(await flash(port, image, tell));
  } catch (why) { fail(why); }
  busy(false);
}

by("file").addEventListener("change", ({ target }) => { if (target.files[0]) take(target.files[0].name, () => target.files[0].text()); });
by("go").addEventListener("click", go);
addEventListener("beforeunload", (event) => { if (!by("bar").hidden) event.preventDefault(); });
if (navigator.serial) take(OURS, ours);
else {
  by("file").disabled = true;
  fail(new Failure(isSecureContext ? "unsupported" : "insecure"));
}
