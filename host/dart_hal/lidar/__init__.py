"""The lidar: bytes of a YDLidar X4 into scans with a time for every beam."""
