"""Cars that cross, merge or share a roundabout by an order that all of them have acknowledged.

layouts      lanes of an intersection, a merge, a roundabout
layout       what routes have in common: where the ground begins and ends, lines, refusals
table        how far one car may go while another is still to come
order        who goes before whom: the protocol, as values
message      its message as bytes
speed        how fast before a line
coordinator  one car of a crossing: hears, asks, says where it has to stand, and why it waits
crosser      the same with contouring control: from messages and a pose to steering and speed
"""
