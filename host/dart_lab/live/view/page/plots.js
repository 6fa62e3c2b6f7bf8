"use strict";
// Two plots of any channel over the last 20 s. Dragging zooms into a time and holds it, a double click goes on.
const Plots = (() => {
  const SECONDS = 20;
  const UNITS = { speed: "m/s", yaw_rate: "rad/s", steering: "rad", asked_steering: "rad", accel_x: "m/s2", accel_y: "m/s2", yaw: "rad" };
  const NAMES = { yaw_rate: "yaw rate", asked_steering: "requested", asked_throttle: "requested", steering: "applied", throttle: "applied", accel_x: "forward", accel_y: "left", yaw: "heading" };
  // Smallest height of a plot: noise of a car at rest stays small.
  const MIN_SPANS = { "m/s": 0.5, "rad/s": 0.5, rad: 0.2, "m/s2": 2, "": 0.2 };
  const HEIGHT = 150;
  const PAIRS = { "speed": ["speed"], "yaw rate": ["yaw_rate"], "steering, requested and applied": ["asked_steering", "steering"],
    "throttle, requested and applied": ["asked_throttle", "throttle"], "acceleration": ["accel_x", "accel_y"], "heading": ["yaw"] };
  const columns = {}, logged = {};
  const colours = ["--orange", "--blue"];
  const plots = [0, 1].map((n) => ({ place: document.getElementById(`plot${n}`), choice: document.getElementById(`channel${n}`), shown: null, picture: null, zoom: null }));
  let t = [];

  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  function fill() {
    const names = [...Object.keys(PAIRS), ...Object.keys(logged)];
    for (const plot of plots) {
      const selected = plot.choice.value;
      plot.choice.replaceChildren(...names.map((name) => new Option(name)));
      plot.choice.value = names.includes(selected) ? selected : names[plots.indexOf(plot) ? 2 : 0];
    }
  }
  function make(plot) {
    const own = PAIRS[plot.choice.value] || [plot.choice.value];
    const channels = [...own, ...own.map((name) => `second ${name}`).filter((name) => name in columns)];
    const nameOf = (c) => c.startsWith("second ") ? `second, ${nameOf(c.slice(7))}` : NAMES[c] || c;
    if (plot.picture) plot.picture.destroy();
    const unit = UNITS[channels[0]] ?? "";
    // Channels of this page start at 0 unless they are negative; a program's own channels may have any size.
    function range(picture, low, high) {
      if (low === null) return [0, MIN_SPANS[unit]];
      const isOwn = plot.choice.value in PAIRS, span = isOwn ? MIN_SPANS[unit] : Math.max(Math.abs(low), Math.abs(high), 1e-6) * 1e-2;
      const missing = Math.max(0, span - (high - low)) / 2, margin = Math.max(high - low, span) * 0.05;
      return isOwn && low >= 0 ? [0, Math.max(high + margin, span)] : [low - missing - margin, high + missing + margin];
    }
    const value = (picture, v) => v === null || v === undefined ? "-" : `${v.toFixed(3)} ${unit}`;
    const axis = { stroke: style("--quiet"), grid: { stroke: style("--line"), width: 0.5 }, ticks: { show: false } };
    // The applied command covers the requested one where they are equal, so that is the wider line.
    const width = (n) => own.length > 1 && n % own.length === 0 ? 4 : 1.5;
    const colour = (n) => style(colours[own.length === 1 ? 1 : n % own.length]);
    plot.picture = new uPlot({ width: plot.place.clientWidth || 300, height: HEIGHT,
      cursor: { drag: { x: true, y: false, setScale: false, dist: 5 }, bind: { dblclick: () => () => { plot.zoom = null; draw(); } } },
      hooks: { setSelect: [(picture) => zoomTo(plot, picture)] },
      scales: { x: { time: false, range: (picture, low, high) => plot.zoom || [low, high] }, y: { range } },
      axes: [{ ...axis, size: 24 }, { ...axis, size: 44, label: unit, labelSize: unit ? 16 : 0, labelGap: 0 }],
      series: [{ label: "time", value: (picture, v) => v === null ? "-" : `${v.toFixed(2)} s` },
        ...channels.map((c, n) => ({ label: nameOf(c), stroke: colour(n), width: width(n), dash: n < own.length ? [] : [5, 4], value }))] }, [[]], plot.place);
    plot.zoom = null;
    plot.shown = plot.choice.value;
    plot.channels = channels;
  }
  // The data of a plot that is zoomed are held, as the page drops old ones.
  function zoomTo(plot, picture) {
    const { left, width } = picture.select;
    if (!(width > 0)) return;
    plot.zoom = [picture.posToVal(left, "x"), picture.posToVal(left + width, "x")];
    picture.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    picture.setData(picture.data.map((column) => column.slice()));
  }
  function draw() {
    if (!t.length) return;
    for (const plot of plots) {
      if (plot.shown !== plot.choice.value) make(plot);
      const width = plot.place.clientWidth;
      if (width && width !== plot.picture.width) plot.picture.setSize({ width, height: HEIGHT });
      if (plot.zoom) continue;
      const data = plot.channels.map((name) => name in logged ? logged[name] : columns[name]);
      plot.picture.setData([t, ...data]);
      // The legend shows the values at the cursor, or the newest ones: after uPlot has drawn, which empties it.
      queueMicrotask(() => plot.picture.cursor.idx ?? plot.picture.setLegend({ idx: t.length - 1 }, false));
    }
  }
  fill();
  // The menu gives up the focus, so that the next key drives.
  for (const plot of plots) { Menu.within(plot.choice); plot.choice.addEventListener("change", () => plot.choice.blur()); }
  setInterval(draw, 100);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((plot) => { plot.shown = null; }));

  return {
    add(row) {
      if (t.length && row.t < t[t.length - 1]) this.clear();
      t.push(row.t);
      for (const name in row) (columns[name] ||= []).push(row[name]);
      for (const name in logged) logged[name].push(logged[name].newest ?? null);
      if (t[0] < row.t - SECONDS - 1) {
        const expired = t.findIndex((at) => at >= row.t - SECONDS);
        t.splice(0, expired);
        for (const column of [...Object.values(columns), ...Object.values(logged)]) column.splice(0, expired);
      }
    },
    log(values) {
      let fresh = false;
      for (const name in values) {
        if (!(name in logged)) { logged[name] = t.map(() => null); fresh = true; }
        logged[name].newest = values[name];
      }
      if (fresh) fill();
    },
    clear() { t = []; for (const plot of plots) plot.zoom = null; for (const name in columns) columns[name] = []; for (const name in logged) logged[name] = []; },
  };
})();
