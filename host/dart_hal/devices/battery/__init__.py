"""Sensors of the battery on the computer's I2C bus."""
