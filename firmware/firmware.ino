// Open this file in the Arduino IDE, choose the board Arduino Nano and the
// processor of your bootloader, and upload. The IDE compiles src/ by itself;
// setup() and loop() are in src/main.cpp.
