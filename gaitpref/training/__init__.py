"""What a training is paid, and how a method records and trains."""
