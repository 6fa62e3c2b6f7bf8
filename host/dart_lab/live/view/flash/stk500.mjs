// STK500 version 1 (Atmel, application note AVR061) as in the bootloaders of the Nano.
// `line` has take(n, ms), send(bytes), clear(); see serial.mjs.
import { Failure } from "./failures.mjs";

export const PAGE = 128;  // bytes of a flash page of the ATmega328P
const SIGNATURE = [0x1e, 0x95, 0x0f];
const IN_SYNC = 0x14, OK = 0x10, END = 0x20, FLASH = 0x46;
const GET_SYNC = 0x30, ENTER = 0x50, LEAVE = 0x51, ADDRESS = 0x55, WRITE = 0x64, READ = 0x74, SIGN = 0x75;
const TRIES = 6, TRY_MS = 200;  // 1.2 s in all: ATmegaBOOT waits 1.3 s, Optiboot 1 s, each from the last byte
const ANSWER_MS = 1000;  // a page takes 4.5 ms to write

const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join(" ");

export class Bootloader {
  constructor(line) { this.line = line; }

  async answers() {  // whether a bootloader answers at the speed of the line
    for (let i = 0; i < TRIES; i++) {
      this.line.clear();
      await this.line.send([GET_SYNC, END]);
      const [first, second] = await this.line.take(2, TRY_MS);
      if (first === IN_SYNC && second === OK) {
        await this.line.take(Infinity, TRY_MS / 4);  // answers to earlier tries
        return true;
      }
    }
    return false;
  }

  async request(command, n = 0) {  // the n bytes of its answer
    this.line.clear();
    await this.line.send([...command, END]);
    const answer = await this.line.take(n + 2, ANSWER_MS);
    if (answer.length !== n + 2 || answer[0] !== IN_SYNC || answer[n + 1] !== OK)
      throw new Failure("garbled", `${answer.length ? hex(answer.slice(0, 8)) : "nothing"} came as answer to command ${hex([command[0]])}`);
    return answer.slice(1, -1);
  }

  async begin() {
    const found = await this.request([SIGN], 3);
    if (hex(found) !== hex(SIGNATURE)) throw new Failure("chip", `signature ${hex(found)}, expected ${hex(SIGNATURE)}`);
    await this.request([ENTER]);
  }

  setAddress(address) { return this.request([ADDRESS, address >> 1 & 0xff, address >> 9]); }  // in words

  async write(image, onProgress) {  // onProgress(share) after each page
    for (let from = 0; from < image.length; from += PAGE) {
      const page = new Uint8Array(PAGE).fill(0xff);
      page.set(image.subarray(from, from + PAGE));
      await this.setAddress(from);
      await this.request([WRITE, 0, PAGE, FLASH, ...page]);
      onProgress(Math.min(1, (from + PAGE) / image.length));
    }
  }

  async verify(image, onProgress) {
    for (let from = 0; from < image.length; from += PAGE) {
      await this.setAddress(from);
      const page = await this.request([READ, 0, PAGE, FLASH], PAGE), expected = image.subarray(from, from + PAGE);
      const i = expected.findIndex((byte, k) => byte !== page[k]);
      if (i >= 0) throw new Failure("mismatch", `address 0x${(from + i).toString(16)}: ${hex([page[i]])}, expected ${hex([expected[i]])}`);
      onProgress(Math.min(1, (from + PAGE) / image.length));
    }
  }

  leave() { return this.request([LEAVE]); }
}
