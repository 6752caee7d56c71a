"""``spallwatch init``: from files and answers to a configuration."""
