"""Unsafe parsers in a child process."""
