"""Mutants by hand: safety layers taken away one by one, and what once slipped through."""

from __future__ import annotations

from dataclasses import dataclass

from mutant import CHECKOUT, Mutant, make_mutant

FIRMWARE_SRC = "firmware/src/"
ACT = "host/dart_hal/devices/actuation/"
CAR_PACKAGE = "host/dart_hal/car/"


@dataclass(frozen=True, slots=True)
class Pick:
    """``old`` occurs once in ``file`` and becomes ``new``."""

    name: str
    subject: str
    file: str
    old: str
    new: str

    def mutant(self) -> Mutant:
        """Raises ValueError when the code has gone another way: pick again."""
        source = (CHECKOUT / self.file).read_text(encoding="utf-8")
        if source.count(self.old) != 1:
            raise ValueError(f"{self.file} has {self.old!r} {source.count(self.old)} times, "
                             f"the pick {self.name!r} wants it once")
        made = make_mutant(self.file, self.name, source, source.replace(self.old, self.new))
        if made is None:
            raise ValueError(f"the pick {self.name!r} changes nothing")
        return made


PICKS = (
    Pick("interrupt cuts after 2.5 s", "supervisor of the Nano",
         FIRMWARE_SRC + "core/beat_counter.h",
         "(limit_ms + kSlotMs - 1) / kSlotMs", "250 + 0 * limit_ms"),
    Pick("interrupt winds up 1 s whatever the limit", "supervisor of the Nano",
         FIRMWARE_SRC + "app/safety.cpp",
         "static_cast<uint16_t>(params.get(wire::ParamId::kBeatTimeoutMs))", "1000"),
    Pick("loop deaf to a lost beat", "supervisor of the Nano", FIRMWARE_SRC + "core/supervisor.cpp",
         "{Safety::kLive, Safety::kTripped, kStop | kLost, 0}",
         "{Safety::kLive, Safety::kTripped, kStop, 0}"),
    Pick("any token arms", "supervisor of the Nano", FIRMWARE_SRC + "core/supervisor.cpp",
         "return arm && right_token ? kArm : kDisarm;", "return arm ? kArm : kDisarm;"),
    Pick("watchdog fed without progress", "supervisor of the Nano", FIRMWARE_SRC + "board/boot.cpp",
         "if (!progress.made(slots_begun(), uart_sent())) {", "if (false) {"),
    Pick("watchdog fed while the line is silent", "supervisor of the Nano",
         FIRMWARE_SRC + "core/progress.h", "slots != slots_ && sent != sent_", "slots != slots_"),
    Pick("bus clear of one clock", "two-wire bus", FIRMWARE_SRC + "board/twi.cpp",
         "kRecoveryClocks = 9", "kRecoveryClocks = 1"),
    Pick("bus clear without a stop", "two-wire bus", FIRMWARE_SRC + "board/twi.cpp",
         "  scl_low();\n  sda_low();\n  half_period();\n", ""),
    Pick("guard in the driver's session", "guard", ACT + "guarded.py",
         "start_new_session=True", "start_new_session=False"),
    Pick("guard never tells that it tripped", "guard", ACT + "guard.py",
         '                _send_status(status, b"t")\n', ""),
    Pick("silence is not watched", "guard", ACT + "guard.py",
         "self.tripped = self.tripped or now - self._beat > BEAT_TIMEOUT", "pass"),
    Pick("a tripped guard is no cause", "driver", CAR_PACKAGE + "driver.py",
         'causes.append("GUARD_TRIPPED")', "pass"),
    Pick("a stale link is no cause", "driver", CAR_PACKAGE + "driver.py",
         'causes.append("LINK_STALE")', "pass"),
    Pick("a dead encoder in reverse is not capped", "plan", ACT + "plan.py",
         "(max(limits.min_throttle, -cap),", "(limits.min_throttle,"),
    Pick("any pulse reaches the ESC", "plan", ACT + "plan.py",
         "clip(pulse, PIN_LOW_US, PIN_HIGH_US), angle", "pulse, angle"),
    Pick("a hang in reverse does not disarm", "chain", ACT + "chain.py",
         "if expired.throttle != 0.0:", "if expired.throttle > 0.0:"),
    Pick("a setpoint that is no number leaves the old command", "engine", CAR_PACKAGE + "car.py",
         "                engine.driver.refuse_command(engine.now)\n", ""),
    Pick("a cut-off that nothing shows passes", "facts", CAR_PACKAGE + "cutoff_test.py",
         '"passed" if came else "unwired"', '"passed"'),
    Pick("neutral counts while /OE is off", "facts", CAR_PACKAGE + "facts.py",
         'if cutoff != "oe":', "if True:"),
    Pick("closing gives up where the lock is held", "engine", CAR_PACKAGE + "engine.py",
         "            self.driver.close(now)\n", "            held and self.driver.close(now)\n"),
    Pick("overdue neutral waits for the next frame", "driver", CAR_PACKAGE + "driver.py",
         "return self.actuator.violates_demand", "return False"),
    Pick("a guard's trip is acknowledged while driving", "guard", CAR_PACKAGE + "guarding.py",
         "if at_neutral and self._guard.tripped:", "if self._guard.tripped:"),
    Pick("a run-stop does not end arming", "driver", CAR_PACKAGE + "driver.py",
         "LIVE_MODES = (ArmState.ARMING, ", "LIVE_MODES = ("),
    Pick("a closed terminal ends the program at once", "engine", CAR_PACKAGE + "exit_signals.py",
         'STOPPING_SIGNALS = ("SIGTERM", "SIGHUP")', 'STOPPING_SIGNALS = ("SIGTERM",)'),
)
