"""The forward model of a recorded drive: logged commands, actuators, motion, sensors.

``evaluate`` scores it, ``identify`` and ``diagnose`` fit it, and ``diagnose.suggest`` simulates
drives with it.
"""
