"""Unexplained structure: residuals that depend on the drive and have no cause in the catalogue.

``features`` are what the car was doing, ``bases`` and ``waves`` functions of them, ``crossfit``
fits on some blocks and judges on others, ``structure`` finds the largest pattern, ``outliers`` the
worst moments.
"""
