"""How a cut is planned before anything moves: presses, carries, transits, timing, loads."""
