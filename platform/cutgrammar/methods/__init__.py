"""The methods that are compared, each a `Planner`: the grammar planner, the baselines, the controls and the oracles."""
