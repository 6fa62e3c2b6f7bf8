// Flash a Nano: find the bootloader, write, verify, restart, wait for HELLO.
import { Failure } from "./failures.mjs";
import { HELLO_REQ, Listener } from "./hello.mjs";
import { Line } from "./serial.mjs";
import { Bootloader } from "./stk500.mjs";

export const SPEEDS = [115200, 57600];  // Optiboot, ATmegaBOOT
const RATES = [500000, 115200];  // baud of the firmware; the second is set by its parameter `baud`
// After the reset only listen: a byte would prolong the wait of the bootloader, at most 1.33 s. Then request HELLO.
const LISTEN_MS = 2000, REQUEST_MS = 1500, REQUEST_PERIOD_MS = 100;

// onProgress(step, share): the present step and the finished share of it (null: unknown).
// Returns {speed, bytes, hello}; hello null: the program is no firmware of ours. Throws Failure.
export async function flash(port, image, onProgress) {
  const line = new Line(port);
  try {
    const [speed, chip] = await findBootloader(line, onProgress);
    await chip.begin();
    await chip.write(image, (share) => onProgress("Writing", share));
    await chip.verify(image, (share) => onProgress("Verifying", share));
    await chip.leave();
    await line.close();
    return { speed, bytes: image.length, hello: await waitForHello(line, onProgress) };
  } finally { await line.close(); }
}

async function findBootloader(line, onProgress) {
  for (const speed of SPEEDS) {
    onProgress(`Looking for the bootloader at ${speed} baud`, null);
    await line.open(speed);
    await line.pulse();
    const chip = new Bootloader(line);
    if (await chip.answers()) return [speed, chip];
    await line.close();
  }
  throw new Failure("silent");
}

async function waitForHello(line, onProgress) {
  for (const rate of RATES) {
    onProgress("Waiting for the firmware's HELLO", null);
    await line.open(rate);
    await line.pulse();
    const listener = new Listener(), start = Date.now();
    for (let elapsed = 0; elapsed < LISTEN_MS + REQUEST_MS; elapsed = Date.now() - start) {
      if (elapsed >= LISTEN_MS) await line.send(HELLO_REQ);
      const hello = listener.feed(await line.take(Infinity, REQUEST_PERIOD_MS));
      if (hello) return hello;
    }
    await line.close();
  }
  return null;
}
