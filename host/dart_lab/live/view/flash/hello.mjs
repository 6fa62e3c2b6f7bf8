// HELLO, the message with the identity of the firmware: docs/reference/wire.md. Its layout never changes.
const HELLO = 0x01, LENGTH = 2 + 34 + 2, MAX_BLOCK_BYTES = 256;
export const HELLO_REQ = [2, 2, 2, 1, 1, 1, 1, 1, 3, 0x38, 0xfb, 0];  // seq 0, proto 1, schema 0, flags 0
export const BOOTLOADERS = ["unknown", "ATmegaBOOT (57600)", "Optiboot (115200)"];

export function cobs(block) {  // the decoded bytes, or null for an invalid block
  const out = [];
  for (let i = 0; i < block.length;) {
    const code = block[i], end = i + code;
    if (!code || end > block.length) return null;
    out.push(...block.slice(i + 1, end));
    if (code < 0xff && end < block.length) out.push(0);
    i = end;
  }
  return out;
}

export function crc16(bytes) {  // CCITT, polynomial 0x1021, from 0xffff
  let crc = 0xffff;
  for (const byte of bytes) {
    crc ^= byte << 8;
    for (let bit = 0; bit < 8; bit++) crc = (crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1) & 0xffff;
  }
  return crc;
}

function read(block) {
  const frame = cobs(block);
  if (frame?.length !== LENGTH || frame[0] !== HELLO) return null;
  const view = new DataView(Uint8Array.from(frame).buffer);
  if (view.getUint16(LENGTH - 2, true) !== crc16(frame.slice(0, -2))) return null;
  const at = 2;  // offset of the payload, after type and seq
  return { schema: view.getUint32(at + 2, true), version: frame.slice(at + 6, at + 9),
    board: view.getUint32(at + 14, true), boots: view.getUint16(at + 18, true), bootloader: frame[at + 21] };
}

export class Listener {
  constructor() { this.block = []; }

  feed(bytes) {  // the first HELLO in them, or null
    for (const byte of bytes) {
      if (byte && this.block.length <= MAX_BLOCK_BYTES) this.block.push(byte);
      if (byte) continue;
      const hello = read(this.block);
      this.block = [];
      if (hello) return hello;
    }
    return null;
  }
}
