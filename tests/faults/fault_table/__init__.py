"""The fault table: every fault, its limit at the ESC pin, and the layer that keeps it."""
