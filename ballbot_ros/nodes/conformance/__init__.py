"""The contract of each role in the graph, and the test of a node against it."""
