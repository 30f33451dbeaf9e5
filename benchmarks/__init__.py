"""Programs that measure what README.md and docs/benchmarks.md quote.

Each runs as `python -m benchmarks.NAME [--quick] [--json FILE]`, prints a table and
writes one flat JSON object. `count_house` and `count_method` count the code. Programs
that look at one part of the loop alone are in `studies/`.
"""
