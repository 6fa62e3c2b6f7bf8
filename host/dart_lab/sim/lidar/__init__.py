"""A lidar in the virtual world: a room of exact lines, beams, packets at the line's pace."""
