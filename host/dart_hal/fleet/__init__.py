"""Cars that tell each other where they are, and one key that stops them all.

``messages`` and ``codec`` say what is told, without any I/O; ``transports`` carry it; ``peers``
keeps what the others told last; ``stopping`` has both ends of a stop. Nothing here drives: what
comes from the network informs, or stops. Messages are not signed: whoever is on the network can
tell wrong poses, and stop the cars.
"""
