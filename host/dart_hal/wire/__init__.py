"""The protocol between Nano and host: ``messages`` defines it, everything else is derived.

``codec``, ``cobs``, ``crc`` and ``decoder`` make bytes of messages and back; ``emit`` generates the
C++ header, the table and the golden vectors.
"""
