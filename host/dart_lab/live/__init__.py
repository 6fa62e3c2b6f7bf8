"""What shows or serves a car while it drives: live page, Foxglove, ROS."""
