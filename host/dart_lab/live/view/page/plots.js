"use strict";
// Two plots of any channel over the last 20 s.
const Plots = (() => {
  const SECONDS = 20;
  const AXES = { speed: "m/s", yaw_rate: "rad/s", steering: "rad", throttle: "", accel: "m/s2", x: "m", y: "m", yaw: "rad" };
  const PAIRS = { "speed": ["speed"], "yaw rate": ["yaw_rate"], "steering, requested and applied": ["asked_steering", "steering"],
    "throttle, requested and applied": ["asked_throttle", "throttle"], "acceleration": ["accel_x", "accel_y"], "heading": ["yaw"] };
  const columns = {}, logged = {};
  const colours = ["--orange", "--blue"];
  const plots = [0, 1].map((n) => ({ place: document.getElementById(`plot${n}`), choice: document.getElementById(`channel${n}`), shown: null, picture: null }));
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
    const channels = PAIRS[plot.choice.value] || [plot.choice.value];
    if (plot.picture) plot.picture.destroy();
    const axis = { stroke: style("--quiet"), grid: { stroke: style("--line"), width: 0.5 }, ticks: { show: false } };
    const colour = (n) => style(colours[channels.length === 1 ? 1 : n]);
    plot.picture = new uPlot({ width: plot.place.clientWidth || 300, height: 130, cursor: { show: false }, legend: { show: false },
      scales: { x: { time: false } }, axes: [{ ...axis, size: 24 }, { ...axis, size: 46 }],
      series: [{}, ...channels.map((c, n) => ({ label: c, stroke: colour(n), width: 1.5 }))] }, [[]], plot.place);
    plot.shown = plot.choice.value;
    plot.channels = channels;
  }
  function draw() {
    if (!t.length) return;
    for (const plot of plots) {
      if (plot.shown !== plot.choice.value) make(plot);
      const width = plot.place.clientWidth;
      if (width && width !== plot.picture.width) plot.picture.setSize({ width, height: 130 });
      const data = plot.channels.map((name) => name in logged ? logged[name] : columns[name]);
      plot.picture.setData([t, ...data]);
    }
  }
  fill();
  // The menu gives up the focus, so that the next key drives.
  for (const plot of plots) { Menu.within(plot.choice); plot.choice.addEventListener("change", () => plot.choice.blur()); }
  setInterval(draw, 100);

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
    clear() { t = []; for (const name in columns) columns[name] = []; for (const name in logged) logged[name] = []; },
  };
})();
