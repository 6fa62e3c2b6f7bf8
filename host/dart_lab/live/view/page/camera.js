"use strict";
// The newest image of the camera. It is requested after the last one is drawn, so a slow page gets fewer images
// and delays no other page.
const Camera = (() => {
  const REQUEST_PERIOD_MS = 60, RETRY_PERIOD_MS = 1000;
  const $ = (id) => document.getElementById(id);
  let live = false, requests = 0, loads = 0;

  // The last image stays until the next one is complete: an image that is loading has no size.
  function load(src, then) {
    const next = new Image(), number = ++loads;
    next.alt = $("picture").alt;
    next.onload = () => { if (number === loads) { $("picture").replaceWith(next); next.id = "picture"; } then(REQUEST_PERIOD_MS); };
    next.onerror = () => then(RETRY_PERIOD_MS);
    next.src = src;
  }
  const requestAfter = (ms) => setTimeout(request, ms);
  function request() { if (!live) return; if (document.hidden) requestAfter(RETRY_PERIOD_MS); else load(`camera.jpg?${requests++}`, requestAfter); }
  $("eye").onclick = () => $("eye").classList.toggle("large");

  return {
    begin(hasCamera) { const isNew = hasCamera && !live; live = hasCamera; $("eye").hidden = !hasCamera; if (isNew) request(); },
    status(camera, t) {
      if (!camera) return;
      $("eye").classList.toggle("bad", Boolean(camera.told));
      $("taken").textContent = camera.told || (camera.t === null ? "no image yet" : `${camera.rate ?? "-"} a second, ${Math.round(1000 * (t - camera.t))} ms old`);
    },
    put(jpeg, text) { $("eye").hidden = false; load(`data:image/jpeg;base64,${jpeg}`, () => {}); $("taken").textContent = text; },
  };
})();
