"""Tasks shared between threads, processes or machines, in chunks that are kept as they are done."""
