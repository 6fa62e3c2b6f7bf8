"""Unexplained structure: residuals that depend on the drive without a cause in the catalogue.

``features`` describe the motion in each window, ``bases`` and ``waves`` are functions of them,
``crossfit`` fits on some blocks and tests on others, ``structure`` finds the largest pattern,
``outliers`` finds moments with exceptionally large errors.
"""
