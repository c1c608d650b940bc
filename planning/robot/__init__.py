"""The robot for the planner: kinematics and collision checking."""
