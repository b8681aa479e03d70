"""The motion model of firmware: `rules` computes single moves in plain Python, `vectorized` whole arrays."""
