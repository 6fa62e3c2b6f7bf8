"""The layers of the firmware, each with the lines of its sources that make it."""

from __future__ import annotations

from fault_table.layers import firmware

firmware("beat_loop", "the loop counts beats",
         ("src/core/supervisor.cpp", "{Safety::kLive, Safety::kTripped, kStop | kLost, 0}",
          "{Safety::kLive, Safety::kTripped, kStop, 0}"))
firmware("beat_interrupt", "the slot interrupt counts beats",
         ("src/board/outputs.cpp", "    outputs_cut();\n", ""))
firmware("watchdog", "the watchdog's interrupt cuts",
         ("src/main.cpp",
          "  board::watchdog_start(settings.safety_out != 0, settings.wdt_reset);\n", ""),
         ("src/board/boot.cpp", "    WDTCSR |= _BV(WDIE);\n", ""))
firmware("edge_budget", "an encoder input has a budget of edges per slot",
         ("src/board/edges.cpp", '"cbi  %[eimsk], %[own]        \\n\\t"',
          '"nop                          \\n\\t"'))
firmware("imu_zeros", "a sample of zeros is no sample",
         ("src/core/bno055_samples.cpp", "bool const zeros = all_zero(leg_, 12);",
          "bool const zeros = all_zero(leg_, 12) && false;"))
firmware("imu_mode", "the mode of the BNO055 is polled",
         ("src/core/bno055_samples.cpp", "if ((leg_[0] & kModeMask) != kModeImuPlus) {",
          "if (false) {"))
firmware("imu_fail", "a read that fails is no sample",
         ("src/core/bno055.cpp", "  count_error(kind);\n  valid_ = false;\n",
          "  count_error(kind);\n"))
firmware("bus_clear", "a line that is held low is clocked free",
         ("src/core/bno055.cpp", "      bus_->clear();\n", "      bus_->lines_low();\n"))
firmware("imu_power", "a part that hangs is switched off and on",
         ("src/core/bno055.cpp", "{ImuState::kPowerOff, 100, ImuState::kProbe}",
          "{ImuState::kPowerOff, 0, ImuState::kProbe}"))
firmware("imu_stuck", "samples that never change are told",
         ("src/core/bno055.cpp", "return equal_ >= kStuckSamples && edges_ - edges_equal_ >= 2;",
          "return equal_ >= kStuckSamples && edges_ - edges_equal_ >= 2 && false;"))
firmware("imu_absent", "a part that never answers is told",
         ("src/core/bno055.cpp", "      ++power_tries_;\n", ""))
firmware("slot_crc", "a torn record is not believed",
         ("src/core/slots.cpp", "word_at(end) == crc", "(word_at(end) == crc || true)"))
firmware("short_interrupts", "no interrupt takes longer than two bytes on the line",
         ("src/board/twi.cpp", "inline void on_event() {\n",
          "inline void on_event() {\n  __builtin_avr_delay_cycles(1600);\n"))
firmware("imu_stale", "a sample older than 20 ms is stale",
         ("src/app/state_frame.cpp", "constexpr Tick kStale = ticks_of_ms(20);",
          "constexpr Tick kStale = ticks_of_ms(20000);"))
firmware("imu_ladder", "a part that refuses ten reads is reset",
         ("src/core/bno055.cpp", "} else if (failures_ >= kFailuresToReset &&",
          "} else if (false && failures_ >= kFailuresToReset &&"))
