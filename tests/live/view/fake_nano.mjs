// A port of Web Serial with a Nano behind it, as small as the flasher needs it. What it does wrong is an option:
// speed of its bootloader, signature, worn (address of a byte that keeps its value), mute (command it never answers),
// pulled (commands until the cable is out), busy, noisy (a byte at another speed ends the stream, as a break does),
// hello (bytes of its program at 500000 baud).
const IN_SYNC = 0x14, OK = 0x10, END = 0x20;

export class FakeNano {
  constructor({ speed = 57600, signature = [0x1e, 0x95, 0x0f], worn = -1, mute = 0, pulled = Infinity, busy = false, noisy = false, hello = [] }) {
    Object.assign(this, { speed, signature, worn, mute, pulled, busy, noisy, hello, dtr: true, boots: false, at: 0, asked: [], speeds: [] });
    this.flash = new Uint8Array(0x7800).fill(0xff);
  }

  async open({ baudRate }) {
    if (this.busy) throw new Error("Failed to open serial port.");
    this.baud = baudRate;
    this.speeds.push(baudRate);
    this.stream();
    this.writable = new WritableStream({ write: (bytes) => this.hear([...bytes]) });
  }

  stream() { this.readable = new ReadableStream({ start: (out) => { this.out = out; } }); }

  async close() { this.readable = this.writable = null; }

  async setSignals({ dataTerminalReady }) {
    if (dataTerminalReady && !this.dtr) {
      this.boots = true;
      if (this.baud === 500000 && this.hello.length) this.say(this.hello);
    }
    this.dtr = dataTerminalReady;
  }

  say(bytes) { for (const byte of bytes) this.out.enqueue(Uint8Array.of(byte)); }

  hear(bytes) {
    if (this.asked.length >= this.pulled) {
      this.readable = null;
      this.out.error(new Error("The device has been lost."));
      throw new Error("The device has been lost.");
    }
    if (this.noisy && this.baud !== this.speed) {
      const { out } = this;
      this.stream();
      out.error(new Error("Framing error"));
    }
    if (!this.boots || this.baud !== this.speed || bytes[0] === this.mute) return;
    this.asked.push(bytes[0]);
    const answer = this.answer(bytes);
    if (bytes.at(-1) === END) this.say([IN_SYNC, ...answer, OK]);
  }

  answer([command, ...more]) {
    if (command === 0x75) return this.signature;
    if (command === 0x55) this.at = 2 * (more[0] + 256 * more[1]);
    if (command === 0x64) this.write(more.slice(3, -1));
    if (command === 0x74) return this.flash.slice(this.at, this.at + more[1]);
    if (command === 0x51) this.boots = false;
    return [];
  }

  write(page) {
    const kept = this.flash[this.worn];
    this.flash.set(page, this.at);
    if (this.worn >= 0) this.flash[this.worn] = kept;
  }
}
