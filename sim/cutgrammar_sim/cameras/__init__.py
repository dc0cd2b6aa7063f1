"""Two third-person depth cameras on the board (IV-D), and how their images are rendered."""
