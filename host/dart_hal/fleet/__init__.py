"""Exchange of poses between cars, and a stop of all cars.

``messages`` and ``codec`` define the messages, without any I/O; ``transports`` carry them;
``peers`` stores the newest message of each member; ``stopping`` has both sides of a stop; ``key``
signs messages and ``outbox`` sends them. Nothing here drives a car: messages inform, or stop.
Without a key each computer on the network can send wrong poses, stop the cars, and keep a watched
car driving.
"""
