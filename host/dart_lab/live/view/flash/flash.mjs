// The whole of it: find the bootloader, write, verify, restart, wait for HELLO.
import { Failure } from "./failures.mjs";
import { HELLO_REQ, Listener } from "./hello.mjs";
import { Line } from "./serial.mjs";
import { Bootloader } from "./stk500.mjs";

export const SPEEDS = [115200, 57600];  // Optiboot, ATmegaBOOT
const RATES = [500000, 115200];  // of the firmware; the second by its parameter `baud`
const LISTEN = 2000, ASK = 1500, EVERY = 100;  // ms; a byte prolongs a bootloader's wait of at most 1.33 s, so none is sent before

// tell(what, share): what is being done, and how much of it (null: unknown).
// Returns {speed, bytes, hello}; hello null: the program is no firmware of ours. Throws Failure.
export async function flash(port, image, tell) {
  const line = new Line(port);
  try {
    const [speed, chip] = await found(line, tell);
    await chip.begin();
    await chip.write(image, (share) => tell("Writing", share));
    await chip.verify(image, (share) => tell("Verifying", share));
    await chip.leave();
    await line.close();
    return { speed, bytes: image.length, hello: await greeted(line, tell) };
  } finally { await line.close(); }
}

async function found(line, tell) {
  for (const speed of SPEEDS) {
    tell(`Looking for the bootloader at ${speed} baud`, null);
    await line.open(speed);
    await line.pulse();
    const chip = new Bootloader(line);
    if (await chip.answers()) return [speed, chip];
    await line.close();
  }
  throw new Failure("silent");
}

async function greeted(line, tell) {
  for (const rate of RATES) {
    tell("Waiting for the firmware's HELLO", null);
    await line.open(rate);
    await line.pulse();
    const listener = new Listener(), start = Date.now();
    for (let gone = 0; gone < LISTEN + ASK; gone = Date.now() - start) {
      if (gone >= LISTEN) await line.send(HELLO_REQ);
      const hello = listener.feed(await line.take(Infinity, EVERY));
      if (hello) return hello;
    }
    await line.close();
  }
  return null;
}
