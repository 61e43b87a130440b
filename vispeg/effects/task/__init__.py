"""The peg, its grip and the hole: where they are, and where they are believed to be."""
