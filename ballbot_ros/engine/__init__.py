"""One tick of the robot, and one run of it, as functions on numbers.

A tick takes constants and a state, both named tuples of numbers, and returns the next state. Nodes,
the closed loop, environments and studies hold the two and call these functions; a compiler takes
them as they are. The order of operations within a tick is written here, and nowhere else.
"""
