"""The N-th call of each kind fails, in the daemon, its children and the commands beside it."""
