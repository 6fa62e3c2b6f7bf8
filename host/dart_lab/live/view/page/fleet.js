"use strict";
// All cars of the rooms: a card each, a place on the floor, one STOP.
(() => {
  const $ = (id) => document.getElementById(id);
  const cards = new Map();
  let socket = null, heardAt = -1e9;
  const SILENT = 1500;  // ms

  function badge(text, css) { $("mode").textContent = text; $("mode").className = `badge ${css}`; }
  function card(key) {
    if (!cards.has(key)) {
      const item = document.createElement("article");
      item.append(...["b", "span", "p", "p"].map((tag) => document.createElement(tag)));
      cards.set(key, item);
      $("cars").append(item);
    }
    return cards.get(key);
  }
  function show(car) {
    const item = card(`${car.room} ${car.name}`), [name, state, where, why] = item.children, p = car.pose;
    item.className = car.state;
    item.dataset.name = car.name;
    name.textContent = car.name;
    state.textContent = car.state === "lost" ? `lost for ${car.silent.toFixed(1)} s` : car.state;
    where.textContent = p ? `${p.speed.toFixed(2)} m/s at ${p.x.toFixed(2)}, ${p.y.toFixed(2)} m (${p.frame})` : "no pose";
    why.textContent = [car.state === "refused" ? car.mode : "", car.why].filter(Boolean).join(": ");
  }
  const said = {
    rooms(message) {
      $("rooms").textContent = message.rooms.join("  ");
      $("open").hidden = !message.open.length;
    },
    cars(message) {
      const lost = message.cars.filter((car) => car.state === "lost").length;
      badge(`${message.cars.length} car${message.cars.length === 1 ? "" : "s"}${lost ? `, ${lost} lost` : ""}`, lost ? "gone" : "");
      message.cars.forEach(show);
      Floor.others(message.cars.filter((car) => car.pose).map((car) => ({ ...car.pose, name: car.name })));
    },
    said(message) { Said.say(message.text); },
  };
  function open() {
    socket = new WebSocket(`ws://${location.host}/socket`);
    socket.onmessage = (event) => { heardAt = performance.now(); const message = JSON.parse(event.data); (said[message.type] || (() => {}))(message); };
    socket.onclose = (event) => { if (event.code === 4001) { badge("a newer page took this place: reload; STOP ALL works", "full"); return; } badge("this page has lost its program", "gone"); lost(); setTimeout(open, 1000); };
  }
  function lost() {
    fetch("/socket", { cache: "no-store" }).then((answer) => badge(answer.status === 503
      ? "all places for watching are taken: STOP ALL works" : "this page has lost its program: it can stop nothing", "gone"),
    () => badge("this page has lost its program: it can stop nothing", "gone"));
  }
  function send() {
    if (socket.readyState === 1) socket.send('{"type":"stop"}');
    return socket.readyState === 1 && performance.now() - heardAt < SILENT;
  }
  Stop.install({ send, say: Said.say, drop: () => {} });
  open();
})();
