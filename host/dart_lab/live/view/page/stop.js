"use strict";
// STOP of both pages: the button, and the space bar with every focus. `Stop.install({ send, addNotice, releaseStick })` returns
// the function that stops.
// send: sends STOP through the socket, returns whether it is open and the server has answered recently; addNotice: shows a text;
// releaseStick: releases the stick.
const Stop = (() => {
  // A touch is reported as pointerdown and as click; both within this time are one press.
  const SAME_PRESS_MS = 400;
  const button = document.getElementById("stop");
  // The page of a recorded run has no STOP button; the space bar keeps its function in the browser.
  const isSpace = (event) => (event.code === "Space" || event.key === " ") && !button.hidden;
  let pressed = -1e9;

  // STOP without a socket: too many pages may be open, or the socket hangs.
  function requestStop(addNotice) {
    fetch("/stop", { headers: { "X-Dart-Stop": "1" }, cache: "no-store" }).then(
      (answer) => { if (!answer.ok) addNotice(`STOP was refused: ${answer.status} ${answer.statusText}. Take the car by hand.`); },
      () => addNotice("STOP did not reach the program. Take the car by hand."));
  }
  return {
    install({ send, addNotice, releaseStick }) {
      function stop() {
        releaseStick();
        if (performance.now() - pressed > SAME_PRESS_MS && !send()) requestStop(addNotice);
        pressed = performance.now();
      }
      for (const name of ["pointerdown", "click"]) button.addEventListener(name, stop);
      // In the capture phase and without the default action, so that no element gets the key first or is pressed by it.
      addEventListener("keydown", (event) => { if (isSpace(event)) { event.preventDefault(); event.stopPropagation(); stop(); } }, true);
      for (const name of ["keypress", "keyup"]) addEventListener(name, (event) => { if (isSpace(event)) { event.preventDefault(); event.stopPropagation(); } }, true);
      return stop;
    },
  };
})();
