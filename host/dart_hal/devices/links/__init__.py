"""Bytes to and from a Nano: serial port, emulator.

Importing this package registers ``avr://`` with pyserial. The emulator itself is loaded only when
such a URL is opened.
"""

from contextlib import suppress

with suppress(ImportError):  # pyserial needs fcntl or Windows
    import serial

    if __name__ not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(__name__)
