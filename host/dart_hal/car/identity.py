"""Identity of a Nano: the values of its HELLO frame, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dart_hal.wire.messages import PROTO, SCHEMA

# Flags of HELLO.build.
BUILD_DIRTY, BUILD_TEST, BUILD_MOCK = 1, 2, 4
# Kind of the hardware cut-off by bits 2 and 3 of HELLO.caps.
CUTOFF_KINDS = {0: "none", 1: "oe", 2: "mux"}
# Bootloader by HELLO.bootloader, with its baud rate.
BOOTLOADERS = {0: "unknown", 1: "ATmegaBOOT (57600)", 2: "Optiboot (115200)"}


@dataclass(frozen=True, slots=True)
class Hello:
    """Identity of a Nano, from its HELLO frame."""

    proto: int
    schema: int
    version: tuple[int, int, int]
    build: int
    git: int
    board_id: int
    boot_count: int
    reset_cause: int
    bootloader: int
    boot_nonce: int
    edges_per_rev: tuple[int, int]
    caps: int
    clock_hz: int

    @classmethod
    def from_frame(cls, values: dict[str, Any]) -> Hello:
        """Build the identity from the fields of a HELLO frame."""
        return cls(
            proto=values["proto"], schema=values["schema"],
            version=tuple(values["fw_version"]), build=values["build"], git=values["git"],
            board_id=values["board_id"], boot_count=values["boot_count"],
            reset_cause=values["reset_cause"], bootloader=values["bootloader"],
            boot_nonce=values["boot_nonce"], edges_per_rev=tuple(values["edges_per_rev"]),
            caps=values["caps"], clock_hz=values["clock_hz"])

    @property
    def board(self) -> str:
        """Return the board number as in the files of a car: 8 hex digits."""
        return f"{self.board_id:08x}"

    @property
    def cutoff(self) -> str:
        """Return the hardware cut-off of the Nano: none, oe or mux; an unknown kind is none."""
        return CUTOFF_KINDS.get(self.caps >> 2 & 3, "none")

    @property
    def mock(self) -> bool:
        """Return whether the frames are from MockNano, not from firmware."""
        return bool(self.build & BUILD_MOCK)

    @property
    def dirty(self) -> bool:
        """Return whether the firmware was built from sources that were not committed."""
        return bool(self.build & BUILD_DIRTY)

    @property
    def same_schema(self) -> bool:
        """Return whether the firmware has the message definitions of this host."""
        return self.schema == SCHEMA

    @property
    def proto_supported(self) -> bool:
        """Return whether this host supports the protocol: its own, one older, one newer."""
        return abs(self.proto - PROTO) <= 1

    def as_json(self) -> dict[str, Any]:
        """Return the identity as the object of ``--json``."""
        return {
            "firmware": ".".join(map(str, self.version)), "git": f"{self.git:08x}",
            "schema": f"{self.schema:08x}", "proto": self.proto, "mock": self.mock,
            "board_id": self.board, "boot_count": self.boot_count,
            "reset_cause": self.reset_cause,
            "bootloader": BOOTLOADERS.get(self.bootloader, "unknown"),
            "edges_per_rev": list(self.edges_per_rev), "caps": self.caps,
        }
