"""The layers of the firmware, each with the lines of its sources that make it."""

from __future__ import annotations

from fault_table.layers import firmware

firmware("beat_loop", "the loop counts beats",
         ("src/core/supervisor.cpp", "{Safety::kLive, Safety::kTripped, kStop | kLost, 0}",
          "{Safety::kLive, Safety::kTripped, kStop, 0}"))
firmware("beat_interrupt", "the slot interrupt counts beats",
         ("src/board/outputs.cpp", "    outputs_cut();\n", ""))
firmware("watchdog", "the watchdog's interrupt cuts",
         ("src/main.cpp", "  board::watchdog_start(settings.wdt_reset);\n", ""))
