"""Periods that several packages share: messages of the Nano, frames of the PWM."""

SAMPLE = 0.01  # s; period of STATE messages, and step of the grid on which recordings are predicted
PWM_FRAME = 0.02  # s; period of the servo pulses: a command waits for the next one

# Standard deviation [s] of that wait, which is uniform over a frame. A run writes its commands with
# every second message of the Nano, 20.02 ms, and a frame is as long but for 0.02 %: all commands of
# a minute wait about as long, and those of another run another time.
PWM_WAIT_STD = PWM_FRAME / 12.0**0.5
