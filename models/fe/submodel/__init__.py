"""One element between two pieces of ring: the sub-model on which the thesis sizes its elements."""
