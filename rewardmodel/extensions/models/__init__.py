"""Networks and a Gaussian process, for where answers are many."""
