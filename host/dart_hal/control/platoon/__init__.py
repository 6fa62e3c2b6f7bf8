"""Platooning: cars that follow each other closely, by own sensors and by messages of the
predecessor.

    gains       gap, headway and stiffness: the published tuning, and a string-stable one
    laws        the published controllers: ACC by own sensors, CACC with limited feed-forward
    safe        safety filter: no acceleration after which the car cannot stop in time
    hearing     which messages of the predecessor are accepted
    detector    whether the predecessor drives the acceleration that it reports
    follower    all of that: one follower, and its modes CACC, ACC, STOP
    spacing     the gap by a scan of the lidar, else by the reported pose
    by_lane     steering by the boards of the lane instead of by the pose
    car         a follower or leader on a path: steering and speed
    stability   whether disturbances decay along the string

The published laws are those of the code
Lorenzo-Lyons/Distributed-Attack-Resilient-Platooning. The safety filter is not part of it.
"""
