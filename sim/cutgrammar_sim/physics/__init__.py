"""Fragments as rigid bodies in SAPIEN: bodies, collision hulls, fracture toughness."""
