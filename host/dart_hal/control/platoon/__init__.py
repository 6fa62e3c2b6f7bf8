"""Platooning: cars that follow each other closely, by own sensors and by what the one ahead tells.

    gains       gap, headway and stiffness: the published tuning, and one whose waves fade
    laws        the published controllers: ACC by own sensors, CACC with limited feed-forward
    safe        the last word: no acceleration that does not leave a stop
    hearing     which messages of the predecessor count
    detector    whether it drives what it tells
    follower    all of that: one follower, and its modes CACC, ACC, STOP
    spacing     the gap by a scan of the lidar, else by the told pose
    by_lane     steering by the boards beside the car instead of by its pose
    car         a follower or leader on a path: steering and speed
    stability   whether disturbances fade along the string

The published laws are those of the code
Lorenzo-Lyons/Distributed-Attack-Resilient-Platooning. The safe rule is not in it.
"""
