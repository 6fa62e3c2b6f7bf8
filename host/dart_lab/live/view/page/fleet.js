"use strict";
// Page of all cars of some rooms: a card and a place on the map for each car, and one STOP.
(() => {
  const $ = (id) => document.getElementById(id);
  const cards = new Map();
  let socket = null, heardAt = -1e9;
  const SILENT_AFTER_MS = 1500;

  function setBadge(text, css) { $("mode").textContent = text; $("mode").className = `badge ${css}`; }
  function findCard(key) {
    if (!cards.has(key)) {
      const item = document.createElement("article");
      item.append(...["b", "span", "p", "p"].map((tag) => document.createElement(tag)));
      cards.set(key, item);
      $("cars").append(item);
    }
    return cards.get(key);
  }
  function showCar(car) {
    const item = findCard(`${car.room} ${car.name}`), [name, state, where, why] = item.children, p = car.pose;
    item.className = car.state;
    item.dataset.name = car.name;
    name.textContent = car.name;
    state.textContent = car.state === "lost" ? `lost for ${car.silent.toFixed(1)} s` : car.state;
    where.textContent = p ? `${p.speed.toFixed(2)} m/s at ${p.x.toFixed(2)}, ${p.y.toFixed(2)} m (${p.frame})` : "no pose";
    why.textContent = [car.state === "refused" ? car.mode : "", car.why].filter(Boolean).join(": ");
  }
  // Handlers of the messages, by type.
  const handlers = {
    rooms(message) {
      $("rooms").textContent = message.rooms.join("  ");
      $("open").hidden = !message.open.length;
    },
    cars(message) {
      const lost = message.cars.filter((car) => car.state === "lost").length;
      setBadge(`${message.cars.length} car${message.cars.length === 1 ? "" : "s"}${lost ? `, ${lost} lost` : ""}`, lost ? "gone" : "");
      message.cars.forEach(showCar);
      Floor.others(message.cars.filter((car) => car.pose).map((car) => ({ ...car.pose, name: car.name })));
    },
    said(message) { Notices.add(message.text); },
  };
  function connect() {
    socket = new WebSocket(`ws://${location.host}/socket`);
    socket.onmessage = (event) => { heardAt = performance.now(); const message = JSON.parse(event.data); (handlers[message.type] || (() => {}))(message); };
    socket.onclose = (event) => { if (event.code === 4001) { setBadge("a newer page replaced this one: reload; STOP ALL works", "full"); return; } setBadge("the server of this page does not answer", "gone"); explainLoss(); setTimeout(connect, 1000); };
  }
  // The socket is closed: find out whether the server has ended or has no place for this page.
  function explainLoss() {
    const ended = "the server of this page does not answer: STOP ALL has no effect";
    fetch("/socket", { cache: "no-store" }).then((answer) => setBadge(answer.status === 503
      ? "too many pages are open: STOP ALL works" : ended, "gone"), () => setBadge(ended, "gone"));
  }
  function send() {
    if (socket.readyState === 1) socket.send('{"type":"stop"}');
    return socket.readyState === 1 && performance.now() - heardAt < SILENT_AFTER_MS;
  }
  Stop.install({ send, addNotice: Notices.add, releaseStick: () => {} });
  connect();
})();
