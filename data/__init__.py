"""Records, MCAP episodes, data sets and answers; knows no simulator and no torch."""
