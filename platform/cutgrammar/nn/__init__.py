"""Small neural networks: trained with torch, evaluated with NumPy."""
