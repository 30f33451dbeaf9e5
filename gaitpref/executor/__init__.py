"""Who runs what falls apart into pieces: processes of this machine, or Ray tasks."""
