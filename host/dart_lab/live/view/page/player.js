"use strict";
// A recorded run: time bar, play, pause, speed and single steps. The address has the time of a paused run: `#t=12.3`.
// A second run is shown at the same time since its start: its car and path, dashed lines in the plots, numbers after a bar.
const Player = (() => {
  const ROWS_BEFORE = 2000;  // 20 s in the plots before the shown row
  const $ = (id) => document.getElementById(id);
  let run = null, second = null, showRow = null, at = 0, playing = true, began = 0, rate = 1, shown = -1, shownImage = null;
  const toRow = (one, n) => Object.fromEntries(one.fields.map((name, k) => [name, one.rows[n][k]]));
  const timeOf = (one, n) => one.rows[n][0] - one.rows[0][0];

  // The last row of a run at time t [s] since its start.
  function rowAt(one, t) {
    let low = 0, high = one.rows.length - 1;
    while (low < high) { const middle = Math.ceil((low + high) / 2); if (timeOf(one, middle) <= t + 1e-6) low = middle; else high = middle - 1; }
    return low;
  }
  function pairedRow(n) {
    const row = toRow(run, n);
    if (second) for (const [name, value] of Object.entries(toRow(second, rowAt(second, timeOf(run, n))))) row[`second ${name}`] = value;
    return row;
  }
  function showSecond(t) {
    const m = rowAt(second, t), x = second.fields.indexOf("x"), y = second.fields.indexOf("y");
    const path = second.rows.slice(Math.max(0, m - ROWS_BEFORE), m + 1).filter((row) => row[x] !== null && row[y] !== null).map((row) => [row[x], row[y]]);
    const row = toRow(second, m);
    Floor.others(row.x === null || row.y === null ? [] : [{ ...row, name: `second: ${second.car}`, path }]);
    return row;
  }
  function put(n) {
    if (n < shown || n > shown + 500) {
      Floor.clear(); Plots.clear();
      shown = Math.max(-1, n - ROWS_BEFORE);
    }
    for (let k = shown + 1; k <= n; k++) { const row = pairedRow(k); Floor.add(row); Plots.add(row); }
    shown = n;
    const scan = run.scans.filter(([k]) => k <= n).pop();
    if (scan) Floor.scan(scan[1]);
    const image = (run.images || []).findLast(([k]) => k <= n);
    if (image && image !== shownImage) { shownImage = image; Camera.put(image[1], `at ${timeOf(run, image[0]).toFixed(1)} s`); }
    const t = timeOf(run, n);
    showRow(toRow(run, n), second && showSecond(t));
    $("time").value = n / Math.max(1, run.rows.length - 1);
    $("at").textContent = `${t.toFixed(1)} s of ${timeOf(run, run.rows.length - 1).toFixed(1)} s`;
  }
  function play(on) {
    playing = on;
    began = performance.now() / 1000 - timeOf(run, at) / rate;
    $("play").textContent = on ? "Pause" : "Play";
    if (!on) history.replaceState(null, "", `#t=${timeOf(run, at).toFixed(2)}`);
  }
  function seek(n) { at = Math.min(run.rows.length - 1, Math.max(0, n)); play(false); put(at); }
  function step() {
    requestAnimationFrame(step);
    if (!playing) return;
    const t = (performance.now() / 1000 - began) * rate;
    while (at < run.rows.length - 1 && timeOf(run, at + 1) <= t) at++;
    put(at);
    if (at === run.rows.length - 1) play(false);
  }
  // Return the time of a link to a moment [s], null without one.
  function linkedTime() {
    const found = /^#t=(\d+(?:\.\d+)?)$/.exec(location.hash);
    return found && Number(found[1]);
  }
  const isTyping = ({ target }) => ["SELECT", "TEXTAREA"].includes(target.tagName);
  return {
    // showRow(row, row of the second run or null): shows the numbers.
    show(message, rowHandler) {
      run = message; second = message.second && message.second.rows.length ? message.second : null; showRow = rowHandler;
      $("bar").hidden = false;
      $("play").onclick = () => { if (!playing && at === run.rows.length - 1) at = 0; play(!playing); };
      $("time").oninput = () => seek(Math.round($("time").value * (run.rows.length - 1)));
      $("back").onclick = () => seek(at - 1);
      $("next").onclick = () => seek(at + 1);
      $("rate").onchange = () => { rate = Number($("rate").value); if (playing) play(true); };
      addEventListener("keydown", (event) => { if (!isTyping(event) && [",", "."].includes(event.key)) seek(at + (event.key === "." ? 1 : -1)); });
      addEventListener("hashchange", () => { if (linkedTime() !== null) seek(rowAt(run, linkedTime())); });
      if (linkedTime() === null) play(true); else seek(rowAt(run, linkedTime()));
      requestAnimationFrame(step);
    },
  };
})();
