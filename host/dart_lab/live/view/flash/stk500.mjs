// STK500 version 1 (Atmel, application note AVR061) as the Nano's bootloaders speak it.
// `line` has take(n, ms), send(bytes), clear(); see serial.mjs.
import { Failure } from "./failures.mjs";

export const PAGE = 128;  // bytes of a flash page of the ATmega328P
const SIGNATURE = [0x1e, 0x95, 0x0f];
const IN_SYNC = 0x14, OK = 0x10, END = 0x20, FLASH = 0x46;
const GET_SYNC = 0x30, ENTER = 0x50, LEAVE = 0x51, ADDRESS = 0x55, WRITE = 0x64, READ = 0x74, SIGN = 0x75;
const TRIES = 6, TRY = 200;  // ms; 1.2 s in all: ATmegaBOOT waits 1.3 s, Optiboot 1 s, each from the last byte
const ANSWER = 1000;  // ms; a page takes 4.5 ms to write

const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join(" ");

export class Bootloader {
  constructor(line) { this.line = line; }

  async answers() {  // whether somebody does, at the line's speed
    for (let i = 0; i < TRIES; i++) {
      this.line.clear();
      await this.line.send([GET_SYNC, END]);
      const [first, second] = await this.line.take(2, TRY);
      if (first === IN_SYNC && second === OK) {
        await this.line.take(Infinity, TRY / 4);  // answers to earlier tries
        return true;
      }
    }
    return false;
  }

  async ask(command, n = 0) {  // the n bytes of its answer
    this.line.clear();
    await this.line.send([...command, END]);
    const answer = await this.line.take(n + 2, ANSWER);
    if (answer.length !== n + 2 || answer[0] !== IN_SYNC || answer[n + 1] !== OK)
      throw new Failure("garbled", `${answer.length ? hex(answer.slice(0, 8)) : "nothing"} came to command ${hex([command[0]])}`);
    return answer.slice(1, -1);
  }

  async begin() {
    const found = await this.ask([SIGN], 3);
    if (hex(found) !== hex(SIGNATURE)) throw new Failure("chip", `signature ${hex(found)}, expected ${hex(SIGNATURE)}`);
    await this.ask([ENTER]);
  }

  at(address) { return this.ask([ADDRESS, address >> 1 & 0xff, address >> 9]); }  // in words

  async write(image, told) {  // told(share) after each page
    for (let from = 0; from < image.length; from += PAGE) {
      const page = new Uint8Array(PAGE).fill(0xff);
      page.set(image.subarray(from, from + PAGE));
      await this.at(from);
      await this.ask([WRITE, 0, PAGE, FLASH, ...page]);
      told(Math.min(1, (from + PAGE) / image.length));
    }
  }

  async verify(image, told) {
    for (let from = 0; from < image.length; from += PAGE) {
      await this.at(from);
      const page = await this.ask([READ, 0, PAGE, FLASH], PAGE), wanted = image.subarray(from, from + PAGE);
      const i = wanted.findIndex((byte, k) => byte !== page[k]);
      if (i >= 0) throw new Failure("mismatch", `address 0x${(from + i).toString(16)}: ${hex([page[i]])}, expected ${hex([wanted[i]])}`);
      told(Math.min(1, (from + PAGE) / image.length));
    }
  }

  leave() { return this.ask([LEAVE]); }
}
