"""Files, their limits and their locks; plain values of records; text made harmless."""
