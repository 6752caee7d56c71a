"""``spallwatch check``: validate a configuration, judge it and the recordings that it names."""
