"""The forward model of a recorded drive: logged commands, actuators, motion, sensors.

What ``evaluate`` scores, ``identify`` and ``diagnose`` fit, and ``diagnose.suggest``
drives without a car.
"""
