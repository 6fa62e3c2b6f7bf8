"""Where the car is by its own lidar: a map, scans, and the wheels and gyro between them."""
