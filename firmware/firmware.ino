// Stub for the Arduino IDE, which compiles src/ by itself; setup() and loop()
// are in src/main.cpp. The IDE needs gnu++14: see platform.local.txt.
