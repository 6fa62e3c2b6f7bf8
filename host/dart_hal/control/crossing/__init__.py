"""Cars that cross, merge or share a roundabout in an order that all of them have acknowledged.

layouts      lanes of an intersection, a merge, a roundabout
layout       common ground of routes: where it begins and ends, stop lines, checks
table        how far one car may go while another one is still to come
order        the protocol of the order, as values
message      its message as bytes
speed        how fast before a line
coordinator  one car of a crossing: takes messages, requests, finds its stop line and the reason
crosser      the same with contouring control: from messages and a pose to steering and speed
plan_crosser the alternative without an order: cars share their plans (``control.shared_plans``)
"""
