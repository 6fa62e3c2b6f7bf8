"use strict";
// The socket: what comes is drawn, what the hand wants goes out. See view/messages.py for what may be said.
(() => {
  const $ = (id) => document.getElementById(id);
  const token = decodeURIComponent(location.hash.slice(1));
  const SEND_EVERY = 33, SILENT = 1500;  // ms
  const REPLACED = 4001;  // code of a socket that is closed for a newer page, see server.py
  let socket = null, fields = [], mine = false, heard = null, heardAt = 0, holding = false, mode = "", first = true, maps = {}, frame = null;

  const send = (message) => { if (socket && socket.readyState === 1) socket.send(JSON.stringify(message)); };
  const say = Said.say;
  function badge(text) { $("mode").textContent = text; $("mode").className = `badge ${text.replace(/ /g, "-")}`; }
  function wheel(on) {
    mine = on;
    $("take").textContent = on ? "Let go of the wheel" : "Take the wheel";
    $("take").classList.toggle("mine", on);
    $("arm").disabled = !on;
    Stick.enable(on);
    if (!on) Stick.drop();
  }

  const said = {
    begin(message) {
      fields = message.fields;
      document.title = $("car").textContent = message.car;
      $("wheel").hidden = !message.drives;
      $("wheel").style.display = message.drives ? "" : "none";
      maps = message.maps; frame = null;
      Camera.begin(message.camera);
      message.notices.forEach(say);
    },
    rows(message) {
      heard = message.now; heardAt = performance.now();
      message.rows.forEach(take);
    },
    log(message) { Plots.log(message.values); },
    scan(message) { Floor.scan(message.points); },
    others(message) { Floor.others(message.poses); },
    said(message) { say(message.text); },
    yours() { wheel(true); },
    run(message) {
      if (!message.rows.length) { say("this run holds no samples"); return; }
      document.title = $("car").textContent = message.car;
      badge("recorded");
      for (const id of ["wheel", "stop"]) $(id).style.display = "none";
      Player.show(message);
    },
    status: show,
  };
  let row = null;
  function take(values) {
    row = Object.fromEntries(fields.map((name, n) => [name, values[n]]));
    Floor.add(row);
    Plots.add(row);
  }

  const number = (v, digits, unit) => v === null || v === undefined ? "-" : `${v.toFixed(digits)} ${unit}`;
  function numbers(s) {
    const deg = 180 / Math.PI, list = {
      "speed": number(row && row.speed, 2, "m/s"), "yaw rate": number(row && row.yaw_rate, 2, "rad/s"),
      "steering": row ? `${number(row.steering === null ? null : row.steering * deg, 1, "deg")} (asked ${number(row.asked_steering === null ? null : row.asked_steering * deg, 1, "deg")})` : "-",
      "throttle": row ? `${number(row.throttle, 3, "")}(asked ${number(row.asked_throttle, 3, "").trim()})` : "-",
      "pulses": `${s.us[0]} / ${s.us[1]} us`, "pose": row ? `${number(row.x, 2, "m")} ${number(row.y, 2, "m")}` : "-",
      "frame": `${s.frame}, ${s.tracking}`, "limited": s.limited.join(", ") || "-", "doubts": s.doubts.join(", ") || "-",
      "link": `${s.link.age_ms} ms, ${s.link.lost} lost, ${s.link.damaged} damaged`,
      "loop": `p99 ${s.loop.p99_ms ?? "-"} ms, ${s.loop.late} late`, "pages": s.pages,
    };
    $("numbers").replaceChildren(...Object.entries(list).flatMap(([name, text]) => {
      const dt = document.createElement("dt"), dd = document.createElement("dd");
      dt.textContent = name; dd.textContent = text;
      return [dt, dd];
    }));
  }
  function trouble(list) {
    $("trouble").replaceChildren(...list.map(({ name, text, remedy }) => {
      const item = document.createElement("div"), head = document.createElement("b"), rest = document.createElement("span"), code = document.createElement("i");
      head.textContent = text; rest.textContent = remedy; code.textContent = name;
      item.classList.toggle("note", name === "ENCODER_MOVING");  // a car that rolls out has no fault
      item.append(head, " ", rest, " ", code);
      return item;
    }));
  }
  function show(s) {
    mode = s.mode;
    badge(mode);
    if (mine && !s.driven) wheel(false);
    if (!mine) $("take").disabled = s.driven;
    $("arm").disabled = !mine || mode !== "DISARMED";
    $("unlock").hidden = !mine || mode !== "LOCKED";
    $("link").textContent = `${s.link.age_ms} ms, ${s.pages} page${s.pages === 1 ? "" : "s"}`;
    if (s.frame !== frame) { frame = s.frame; Floor.map(maps[frame] || maps[""] || []); }
    numbers(s);
    Camera.status(s.camera, s.t);
    trouble([...(s.trouble ? [{ name: "link lost", text: s.trouble, remedy: "" }] : []), ...(s.trips ? [s.trips] : []), ...s.refusals]);
    $("record").hidden = !("recording" in s) || !mine;
    if (!$("record").hidden) { $("record").classList.toggle("on", Boolean(s.recording)); $("record").textContent = s.recording ? `Stop recording ${s.recording}` : "Record"; }
  }

  function lost() {
    const gone = () => { badge("gone"); if (first) say("the program that serves this page has ended, or the network is gone"); first = false; };
    fetch("/socket", { cache: "no-store" }).then((answer) => {
      if (answer.status === 503) { badge("full"); if (first) say("all places for watching are taken: this page shows nothing, but its STOP works"); first = false; } else gone();
    }, gone);
  }
  function open() {
    socket = new WebSocket(`ws://${location.host}/socket`);
    socket.onopen = () => { badge("connected"); };
    socket.onmessage = (event) => { const message = JSON.parse(event.data); (said[message.type] || (() => {}))(message); };
    socket.onclose = (event) => {
      wheel(false); heard = null;
      if (event.code === REPLACED) { badge("full"); say("a newer page took the place of this one: reload it to watch again; its STOP works"); return; }
      lost(); setTimeout(open, 1000);
    };
  }

  const heardLately = () => socket && socket.readyState === 1 && performance.now() - heardAt < SILENT;
  Stop.install({ send: () => { send({ type: "stop" }); return heardLately(); }, say, drop: Stick.drop });
  $("take").onclick = () => { if (mine) { wheel(false); send({ type: "leave" }); } else send({ type: "take", token }); };
  $("arm").onclick = () => send({ type: "arm" });
  $("unlock").onclick = () => send({ type: "unlock" });
  $("record").onclick = () => send({ type: "record", on: !$("record").classList.contains("on") });

  setInterval(() => {
    if (socket && socket.readyState === 1 && heard !== null && performance.now() - heardAt > SILENT) badge("no news");
    const at = Stick.read();
    if (!mine || heard === null) { holding = false; return; }
    if (at) { holding = true; send({ type: "drive", steering: at[0], throttle: at[1], heard, unchanged: Stick.unchanged() / 1000 }); }
    else if (holding) { holding = false; send({ type: "release" }); }
  }, SEND_EVERY);
  const letGo = () => { if (holding && mine) { holding = false; send({ type: "release" }); } };
  document.addEventListener("visibilitychange", () => { if (document.hidden) letGo(); });
  addEventListener("pagehide", letGo);
  wheel(false);
  // As static files, beside a run: index.html?run=run.json
  const file = new URLSearchParams(location.search).get("run");
  if (file) fetch(file).then((answer) => answer.json()).then(said.run, () => say(`${file} cannot be read`));
  else open();
})();
