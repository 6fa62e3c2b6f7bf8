"""Periods that several packages use: messages of the Nano, frames of the PWM."""

# s; period of STATE messages, and time step of the grid on which recordings are predicted.
SAMPLE = 0.01
# s; period of the servo pulses. A command takes effect with the next pulse.
PWM_FRAME = 0.02

# Standard deviation [s] of the wait for the next pulse, which is uniform over a frame. A run sends
# its commands with every second message of the Nano, each 20.02 ms. A frame has nearly the same
# length, so the wait is almost constant for a minute and differs between runs.
PWM_WAIT_STD = PWM_FRAME / 12.0**0.5
