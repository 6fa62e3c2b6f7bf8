"""Cars that tell each other where they are, and one key that stops them all.

``messages`` and ``codec`` say what is told, without any I/O; ``transports`` carry it; ``peers``
keeps what the others told last; ``stopping`` has both ends of a stop. Nothing here drives: what
comes from a room informs, or stops. ``key`` signs messages and ``outbox`` sends them; without a
key each computer on the network can send wrong poses, stop the cars, and keep a watched car
driving.
"""
