"""The topics of DART's own software: controllers that were written for it drive these cars.

``commands``: what a message does to the car; ``told``: what a State becomes; ``bridge`` brings both
together with a car. None of them knows ROS. ``ros1`` and ``ros2`` carry the messages.
"""
