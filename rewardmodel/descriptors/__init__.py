"""What a reward sees of a step: named, smooth functions of the feature row."""
