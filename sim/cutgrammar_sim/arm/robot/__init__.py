"""The arm and its tool: kinematics, dynamics, collision checks, appearance."""
