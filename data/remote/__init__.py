"""Data sets where many machines reach them: pushed, and pulled."""
