"""Web Serial in a headless browser: ports that are sockets to an emulated Nano.

The Nano runs in real time, and only while a port is open. Its RESET hangs on DTR alone, as through
the capacitor on the board: an edge from released to asserted restarts it.
"""

from __future__ import annotations

import json
import threading
import time
from contextlib import contextmanager

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

PACE = 0.002
ANSWER_DELAY_S = 0.1
"""s; a Nano that is later is not chased."""

SHIM = """
(() => {
const gone = (what) => new DOMException(what, "NetworkError");
class Port {
  async open({ baudRate }) {
    const socket = this.socket = new WebSocket("ws://127.0.0.1:PORT/" + baudRate);
    socket.binaryType = "arraybuffer";
    await new Promise((done, fail) => {
      socket.onopen = done;
      socket.onerror = () => fail(gone("Failed to open serial port."));
    });
    this.readable = new ReadableStream({ start: (out) => {
      socket.onmessage = ({ data }) => out.enqueue(new Uint8Array(data));
      socket.onclose = () => {
        this.readable = null;
        out.error(gone("The device has been lost."));
      };
    } });
    this.writable = new WritableStream({ write: (bytes) => {
      if (socket.readyState !== WebSocket.OPEN) throw gone("The device has been lost.");
      socket.send(bytes);
    } });
  }
  async setSignals(signals) { this.socket.send(JSON.stringify(signals)); }
  async close() {
    if (this.socket.readyState === WebSocket.CLOSED) throw gone("The port is already closed.");
    const closed = new Promise((done) => { this.socket.onclose = done; });
    this.socket.close();
    await closed;
    this.readable = this.writable = null;
  }
}
Object.defineProperty(Navigator.prototype, "serial", { value: {
  requestPort: async () => {
    if (PRESENT) return new Port();
    throw new DOMException("No port selected by the user.", "NotFoundError");
  } } });
})();
"""


class Relay:
    """Carries bytes between sockets and a Nano.

    up, down: what becomes of a message from the Nano and to it. deaf: DTR leads nowhere.
    pulled_after: bytes to the Nano until the cable is out. ``speeds``: at which it was opened.
    """

    def __init__(self, nano, *, up=bytes, down=bytes, deaf=False, pulled_after=float("inf")):
        self.nano = nano
        self.up = up
        self.down = down
        self.deaf = deaf
        self.left = pulled_after
        self.dtr = True
        self.speeds = []
        self._one = threading.Lock()

    def __call__(self, socket):
        speed = int(socket.request.path.strip("/"))
        self.speeds.append(speed)
        with self._one:
            self.nano.set_baud(speed)
            start = time.monotonic() - self.nano.now
            try:
                while self.left > 0:
                    for message in self._receive(socket):
                        self._take(message)
                    if time.monotonic() - start - self.nano.now > ANSWER_DELAY_S:
                        start = time.monotonic() - self.nano.now
                    while self.nano.run(time.monotonic() - start):
                        pass
                    answer = b"".join(data for data, _ in self.nano.read())
                    if answer:
                        socket.send(self.up(answer))
            except ConnectionClosed:
                pass

    def _receive(self, socket):
        wait = PACE
        while True:
            try:
                yield socket.recv(timeout=wait)
            except TimeoutError:
                return
            wait = 0

    def _take(self, message):
        if isinstance(message, bytes):
            self.left -= len(message)
            self.nano.write(self.down(message))
            return
        dtr = json.loads(message)["dataTerminalReady"]
        if dtr and not self.dtr and not self.deaf:
            self.nano.reset("external")
        self.dtr = dtr


@contextmanager
def web_serial(browser, relay, *, present=True):
    """``navigator.serial`` of the pages that are opened within; relay None: a port that is busy."""
    with serve(relay or (lambda socket: None), "127.0.0.1", 0, compression=None) as server:
        port = server.socket.getsockname()[1]
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        if relay is None:
            server.shutdown()
        shim = SHIM.replace("PORT", str(port), 1).replace("PRESENT", json.dumps(present))
        # The page's own policy lets it open no socket: the shim may.
        browser.driver.execute_cdp_cmd("Page.enable", {})
        browser.driver.execute_cdp_cmd("Page.setBypassCSP", {"enabled": True})
        browser.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": shim})
        yield
        server.shutdown()
        thread.join()
