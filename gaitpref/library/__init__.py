"""The steps of the loop as functions on a data set, for programs of other people."""
