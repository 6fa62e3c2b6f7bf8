// Intel hex to bytes of the flash, from address 0 to the last one placed; gaps read 0xff.
import { Failure } from "./failures.mjs";

export const MAX_IMAGE_BYTES = 0x7800;  // below the 2 KiB that the Nano's fuses reserve for a bootloader
const DATA = 0, END = 1, SEGMENT = 2, START = 3, LINEAR = 4, START_LINEAR = 5;

export function parse(text) {
  const flash = new Uint8Array(MAX_IMAGE_BYTES).fill(0xff);
  let base = 0, end = 0;
  for (const [index, line] of text.trim().split(/\s+/).entries()) {
    const bad = (why) => new Failure("hex", `line ${index + 1} ${why}`);
    if (!/^:([0-9a-f]{2}){5,}$/i.test(line)) throw bad("is no Intel hex record");
    const record = Uint8Array.from(line.slice(1).match(/../g), (pair) => parseInt(pair, 16));
    if (record.length !== record[0] + 5) throw bad("is no Intel hex record");
    if (record.reduce((sum, byte) => sum + byte) & 0xff) throw bad("has a wrong checksum");
    const data = record.subarray(4, -1), kind = record[3];
    const at = base + record[1] * 0x100 + record[2];
    if (kind === DATA) {
      if (at + data.length > MAX_IMAGE_BYTES) throw bad(`lies beyond the ${MAX_IMAGE_BYTES} bytes of the Nano`);
      flash.set(data, at);
      end = Math.max(end, at + data.length);
    } else if (kind === END) {
      if (!end) throw new Failure("hex", "it holds no byte");
      return flash.slice(0, end);
    } else if ((kind === SEGMENT || kind === LINEAR) && data.length === 2) {
      base = (data[0] * 0x100 + data[1]) * (kind === SEGMENT ? 0x10 : 0x10000);
    } else if (kind !== START && kind !== START_LINEAR) throw bad(`has record type ${kind}`);
  }
  throw new Failure("hex", "its end is missing");
}
