"""Other cars in the own lidar: detection of rectangles of a known size, and their motion."""
