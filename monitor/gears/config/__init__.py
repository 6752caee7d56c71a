"""``[gear]`` of a configuration: names and teeth for the monitor, the whole train for the model."""
