// Failures by kind: message and remedy.
export const FAILURES = {
  unsupported: ["This browser cannot reach a serial port.",
    "Open this page in Chrome, Edge or another Chromium on a desk computer, or type dart-hal flash in a terminal."],
  insecure: ["A browser allows serial ports only to an address that begins with https:// or http://localhost.",
    "Type dart-hal flash --browser on the computer that the Nano is plugged into, and open the address that it prints."],
  unchosen: ["No port was chosen.",
    "Plug the Nano in and choose it from the list. An empty list: another USB cable (many only charge), or the driver of its USB chip (CH340 on most clones)."],
  busy: ["The port cannot be opened.",
    "Close the program that uses it: dart-hal, a serial monitor, another page. On Linux you must be in the group dialout (log in again after joining it)."],
  silent: ["No bootloader answers, neither at 115200 nor at 57600 baud.",
    "Is it the Nano's port? Press its reset button just after you start. Unplug all wires at D0, D1 and RESET. A chip without a bootloader needs a programmer (ISP)."],
  chip: ["This is another chip than the Nano's ATmega328P.",
    "Choose the port of the Nano. Nothing was written."],
  garbled: ["The bootloader stopped answering.",
    "Start again. If it comes back: a shorter USB cable, a port of the computer itself in place of a hub."],
  mismatch: ["The bytes that were read back differ from those that were written.",
    "Start again. If it stops at the same address the chip's flash is worn: take another Nano. Do not drive with this one."],
  pulled: ["The connection was lost.",
    "Is the USB cable in at both ends? Plug it in and start again: a half-written Nano still has its bootloader."],
  hex: ["This is no firmware for a Nano.",
    "Choose an Intel hex file for the ATmega328P, like dart_nano.hex."],
  absent: ["The firmware of this page cannot be loaded.",
    "Load this page again, or choose a .hex file."],
};

export class Failure extends Error {
  // kind: a key of FAILURES; found: the observation, such as an error of the browser.
  constructor(kind, found = "") {
    super(FAILURES[kind][0] + (found && ` (${found})`));
    Object.assign(this, { kind, found, remedy: FAILURES[kind][1] });
  }
}
