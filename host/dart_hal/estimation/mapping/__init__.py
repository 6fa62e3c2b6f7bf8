"""A map of the room out of scans and odometry: keyframes, loop closures, an occupancy grid."""
