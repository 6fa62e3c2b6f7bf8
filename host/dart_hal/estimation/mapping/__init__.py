"""Mapping by scans and odometry: keyframes, loop closures, an occupancy grid."""
