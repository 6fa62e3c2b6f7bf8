// A port of Web Serial, as a line: bytes out, bytes in within a time, the reset pulse.
import { Failure } from "./failures.mjs";

const LOW = 250, HIGH = 50;  // ms; as long as avrdude keeps them
export const pause = (ms) => new Promise((done) => setTimeout(done, ms));

export class Line {
  constructor(port) { Object.assign(this, { port, isOpen: false, lost: "", heard: [], wake: () => {} }); }

  async open(baudRate) {
    try {
      await this.port.open({ baudRate, bufferSize: 4096 });
    } catch (why) { throw new Failure("busy", why.message); }
    Object.assign(this, { isOpen: true, lost: "", heard: [] });
    this.writer = this.port.writable.getWriter();
    this.ended = this.#listen();
  }

  async #listen() {
    let there = true;
    while (there && this.isOpen && this.port.readable) {  // noise at a wrong speed ends one stream, and there is another
      this.reader = this.port.readable.getReader();
      try {
        for (;;) {
          const { value, done } = await this.reader.read();
          there = !done;
          if (done) break;
          for (const byte of value) this.heard.push(byte);
          this.wake();
        }
      } catch (why) { this.why = why.message; } finally { this.reader.releaseLock(); }
    }
    if (this.isOpen) this.lost = this.why || "the port is gone";
    this.wake();
  }

  async #unless(lost, work) {
    if (this.lost) throw new Failure("pulled", this.lost);
    try {
      return await work();
    } catch (why) { throw new Failure("pulled", why.message || lost); }
  }

  send(bytes) { return this.#unless("it takes no byte", () => this.writer.write(Uint8Array.from(bytes))); }

  async pulse() {  // DTR goes through 100 nF to RESET: the Nano starts anew when it is asserted
    const set = (on) => this.#unless("it has no DTR", () => this.port.setSignals({ dataTerminalReady: on, requestToSend: on }));
    await set(false);
    await pause(LOW);
    await set(true);
    await pause(HIGH);
  }

  clear() { this.heard = []; }

  async take(n, ms) {  // the next n bytes, or what came within ms
    const ends = Date.now() + ms;
    while (this.heard.length < n && !this.lost && Date.now() < ends)
      await Promise.race([pause(ends - Date.now()), new Promise((done) => { this.wake = done; })]);
    if (this.lost) throw new Failure("pulled", this.lost);
    return this.heard.splice(0, n);
  }

  async close() {  // whatever state it is in
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
