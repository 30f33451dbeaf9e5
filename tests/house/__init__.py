"""The repository as a whole: layers, benchmarks, names."""
