"""Files for viewers: what Foxglove, Rerun and PlotJuggler show of stored clips."""
