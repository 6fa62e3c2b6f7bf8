"use strict";
// Page of one car: draws the messages of the server and sends the commands of the driver.
// Messages to the server: view/messages.py. Messages from it: view/desk.py and view/told.py.
(() => {
  const $ = (id) => document.getElementById(id);
  const token = decodeURIComponent(location.hash.slice(1));
  const SEND_PERIOD_MS = 33, SILENT_AFTER_MS = 1500;
  const REPLACED = 4001;  // close code of a socket that a newer page replaces, see server.py
  let socket = null, fields = [], isDriver = false, heard = null, heardAt = 0, holding = false, mode = "", first = true, maps = {}, frame = null, padStops = false;

  const send = (message) => { if (socket && socket.readyState === 1) socket.send(JSON.stringify(message)); };
  const addNotice = Notices.add;
  function setBadge(text) { $("mode").textContent = text; $("mode").className = `badge ${text.replace(/ /g, "-")}`; }
  // Values of a server that is gone or silent are dimmed, and its wheel cannot be taken.
  function setStale(on) {
    if (on === document.body.classList.contains("stale")) return;
    document.body.classList.toggle("stale", on);
    if (!on) return;
    $("take").disabled = true;
    if (row) $("link").textContent = `values of ${new Date().toLocaleTimeString()}`;
  }
  function setDriver(on) {
    isDriver = on;
    $("take").textContent = on ? "Let go of the wheel" : "Take the wheel";
    $("take").classList.toggle("mine", on);
    $("arm").disabled = !on;
    Stick.enable(on);
    if (!on) Stick.release();
  }

  // Handlers of the messages, by type.
  const handlers = {
    begin(message) {
      fields = message.fields;
      document.title = $("car").textContent = message.car;
      $("wheel").hidden = !message.drives;
      document.querySelector("main").classList.toggle("no-wheel", !message.drives);
      maps = message.maps; frame = null;
      Camera.begin(message.camera);
      message.notices.forEach(addNotice);
    },
    rows(message) {
      heard = message.now; heardAt = performance.now();
      setStale(false);
      message.rows.forEach(addRow);
    },
    log(message) { Plots.log(message.values); },
    scan(message) { Floor.scan(message.points); },
    others(message) { Floor.others(message.poses); },
    said(message) { addNotice(message.text); },
    yours() { setDriver(true); },
    run(message) {
      if (!message.rows.length) { addNotice("this run has no samples"); return; }
      document.title = $("car").textContent = message.car;
      setBadge("recorded");
      document.querySelector("main").classList.add("no-wheel");
      for (const id of ["wheel", "stop"]) $(id).hidden = true;
      Player.show(message, showRow);
    },
    status: showStatus,
  };
  let row = null;
  function addRow(values) {
    row = Object.fromEntries(fields.map((name, n) => [name, values[n]]));
    Floor.add(row);
    Plots.add(row);
  }

  function showList(list) {
    $("side").hidden = false;
    $("numbers").replaceChildren(...Object.entries(list).flatMap(([name, text]) => {
      const dt = document.createElement("dt"), dd = document.createElement("dd");
      dt.textContent = name; dd.textContent = text;
      return [dt, dd];
    }));
  }
  const format = (v, digits, unit) => v === null || v === undefined ? "-" : `${v.toFixed(digits)} ${unit}`;
  // The numbers of a recorded run, after a bar those of a second one.
  function showRow(...rows) {
    const deg = (v) => v === null ? null : v * 180 / Math.PI;
    const both = (text) => rows.filter(Boolean).map(text).join(" | ");
    showList({
      "speed": both((r) => format(r.speed, 2, "m/s")), "yaw rate": both((r) => format(r.yaw_rate, 2, "rad/s")),
      "steering": both((r) => format(deg(r.steering), 1, "deg")), "throttle": both((r) => format(r.throttle, 3, "")),
      "acceleration": both((r) => `${format(r.accel_x, 2, "")} ${format(r.accel_y, 2, "m/s2")}`),
      "pose": both((r) => `${format(r.x, 2, "m")} ${format(r.y, 2, "m")}`), "heading": both((r) => format(deg(r.yaw), 1, "deg")),
    });
  }
  function showNumbers(s) {
    const deg = 180 / Math.PI;
    showList({
      "speed": format(row && row.speed, 2, "m/s"), "yaw rate": format(row && row.yaw_rate, 2, "rad/s"),
      "steering": row ? `${format(row.steering === null ? null : row.steering * deg, 1, "deg")} (requested ${format(row.asked_steering === null ? null : row.asked_steering * deg, 1, "deg")})` : "-",
      "throttle": row ? `${format(row.throttle, 3, "")}(requested ${format(row.asked_throttle, 3, "").trim()})` : "-",
      "pulses": `${s.us[0]} / ${s.us[1]} us`, "pose": row ? `${format(row.x, 2, "m")} ${format(row.y, 2, "m")}` : "-",
      "frame": `${s.frame}, ${s.tracking}`, "limited": s.limited.join(", ") || "-", "doubts": s.doubts.join(", ") || "-",
      "link": `${s.link.age_ms} ms, ${s.link.lost} lost, ${s.link.damaged} damaged`,
      "loop": `p99 ${s.loop.p99_ms ?? "-"} ms, ${s.loop.late} late`, "pages": s.pages,
      ...(s.battery === null ? {} : { "battery": format(s.battery, 2, "V") }),
    });
  }
  function showProblems(list) {
    $("trouble").replaceChildren(...list.map(({ name, text, remedy }) => {
      const item = document.createElement("div"), head = document.createElement("b"), rest = document.createElement("span"), code = document.createElement("i");
      head.textContent = text; rest.textContent = remedy; code.textContent = name;
      item.classList.toggle("note", name === "ENCODER_MOVING");  // a car that is still rolling has no fault
      item.append(head, " ", rest, " ", code);
      return item;
    }));
  }
  function showStatus(s) {
    mode = s.mode;
    setBadge(mode);
    if (isDriver && !s.driven) setDriver(false);
    if (!isDriver) $("take").disabled = s.driven;
    $("arm").disabled = !isDriver || mode !== "DISARMED";
    $("unlock").hidden = !isDriver || mode !== "LOCKED";
    $("link").textContent = `${s.link.age_ms} ms, ${s.pages} page${s.pages === 1 ? "" : "s"}${s.battery === null ? "" : `, ${format(s.battery, 1, "V")}`}`;
    if (s.frame !== frame) { frame = s.frame; Floor.map(maps[frame] || maps[""] || []); }
    showNumbers(s);
    Camera.status(s.camera, s.t);
    showProblems([...(s.trouble ? [{ name: "link lost", text: s.trouble, remedy: "" }] : []), ...(s.trips ? [s.trips] : []), ...s.refusals]);
    $("record").hidden = !("recording" in s) || !isDriver;
    if (!$("record").hidden) { $("record").classList.toggle("on", Boolean(s.recording)); $("record").textContent = s.recording ? `Stop recording ${s.recording}` : "Record"; }
  }

  // The socket is closed: find out whether the server has ended or has no place for this page.
  function explainLoss() {
    const gone = () => { setBadge("gone"); if (first) addNotice("the program that serves this page has ended, or the network is gone"); first = false; };
    fetch("/socket", { cache: "no-store" }).then((answer) => {
      if (answer.status === 503) { setBadge("full"); if (first) addNotice("too many pages are open: this page shows nothing, but its STOP works"); first = false; } else gone();
    }, gone);
  }
  function connect() {
    socket = new WebSocket(`ws://${location.host}/socket`);
    socket.onopen = () => { setBadge("connected"); };
    socket.onmessage = (event) => { const message = JSON.parse(event.data); (handlers[message.type] || (() => {}))(message); };
    socket.onclose = (event) => {
      setDriver(false); setStale(true); heard = null;
      if (event.code === REPLACED) { setBadge("full"); addNotice("a newer page replaced this one: reload it to watch again; its STOP works"); return; }
      explainLoss(); setTimeout(connect, 1000);
    };
  }

  const isServerAlive = () => socket && socket.readyState === 1 && performance.now() - heardAt < SILENT_AFTER_MS;
  const stop = Stop.install({ send: () => { send({ type: "stop" }); return isServerAlive(); }, addNotice, releaseStick: Stick.release });
  $("take").onclick = () => { if (isDriver) { setDriver(false); send({ type: "leave" }); } else send({ type: "take", token }); };
  $("arm").onclick = () => send({ type: "arm" });
  $("unlock").onclick = () => send({ type: "unlock" });
  $("record").onclick = () => send({ type: "record", on: !$("record").classList.contains("on") });

  setInterval(() => {
    if (socket && socket.readyState === 1 && heard !== null && performance.now() - heardAt > SILENT_AFTER_MS) { setBadge("no news"); setStale(true); }
    if (!$("stop").hidden && Stick.isStopPressed()) { if (!padStops) stop(); padStops = true; } else padStops = false;
    const position = Stick.read();
    if (!isDriver || heard === null || document.hidden) { holding = false; return; }
    if (position) { holding = true; send({ type: "drive", steering: position[0], throttle: position[1], heard, unchanged: Stick.unchanged() / 1000 }); }
    else if (holding || mode === "ARMED") { holding = false; send({ type: "release", heard }); }  // neutral, and this page still watches
  }, SEND_PERIOD_MS);
  // A page that is hidden or left cannot be driven from: without `heard` the drive ends.
  const releaseHidden = () => { if (isDriver) { holding = false; send({ type: "release" }); } };
  document.addEventListener("visibilitychange", () => { if (document.hidden) releaseHidden(); });
  addEventListener("pagehide", releaseHidden);
  setDriver(false);
  // Without a server, as static files with one or two runs: index.html?run=run.json&run=other.json
  const [file, ...other] = new URLSearchParams(location.search).getAll("run");
  const read = (name) => fetch(name).then((answer) => answer.json());
  if (file) Promise.all([file, ...other.slice(0, 1)].map(read)).then(([one, second]) => handlers.run({ ...one, second }), () => addNotice(`${[file, ...other].join(", ")} cannot be read`));
  else connect();
})();
