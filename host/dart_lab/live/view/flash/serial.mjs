// A serial line on a port of Web Serial: send bytes, receive bytes within a time, reset pulse.
import { Failure } from "./failures.mjs";

const LOW_MS = 250, HIGH_MS = 50;  // as in avrdude
export const pause = (ms) => new Promise((done) => setTimeout(done, ms));

export class Line {
  constructor(port) { Object.assign(this, { port, isOpen: false, lost: "", received: [], wake: () => {} }); }

  async open(baudRate) {
    try {
      await this.port.open({ baudRate, bufferSize: 4096 });
    } catch (why) { throw new Failure("busy", why.message); }
    Object.assign(this, { isOpen: true, lost: "", received: [] });
    this.writer = this.port.writable.getWriter();
    this.ended = this.#listen();
  }

  async #listen() {
    let exists = true;
    while (exists && this.isOpen && this.port.readable) {  // noise at a wrong speed ends a stream; the port then offers another one
      this.reader = this.port.readable.getReader();
      try {
        for (;;) {
          const { value, done } = await this.reader.read();
          exists = !done;
          if (done) break;
          for (const byte of value) this.received.push(byte);
          this.wake();
        }
      } catch (why) { this.why = why.message; } finally { this.reader.releaseLock(); }
    }
    if (this.isOpen) this.lost = this.why || "the port is gone";
    this.wake();
  }

  async #throwIfLost(lost, work) {
    if (this.lost) throw new Failure("pulled", this.lost);
    try {
      return await work();
    } catch (why) { throw new Failure("pulled", why.message || lost); }
  }

  send(bytes) { return this.#throwIfLost("it takes no byte", () => this.writer.write(Uint8Array.from(bytes))); }

  async pulse() {  // DTR goes through 100 nF to RESET: the Nano restarts when it is asserted
    const set = (on) => this.#throwIfLost("it has no DTR", () => this.port.setSignals({ dataTerminalReady: on, requestToSend: on }));
    await set(false);
    await pause(LOW_MS);
    await set(true);
    await pause(HIGH_MS);
  }

  clear() { this.received = []; }

  async take(n, ms) {  // the next n bytes, or those received within ms
    const ends = Date.now() + ms;
    while (this.received.length < n && !this.lost && Date.now() < ends)
      await Promise.race([pause(ends - Date.now()), new Promise((done) => { this.wake = done; })]);
    if (this.lost) throw new Failure("pulled", this.lost);
    return this.received.splice(0, n);
  }

  async close() {  // in any state
    if (!this.isOpen) return;
    this.isOpen = false;
    try {
      await this.reader?.cancel().catch(() => {});  // of a port that is gone
      await this.ended;
      this.writer.releaseLock();
      await this.port.close();
    } catch (why) { this.lost = why.message; }
  }
}
