"""Cars that share their plans: each keeps its distance from all plans that others may execute.

timed_plan  a plan: speeds along a path at equidistant times, with rest at its end
space       the paths of all cars, where they may rest, and whether two plans are separated
search      the best plan of one car around the plans of the others
message     committed plan, proposal and acknowledgements as bytes
planner     one car: proposes, acknowledges, adopts; the proof that lost messages cause no contact
"""
