"""What of a reward a training is paid."""
