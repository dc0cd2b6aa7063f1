"""The methods compared: the grammar planner, its rivals and the controls, each a Planner."""
