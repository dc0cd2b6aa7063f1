"""How a planned cut is carried out in simulation, and the record of the motion."""
