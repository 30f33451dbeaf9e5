"""Programs that measure what the README and docs/benchmarks.md quote.

Each runs as `python -m benchmarks.NAME [--quick] [--json FILE]`, prints a table and
writes one flat JSON object.
"""
