"""The page of one or many machines: a process of its own, which reads the stores and writes acknowledgements."""
