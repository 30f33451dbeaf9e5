"""The simulated robot: physics, feature row, task reward, commands, ground."""
