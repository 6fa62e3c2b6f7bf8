"use strict";
// Page of all cars of some rooms: a card and a place on the map for each car, and one STOP.
(() => {
  const $ = (id) => document.getElementById(id);
  const cards = new Map(), colours = new Map();
  // Distinguishable with each kind of colour blindness (Okabe and Ito), on light and dark ground.
  const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#8c6bb1", "#8a7a00"];
  let chosen = null;
  let socket = null, heardAt = -1e9;
  const SILENT_AFTER_MS = 1500;

  function setBadge(text, css) { $("mode").textContent = text; $("mode").className = `badge ${css}`; }
  function findCard(key) {
    if (!cards.has(key)) {
      const item = document.createElement("article");
      item.append(...["b", "span", "p", "p"].map((tag) => document.createElement(tag)));
      cards.set(key, item);
      colours.set(key, COLOURS[colours.size % COLOURS.length]);
      $("cars").append(item);
    }
    return cards.get(key);
  }
  const keyOf = (car) => `${car.room} ${car.name}`;
  // Poses of different frames do not compare: the frame of the start is of one car alone.
  const frameOf = (car) => car.pose.own_frame ? `start of ${car.name}` : car.pose.frame;
  const groupOf = (car) => `${car.room} ${frameOf(car)}`;

  // The map shows one frame: the chosen one, or that of the most cars.
  function showMap(cars) {
    const groups = new Map();
    for (const car of cars) if (car.pose) groups.set(groupOf(car), [...(groups.get(groupOf(car)) || []), car]);
    const largest = [...groups].reduce((best, one) => !best || one[1].length > best[1].length ? one : best, null);
    const shown = groups.has(chosen) ? chosen : largest && largest[0];
    $("frames").hidden = groups.size < 2;
    const labels = [...groups].map(([key, some]) => [key, `${frameOf(some[0])}: ${some.length} car${some.length === 1 ? "" : "s"}`]);
    const text = JSON.stringify([labels, shown]);
    if (text !== $("frames").dataset.shown) {
      $("frames").dataset.shown = text;
      $("frames").replaceChildren(...labels.map(([key, label]) => {
        const choice = document.createElement("button");
        choice.textContent = label;
        choice.setAttribute("aria-pressed", key === shown);
        choice.onclick = () => { chosen = key; showMap(cars); };
        return choice;
      }));
    }
    for (const car of cars) findCard(keyOf(car)).classList.toggle("elsewhere", !car.pose || groupOf(car) !== shown);
    Floor.others((groups.get(shown) || []).map((car) => ({ ...car.pose, name: car.state === "lost" ? `${car.name} (lost)` : car.name, colour: colours.get(keyOf(car)) })));
  }
  function showCar(car) {
    const item = findCard(keyOf(car)), [name, state, where, why] = item.children, p = car.pose;
    item.className = car.state;
    item.dataset.name = car.name;
    if (!name.firstElementChild) { name.append(document.createElement("i"), car.name); name.firstElementChild.style.background = colours.get(keyOf(car)); }
    state.textContent = car.state === "lost" ? `lost for ${car.silent.toFixed(1)} s` : car.state;
    where.textContent = p ? `${p.speed.toFixed(2)} m/s at ${p.x.toFixed(2)}, ${p.y.toFixed(2)} m (${p.frame})` : "no pose";
    if (car.battery !== null) where.textContent += `, battery ${car.battery.toFixed(1)} V`;
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
      showMap(message.cars);
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
