"""What is mutated, how often, and which tests are expected to notice."""

from __future__ import annotations

from dataclasses import dataclass

from cpp_mutants import cpp_mutants
from mutant import Mutant, chosen
from picked import PICKS
from python_mutants import python_mutants

HOST_PREFIX = "host/dart_hal/"
SRC = "firmware/src/"
PULSES = "tests/devices/actuation/"

PINS = "tests/faults/test_pin_details.py"
FAULT_TESTS = "tests/faults/test_fault_table.py"

WIDE = ("tests/wire", "tests/devices/actuation", "tests/car", "tests/firmware", "tests/emulator",
        "tests/devices/links", "tests/sim", "tests/faults", "tests/soak", "tests/estimation",
        "tests/contract", "tests/calibration", "tests/cli")
"""For survivors of the tests of their subject: packages that use the part, cheap ones first."""


@dataclass(frozen=True, slots=True)
class Subject:
    """A part: ``count`` mutants of ``files`` and those picked by hand; ``tests`` in order.

    ``realtime``: mostly tests with real processes notice it, so they are not left to the end.
    """

    name: str
    files: tuple[str, ...]
    tests: tuple[str, ...]
    count: int
    realtime: bool = False

    @property
    def firmware(self) -> bool:
        """Whether the images must be built before the tests."""
        return self.files[0].startswith(SRC)

    def mutants(self) -> list[Mutant]:
        """Return those to try: picked, then chosen from all that the operators make."""
        make = cpp_mutants if self.firmware else python_mutants
        made = [mutant for file in self.files for mutant in make(file)]
        return [p.mutant() for p in PICKS if p.subject == self.name] + chosen(made, self.count)


SUBJECTS = (
    Subject("codec",
            tuple(f"{HOST_PREFIX}wire/{n}.py" for n in ("cobs", "codec", "decoder", "frame",
                                                           "crc")),
            ("tests/wire",), 16),
    Subject("codec of the Nano", (SRC + "core/frame.cpp", SRC + "core/crc16.h"),
            ("tests/firmware/test_core_frames.py", "tests/firmware/test_nano_stream.py"), 12),
    Subject("supervisor", (
        HOST_PREFIX + "devices/actuation/supervisor.py",
        HOST_PREFIX + "devices/actuation/states.py"),
            (PULSES + "test_supervisor.py", "tests/devices/actuation", "tests/car",
             "tests/contract/test_contract_arming.py"), 14),
    Subject("supervisor of the Nano", (SRC + "core/supervisor.cpp",),
            ("tests/firmware/test_core_supervisor.py", "tests/firmware/test_nano_safety.py",
             "tests/firmware"), 12),
    Subject("guard", (HOST_PREFIX + "devices/actuation/guard.py",
                      HOST_PREFIX + "devices/actuation/guarded.py"),
            (PULSES + "test_guard.py", "tests/car/test_guard_causes.py",
             PULSES + "test_further_addresses.py", PINS,
             "tests/contract/test_contract_realtime.py", "tests/car"), 14, realtime=True),
    Subject("arming", (HOST_PREFIX + "devices/actuation/arming.py",),
            (PULSES + "test_supervisor.py", "tests/contract/test_contract_arming.py", PINS,
             "tests/car/test_disarmed.py", "tests/devices/actuation", "tests/car"), 10),
    Subject("driver", (HOST_PREFIX + "car/driver.py",),
            (PINS, "tests/car/test_guard_causes.py", "tests/car/test_driver_steps.py",
             "tests/car/test_disarmed.py",
             "tests/car/test_raw.py", "tests/car/test_neutral_that_drives.py",
             "tests/contract/test_contract_arming.py", FAULT_TESTS, "tests/car", "tests/contract"),
             14),
    Subject("edges", (SRC + "board/edges.cpp", SRC + "core/edge_counter.h"),
            ("tests/firmware/test_core_encoder.py", "tests/firmware/test_nano_edges.py",
             "tests/firmware"), 10),
    Subject("two-wire bus", (SRC + "board/twi.cpp", SRC + "core/bno055.cpp",
                            SRC + "core/bno055_samples.cpp"),
            ("tests/firmware/test_core_imu.py", "tests/firmware/test_nano_imu.py",
             "tests/firmware"), 12),
    Subject("chain", (HOST_PREFIX + "devices/actuation/chain.py",),
            (PULSES + "test_actuator.py", PINS, PULSES + "test_open_close.py",
             "tests/car/test_disarmed_pin.py", FAULT_TESTS), 7),
    Subject("plan", (HOST_PREFIX + "devices/actuation/plan.py",),
            (PULSES + "test_actuator.py", PULSES + "test_play.py", PINS, FAULT_TESTS), 7),
    Subject("limits", (HOST_PREFIX + "devices/actuation/limits.py",),
            (PULSES + "test_actuator.py", "tests/car/test_misuse.py", PINS,
             "tests/car/test_raw.py", FAULT_TESTS), 6),
    Subject("pca9685", (HOST_PREFIX + "devices/actuation/pca9685.py",),
            (PULSES + "test_open_close.py", PULSES + "test_who_answers.py",
             PULSES + "test_further_addresses.py",
             PULSES + "test_pwm_frequency.py", PULSES + "test_actuator.py",
             FAULT_TESTS), 7),
    Subject("facts", (HOST_PREFIX + "car/facts.py",),
            (PINS, "tests/contract/test_contract_arming.py", "tests/car/test_disarmed.py",
             "tests/car/test_doubted_speed.py", FAULT_TESTS), 6),
    Subject("engine", (HOST_PREFIX + "car/engine.py",),
            ("tests/car/test_closing.py", PINS, "tests/car/test_nothing_waits.py",
             "tests/car/test_frame_time.py", "tests/car/test_misuse.py",
             "tests/car/test_reset_and_odometry.py", FAULT_TESTS), 6),
    Subject("pump", (HOST_PREFIX + "car/pump.py",),
            ("tests/car/test_pump.py", "tests/car/test_nothing_waits.py",
             "tests/car/test_misuse.py", "tests/car/test_reconnect.py", FAULT_TESTS,
             "tests/contract/test_contract_realtime.py",
             "tests/contract/test_contract_replug.py"), 5),
    Subject("view", ("host/dart_lab/live/view/desk.py", "host/dart_lab/live/view/access.py"),
            ("tests/live/view/test_access_and_messages.py", "tests/live/view/test_desk_pins.py",
             "tests/live/view/test_desk_records.py", "tests/live/view/test_drive_view.py",
             "tests/live/view/test_stop_seats.py", "tests/live/view/test_sockets.py"), 6),
    Subject("fleet", (HOST_PREFIX + "fleet/peers.py", HOST_PREFIX + "fleet/stopping.py"),
            ("tests/fleet/test_peers.py", "tests/fleet/test_stop_pin.py",
             "tests/fleet/test_attacks.py", "tests/fleet/test_codec.py",
             "tests/fleet/test_lockstep.py"), 6),
    Subject("outputs of the Nano", (SRC + "board/outputs.cpp",),
            ("tests/firmware/test_nano_multiplexer.py", "tests/firmware/test_nano_safety.py",
             "tests/firmware", FAULT_TESTS), 6),
)
