"""Pictures that move: clips, pairs and policies as films."""
