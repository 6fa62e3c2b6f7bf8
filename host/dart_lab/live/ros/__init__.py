"""The topics of DART's own ROS software: controllers written for it drive these cars.

The module ``commands`` turns received messages into commands, ``told`` turns a State into
messages, and ``bridge`` connects both with a car. They do not depend on ROS: ``ros1`` and ``ros2``
transport the messages.
"""
