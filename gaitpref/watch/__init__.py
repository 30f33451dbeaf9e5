"""One live page about a run or a training: what it does, how far it is, what it got."""
