"""Programs that look at one part of the loop alone, where a benchmark runs the whole.

Each runs as `python -m studies.NAME`, tells what it needs with `--help`, and prints
lines. What README.md and docs/benchmarks.md quote is in `benchmarks/`.
"""
