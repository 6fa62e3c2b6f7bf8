"""Everything behind a port or a socket: serial and I2C links, PCA9685, lidar, camera, poses."""
