"use strict";
// A recorded run: time bar, play, pause. `put(n)` shows the car at row n, with the 20 s before it in the plots.
const Player = (() => {
  const ROWS_BEFORE = 2000;  // 20 s
  const $ = (id) => document.getElementById(id);
  let run = null, at = 0, playing = true, began = 0, shown = -1, shownImage = null;
  const toRow = (values) => Object.fromEntries(run.fields.map((name, n) => [name, values[n]]));

  function put(n) {
    if (n < shown || n > shown + 500) {
      Floor.clear(); Plots.clear();
      shown = Math.max(-1, n - ROWS_BEFORE);
    }
    for (let k = shown + 1; k <= n; k++) { const row = toRow(run.rows[k]); Floor.add(row); Plots.add(row); }
    shown = n;
    const scan = run.scans.filter(([k]) => k <= n).pop();
    if (scan) Floor.scan(scan[1]);
    const image = (run.images || []).findLast(([k]) => k <= n);
    if (image && image !== shownImage) { shownImage = image; Camera.put(image[1], `at ${(run.rows[image[0]][0] - run.rows[0][0]).toFixed(1)} s`); }
    const t = run.rows[n][0] - run.rows[0][0];
    $("time").value = n / Math.max(1, run.rows.length - 1);
    $("at").textContent = `${t.toFixed(1)} s of ${(run.rows[run.rows.length - 1][0] - run.rows[0][0]).toFixed(1)} s`;
  }
  function play(on) { playing = on; began = performance.now() / 1000 - (run.rows[at][0] - run.rows[0][0]); $("play").textContent = on ? "Pause" : "Play"; }
  function step() {
    requestAnimationFrame(step);
    if (!playing) return;
    const t = performance.now() / 1000 - began + run.rows[0][0];
    while (at < run.rows.length - 1 && run.rows[at + 1][0] <= t) at++;
    put(at);
    if (at === run.rows.length - 1) play(false);
  }
  return {
    show(message) {
      run = message;
      $("bar").hidden = false;
      $("play").onclick = () => { if (!playing && at === run.rows.length - 1) at = 0; play(!playing); };
      $("time").oninput = () => { at = Math.round($("time").value * (run.rows.length - 1)); play(false); put(at); };
      play(true);
      requestAnimationFrame(step);
    },
  };
})();
