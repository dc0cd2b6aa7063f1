"""Two third-person depth cameras on the board (IV-D), how they are rendered, and films of what a robot did."""
