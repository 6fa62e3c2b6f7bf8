"use strict";
// STOP of both pages: the button, and the space bar with every focus. `Stop.install({ send, say, drop })`.
// send: deliver through the socket, returns whether it is open and the server was heard just now; say: show a sentence; drop: let go of the stick.
const Stop = (() => {
  const SAME_PRESS = 400;  // ms; a finger is reported when it comes down, and its click is the same press
  const button = document.getElementById("stop");
  // A recorded run has nothing to stop: its button is gone, and the space bar is that of the browser.
  const isSpace = (event) => (event.code === "Space" || event.key === " ") && button.style.display !== "none";
  let pressed = -1e9;

  // A way without a socket: all places for watching may be taken, or the socket hangs.
  function request(say) {
    fetch("/stop", { headers: { "X-Dart-Stop": "1" }, cache: "no-store" }).then(
      (answer) => { if (!answer.ok) say(`STOP was refused: ${answer.status} ${answer.statusText}. Take the car by hand.`); },
      () => say("STOP did not reach the program. Take the car by hand."));
  }
  return {
    install({ send, say, drop }) {
      function stop() {
        drop();
        if (performance.now() - pressed > SAME_PRESS && !send()) request(say);
        pressed = performance.now();
      }
      for (const name of ["pointerdown", "click"]) button.addEventListener(name, stop);
      // In the capture phase and without the default action: no element gets the key first, none is pressed by it.
      addEventListener("keydown", (event) => { if (isSpace(event)) { event.preventDefault(); event.stopPropagation(); stop(); } }, true);
      for (const name of ["keypress", "keyup"]) addEventListener(name, (event) => { if (isSpace(event)) { event.preventDefault(); event.stopPropagation(); } }, true);
    },
  };
})();
