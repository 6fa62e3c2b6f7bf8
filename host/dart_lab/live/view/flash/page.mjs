// The page: choice of file and port, progress, result.
import { Failure } from "./failures.mjs";
import { flash } from "./flash.mjs";
import { BOOTLOADERS } from "./hello.mjs";
import { parse } from "./hex.mjs";

const BUNDLED_IMAGE = "dart_nano.hex";
const by = (id) => document.getElementById(id);
const setBusy = (on) => { by("go").disabled = by("file").disabled = on; by("bar").hidden = !on; };
let image = null;

function showFailure(why) {
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

async function loadImage(name, text) {  // a chosen hex file, or the bundled one
  clear();
  image = null;
  try {
    image = parse(await text());
    by("chosen").textContent = `${name}, ${image.length} bytes`;
  } catch (why) {
    by("chosen").textContent = name;
    showFailure(why);
  }
  by("go").disabled = !image;
}

async function fetchBundled() {
  const answer = await fetch(BUNDLED_IMAGE).catch(() => null);
  if (!answer?.ok) throw new Failure("absent");
  return answer.text();
}

function showProgress(step, share) {
  by("status").textContent = share === null ? step : `${step} ${Math.round(100 * share)} %`;
  if (share === null) by("bar").removeAttribute("value");
  else by("bar").value = share;
}

function showResult({ speed, bytes, hello }) {
  by("status").textContent = hello ? "Flashed, and the firmware answers" : "Flashed; the program sends no HELLO";
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
  setBusy(true);
  try {
    const port = await navigator.serial.requestPort().catch((why) => { throw new Failure("unchosen", why.message); });
    showResult(await flash(port, image, showProgress));
  } catch (why) { showFailure(why); }
  setBusy(false);
}

by("file").addEventListener("change", ({ target }) => { if (target.files[0]) loadImage(target.files[0].name, () => target.files[0].text()); });
by("go").addEventListener("click", go);
addEventListener("beforeunload", (event) => { if (!by("bar").hidden) event.preventDefault(); });
if (navigator.serial) loadImage(BUNDLED_IMAGE, fetchBundled);
else {
  by("file").disabled = true;
  showFailure(new Failure(isSecureContext ? "unsupported" : "insecure"));
}
