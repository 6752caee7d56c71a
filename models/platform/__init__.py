"""What depends on the system: POSIX calls, signals, memory, scratch folders, and how kernels are compiled."""
