"""The serial line of MockNano: a byte takes ten bit times."""

from __future__ import annotations

from collections import deque

NEVER = float("inf")


class MockUart:
    """Both directions; ``tx_at``, ``rx_at``: times of the next frame sent and received [s]."""

    def __init__(self, byte_time: float, now: float = 0.0) -> None:
        self.tx_at = self.rx_at = NEVER
        self.tx_free = now
        self._byte = byte_time
        self._sending: deque[tuple[float, bytes]] = deque()
        self._rx_free = now
        self._block = bytearray()
        self._received: deque[tuple[float, bytes]] = deque()

    def send(self, data: bytes, earliest: float) -> None:
        """Queue a frame; its first bit leaves at ``earliest`` or when the line is free."""
        self.tx_free = max(self.tx_free, earliest) + len(data) * self._byte
        self._sending.append((self.tx_free, data))
        self.tx_at = self._sending[0][0]

    def take_sent(self) -> bytes:
        """Return the frame whose last stop bit ends at ``tx_at``."""
        data = self._sending.popleft()[1]
        self.tx_at = self._sending[0][0] if self._sending else NEVER
        return data

    def arrive(self, data: bytes, now: float) -> None:
        """Receive bytes from the host that start on the line now."""
        for byte in data:
            self._rx_free = max(self._rx_free, now) + self._byte
            self._block.append(byte)
            if byte == 0:
                self._received.append((self._rx_free, bytes(self._block)))
                self._block.clear()
        self.rx_at = self._received[0][0] if self._received else NEVER

    def take_received(self) -> bytes:
        """Return the bytes up to the delimiter that arrives at ``rx_at``."""
        block = self._received.popleft()[1]
        self.rx_at = self._received[0][0] if self._received else NEVER
        return block
