"use strict";
// The camera's newest image. Asked for once the last one is drawn: a slow page sees fewer, and delays nobody.
const Camera = (() => {
  const AGAIN = 60, FAILED = 1000;  // ms
  const $ = (id) => document.getElementById(id);
  const picture = $("picture");
  let live = false, asked = 0;

  function ask() { if (!live) return; if (document.hidden) setTimeout(ask, FAILED); else picture.src = `camera.jpg?${asked++}`; }
  picture.onload = () => setTimeout(ask, AGAIN);
  picture.onerror = () => setTimeout(ask, FAILED);
  $("eye").onclick = () => $("eye").classList.toggle("large");

  return {
    begin(there) { const fresh = there && !live; live = there; $("eye").hidden = !there; if (fresh) ask(); },
    status(told, t) {
      if (!told) return;
      $("eye").classList.toggle("bad", Boolean(told.told));
      $("taken").textContent = told.told || (told.t === null ? "no image yet" : `${told.rate ?? "-"} a second, ${Math.round(1000 * (t - told.t))} ms old`);
    },
    put(jpeg, text) { $("eye").hidden = false; picture.src = `data:image/jpeg;base64,${jpeg}`; $("taken").textContent = text; },
  };
})();
