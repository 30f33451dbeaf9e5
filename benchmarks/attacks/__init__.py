"""What `benchmarks.attack_page` throws at the labeling page, and what held means."""
