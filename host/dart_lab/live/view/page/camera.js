"use strict";
// The camera's newest image. Asked for once the last one is drawn: a slow page sees fewer, and delays nobody.
const Camera = (() => {
  const AGAIN = 60, FAILED = 1000;  // ms
  const $ = (id) => document.getElementById(id);
  let live = false, asked = 0, begun = 0;

  // The last image stays until the next is whole: one that is loading has no size.
  function load(src, then) {
    const next = new Image(), mine = ++begun;
    next.alt = $("picture").alt;
    next.onload = () => { if (mine === begun) { $("picture").replaceWith(next); next.id = "picture"; } then(AGAIN); };
    next.onerror = () => then(FAILED);
    next.src = src;
  }
  const again = (ms) => setTimeout(ask, ms);
  function ask() { if (!live) return; if (document.hidden) again(FAILED); else load(`camera.jpg?${asked++}`, again); }
  $("eye").onclick = () => $("eye").classList.toggle("large");

  return {
    begin(there) { const fresh = there && !live; live = there; $("eye").hidden = !there; if (fresh) ask(); },
    status(told, t) {
      if (!told) return;
      $("eye").classList.toggle("bad", Boolean(told.told));
      $("taken").textContent = told.told || (told.t === null ? "no image yet" : `${told.rate ?? "-"} a second, ${Math.round(1000 * (t - told.t))} ms old`);
    },
    put(jpeg, text) { $("eye").hidden = false; load(`data:image/jpeg;base64,${jpeg}`, () => {}); $("taken").textContent = text; },
  };
})();
