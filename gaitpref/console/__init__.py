"""What the console says: lines, alarms, progress, and which package is missing."""
