"""Joint plan fitting: whole plans, a tree of cuts with all their planes, fitted to the goal by virtual cutting."""
