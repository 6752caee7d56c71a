"""Control systems beside the monitor: an OPC UA server, and MQTT Sparkplug B."""
