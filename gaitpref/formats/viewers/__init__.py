"""Episodes for the viewers of other projects."""
