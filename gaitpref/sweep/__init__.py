"""Many loops at once: which, run or gone on with, and what came of them together."""
