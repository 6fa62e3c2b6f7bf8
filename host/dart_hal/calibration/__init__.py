"""Calibration: one procedure per quantity of a car, and the plan of all of them.

``clock``, ``esc``, ``encoder``, ``throttle``, ``imu``, ``steering``, ``latency``, ``mocap`` and
``lidar`` measure; ``order`` plans all; ``result`` is what each returns; ``from_recordings``
measures on recordings instead of a car.
"""
