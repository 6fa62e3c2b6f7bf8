"""The protocol between Nano and host: ``messages`` defines it, all other code is derived.

``codec``, ``cobs``, ``crc`` and ``decoder`` convert messages to bytes and back; ``emit`` generates
the C++ header, the reference page and the golden vectors.
"""
