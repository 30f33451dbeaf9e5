"""Two robots in one world: physics, what they see of each other, and recording."""
