"""Robots, ground and clips as meshes that move."""
